// Sparse grids with one value per voxel: bool, int32 or float32, placed in a shared frame.
#pragma once

#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

#include "semmap/fields/shapes.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

constexpr Placement kUnmoved{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};

// Not safe for a writer and other threads at the same time.
template <typename Value>
class Grid {
  public:
    using Tree = typename openvdb::tree::Tree4<Value, 5, 4, 3>::Type;
    using VdbGrid = openvdb::Grid<Tree>;

    Grid(double voxel_size, Value background);

    double voxel_size() const { return voxel_size_; }
    Value background() const { return grid_->background(); }
    // Takes points of the grid's frame to the shared one.
    const Placement& placement() const { return placement_; }
    void place(const Placement& placement);
    // Returns the same voxels at another placement. They are shared: do not change either grid.
    Grid placed(const Placement& placement) const;
    const Tree& tree() const { return grid_->constTree(); }
    Tree& tree() { return grid_->tree(); }

    // The region is in the frame of the grid.
    void fill(const Shape& shape, Value value);
    void clear(const Shape& shape);
    void set(const std::int32_t* voxels, const Value* values, std::size_t count);
    // Returns the values at points of the shared frame; the background where there is no voxel.
    void look_up(const double* points, std::size_t count, Value* values) const;
    std::size_t size() const { return static_cast<std::size_t>(grid_->activeVoxelCount()); }
    // Writes the voxels block by block: 3 * size() numbers to `voxels`, size() to `values`.
    void read(std::int32_t* voxels, Value* values) const;
    // Reads the box of voxels that begins at `low`, x slowest.
    void read_box(const Coord& low, const Coord& shape, Value* values) const;
    void prune() { grid_->pruneGrid(); }

    void write(const std::string& path, const std::string& name) const;

  private:
    void paint(const Voxels& voxels, Value value, bool active);

    typename VdbGrid::Ptr grid_;
    double voxel_size_;
    Placement placement_ = kUnmoved;
};

template <typename Value>
struct Content {
    Words active;
    std::array<Value, kVoxels> values;
};

template <typename Value>
void read_leaf(const typename Grid<Value>::Tree::LeafNodeType& leaf, Content<Value>& content) {
    for (openvdb::Index x = 0; x < 8; ++x) {
        content.active[x] = leaf.valueMask().template getWord<std::uint64_t>(x);
    }
    if constexpr (std::is_same_v<Value, bool>) {
        for (openvdb::Index i = 0; i < kVoxels; ++i) content.values[i] = leaf.getValue(i);
    } else {
        const Value* data = leaf.buffer().data();
        std::copy(data, data + kVoxels, content.values.begin());
    }
}

// Calls each(corner) for the cubes of an edge that fill a box, in whose lowest corner one begins.
template <typename Each>
void each_cube(const CoordBBox& box, int edge, Each&& each) {
    for (openvdb::Int32 x = box.min().x(); x <= box.max().x(); x += edge) {
        for (openvdb::Int32 y = box.min().y(); y <= box.max().y(); y += edge) {
            for (openvdb::Int32 z = box.min().z(); z <= box.max().z(); z += edge) {
                each(Coord(x, y, z));
            }
        }
    }
}

extern template class Grid<bool>;
extern template class Grid<std::int32_t>;
extern template class Grid<float>;

}  // namespace semmap::fields
