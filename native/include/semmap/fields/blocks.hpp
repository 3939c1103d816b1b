// Grids as cubes of bytes, to be kept elsewhere: equal fields give equal bytes, whatever their
// history, and the bytes give the field again, bit for bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "semmap/fields/grid.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

// Bytes by the lowest voxel of each cube. A cube that is not there is inactive and background.
using Blocks = std::map<Origin, std::string>;

// What lies in cubes of `edge` voxels, which is 8, 16, 32, 64 or 128.
template <typename Value>
Blocks blocks_of(const Grid<Value>& grid, int edge);

// Puts cubes of the same edge and background into a grid that has nothing there.
// Throws std::invalid_argument for bytes that `blocks_of` does not write; the grid is then useless.
template <typename Value>
void put_blocks(Grid<Value>& grid, const Blocks& blocks, int edge);

}  // namespace semmap::fields
