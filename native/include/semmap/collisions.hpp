// Where shapes on a grid meet occupied cells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace semmap {

// Cells of a shape in one line, relative to the cell that the shape is at.
struct Run {
    std::int32_t shape;
    std::int32_t row;
    std::int32_t first;
    std::int32_t last;
};

constexpr std::int32_t kShapes = 16;
constexpr std::int32_t kLongestRun = 60000;

// Writes for each of rows x columns cells the bits of the shapes that meet an occupied cell there.
// Cells beyond the grid are not occupied. Runs have at most kLongestRun cells. Throws
// std::bad_alloc.
void collisions(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
                const std::vector<Run>& runs, std::uint16_t* bits);

}  // namespace semmap
