// Sparse grids with one value per voxel: bool, int32 or float32, placed in a shared frame.
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

// Not safe for a writer and other threads at the same time.
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
