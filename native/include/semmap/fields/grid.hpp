// One value a voxel, sparse: bool, int32 or float32, placed in a shared frame.
#pragma once

#include <openvdb/openvdb.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "semmap/fields/shapes.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

// Rows of the rotation and translation that take points of the grid's frame to the shared one.
using Placement = std::array<std::array<double, 4>, 3>;

constexpr Placement kUnmoved{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};

// Not for writers and readers at once.
template <typename Value>
class Grid {
  public:
    using Tree = typename openvdb::tree::Tree4<Value, 5, 4, 3>::Type;
    using VdbGrid = openvdb::Grid<Tree>;

    Grid(double voxel_size, Value background);

    double voxel_size() const { return voxel_size_; }
    Value background() const { return grid_->background(); }
    const Placement& placement() const { return placement_; }
    void place(const Placement& placement);
    // The same voxels elsewhere; they are shared, so that neither may be changed from then on.
    Grid placed(const Placement& placement) const;
    const Tree& tree() const { return grid_->constTree(); }
    Tree& tree() { return grid_->tree(); }

    // The region stands in the grid's own frame.
    void fill(const Shape& shape, Value value);
    void clear(const Shape& shape);
    void set(const std::int32_t* voxels, const Value* values, std::size_t count);
    // At points of the shared frame; the background where nothing is.
    void look_up(const double* points, std::size_t count, Value* values) const;
    std::size_t size() const { return static_cast<std::size_t>(grid_->activeVoxelCount()); }
    // Block by block; `voxels` has room for 3 * size() numbers, `values` for size().
    void read(std::int32_t* voxels, Value* values) const;
    // The box of voxels from `low` on, x slowest.
    void read_box(const std::array<std::int32_t, 3>& low, const std::array<std::int32_t, 3>& shape,
                  Value* values) const;
    void prune();
    std::size_t bytes() const { return static_cast<std::size_t>(grid_->memUsage()); }

    void write(const std::string& path, const std::string& name) const;

  private:
    typename VdbGrid::Ptr grid_;
    double voxel_size_;
    Placement placement_ = kUnmoved;
};

extern template class Grid<bool>;
extern template class Grid<std::int32_t>;
extern template class Grid<float>;

}  // namespace semmap::fields
