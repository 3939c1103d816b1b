// Cheapest ways over a costmap from cell to cell: of a point, and of a shape that has a heading.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace semmap {

struct Cell {
    std::int64_t row;
    std::int64_t column;
};

// A costmap and what its costs are worth. A step costs its length times the mean over its two
// cells of 1 + slow * cost / 252. Below 2^32 cells.
struct Terrain {
    const std::uint8_t* costs;  // rows x columns
    std::size_t rows;
    std::size_t columns;
    double resolution;
    double slow;
};

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

// Writes the prices and lengths (starts x goals) of the cheapest ways of a point; infinity where
// there is none. Cells of 253 and more are not passed. `among`: the goals are the starts, and each
// way is searched once. All throw std::bad_alloc.
void travel(const Terrain& terrain, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
            bool among, unsigned threads, double* prices, double* metres);

// The same of a shape, at any heading at both ends. It drives along its heading, ahead or back, and
// turns on the spot for nothing. Its origin must not be in cells of 255.
void drive(const Space& space, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
           bool among, unsigned threads, double* prices, double* metres);

// The cells of the cheapest way, both ends included, each with the heading of the step into it;
// none where there is none.
std::vector<Stand> way(const Terrain& terrain, Cell start, Cell goal);
std::vector<Stand> drive_way(const Space& space, Cell start, Cell goal);

}  // namespace semmap
