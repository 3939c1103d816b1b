// New grids from grids, block by block. Two grids must have one lattice and placement: `resampled`
// brings one to those of the other.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "semmap/fields/grid.hpp"

namespace semmap::fields {

// The value where both grids have one.
enum class Join { first, last, max, min, sum };

// Returns the voxels of both grids.
template <typename Value>
Grid<Value> joined(const Grid<Value>& a, const Grid<Value>& b, Join how);

// Returns the voxels of the grid where the mask is active, or where it is inactive.
template <typename Value>
Grid<Value> masked(const Grid<Value>& grid, const Grid<bool>& mask, bool inside);

// Returns true where there is a value.
template <typename Value>
Grid<bool> active(const Grid<Value>& grid);

// Returns true where the value is within [low, high].
template <typename Value>
Grid<bool> between(const Grid<Value>& grid, Value low, Value high);

// Replaces the first value of each pair by the second; keeps other values.
Grid<std::int32_t> renumbered(const Grid<std::int32_t>& grid,
                              const std::vector<std::pair<std::int32_t, std::int32_t>>& pairs);

// Returns the voxels in the box low..high, both included.
template <typename Value>
Grid<Value> cropped(const Grid<Value>& grid, const Coord& low, const Coord& high);

// Returns the grid in another lattice: each voxel gets the value at its centre.
template <typename Value>
Grid<Value> resampled(const Grid<Value>& grid, double voxel_size, const Placement& placement);

// An image of depths and labels (0: none) as voxels of a grid that is not placed: a voxel has the
// label of more than half of the pixels in it, or else one that it has at least once. `depth` and
// `labels` are rows x columns.
Grid<std::int32_t> labelled(const float* depth, const std::int32_t* labels, std::size_t rows,
                            std::size_t columns, const Camera& camera, double farthest,
                            double voxel_size);

}  // namespace semmap::fields
