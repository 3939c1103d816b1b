// Grids made of grids, block by block. Where two are taken together, they share lattice and
// placement: `resampled` brings one to the other's.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "semmap/fields/grid.hpp"

namespace semmap::fields {

using Index = std::array<std::int32_t, 3>;

// What holds where both grids have a value.
enum class Join { first, last, max, min, sum };

// What either has.
template <typename Value>
Grid<Value> joined(const Grid<Value>& a, const Grid<Value>& b, Join how);

// What of the grid lies where the mask is active, or where it is not.
template <typename Value>
Grid<Value> masked(const Grid<Value>& grid, const Grid<bool>& mask, bool inside);

// True where there is a value.
template <typename Value>
Grid<bool> active(const Grid<Value>& grid);

// True where the value is within [low, high].
template <typename Value>
Grid<bool> between(const Grid<Value>& grid, Value low, Value high);

// True where the value is one of these.
Grid<bool> among(const Grid<std::int32_t>& grid, const std::vector<std::int32_t>& values);

// Each value replaced by the one that stands beside it in the pairs; others stay.
Grid<std::int32_t> renumbered(const Grid<std::int32_t>& grid,
                              const std::vector<std::pair<std::int32_t, std::int32_t>>& pairs);

// What lies within the box of voxels low..high, both included.
template <typename Value>
Grid<Value> cropped(const Grid<Value>& grid, const Index& low, const Index& high);

// The lowest and the highest indices of active voxels.
template <typename Value>
std::optional<std::pair<Index, Index>> bounds(const Grid<Value>& grid);

// The same in another lattice: each voxel takes the value at its centre.
template <typename Value>
Grid<Value> resampled(const Grid<Value>& grid, double voxel_size, const Placement& placement);

// An image of depths and labels (0: none) as voxels of a grid that is not placed: a voxel has the
// label of more than half of the pixels in it, or else one that it has at least once. `depth` and
// `labels` are rows x columns.
Grid<std::int32_t> labelled(const float* depth, const std::int32_t* labels, std::size_t rows,
                            std::size_t columns, const Camera& camera, double farthest,
                            double voxel_size);

}  // namespace semmap::fields
