// Cheapest ways of a shape that has a heading, over a costmap.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "semmap/travel.hpp"

namespace semmap {

constexpr std::uint8_t kClosed = 255;  // a cost: the shape's origin must not be there

// Where a shape fits. Heading h points along move h: (0, 1), (1, 2), (1, 1), (2, 1), (1, 0), ...
// in rows and columns, counter-clockwise. Bits of rows x columns cells, by heading.
struct Space {
    Terrain terrain;
    const std::uint16_t* fits;   // at heading h
    const std::uint16_t* steps;  // from the cell by move h, at heading h; and back
    const std::uint16_t* turns;  // on the spot from heading h to the next
};

struct Stand {
    Cell cell;
    std::int64_t heading;
};

// Writes the prices and lengths (starts x goals) of the cheapest ways, at any heading at both ends;
// infinity where there is none. The shape drives along its heading, ahead or back, and turns on the
// spot for nothing. False where memory ran out.
bool drive(const Space& space, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
           unsigned threads, double* prices, double* metres);

// The cells of the cheapest way with the heading in each; none where there is none. Throws
// std::bad_alloc.
std::vector<Stand> drive_way(const Space& space, Cell start, Cell goal);

}  // namespace semmap
