// Grids as cubes of bytes, for storage. Equal grids have equal bytes, whatever their history, and
// the bytes restore the grid bit by bit.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "semmap/fields/grid.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

// Bytes by the lowest voxel of each cube. A missing cube is inactive and has the background value.
using Blocks = std::map<Coord, std::string>;

// Returns the cubes of `edge` voxels, which is 8, 16, 32, 64 or 128.
template <typename Value>
Blocks blocks_of(const Grid<Value>& grid, int edge);

// Inserts cubes of the same edge and background into a grid that is empty there.
// Throws std::invalid_argument for bytes that `blocks_of` does not write; do not use the grid then.
template <typename Value>
void put_blocks(Grid<Value>& grid, const Blocks& blocks, int edge);

}  // namespace semmap::fields
