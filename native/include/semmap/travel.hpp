// Cheapest ways over a costmap, from cell to cell.
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
// cells of 1 + slow * cost / 252; cells of 253 and more are not passed.
struct Terrain {
    const std::uint8_t* costs;  // rows x columns
    std::size_t rows;
    std::size_t columns;
    double resolution;
    double slow;
};

// Writes the prices and lengths (starts x goals) of the cheapest ways; infinity where there is
// none. Cells lie in the grid. False where memory ran out.
bool travel(const Terrain& terrain, const std::vector<Cell>& starts, const std::vector<Cell>& goals,
            unsigned threads, double* prices, double* metres);

// The same among the stands (stands x stands), each way searched once.
bool travel(const Terrain& terrain, const std::vector<Cell>& stands, unsigned threads,
            double* prices, double* metres);

// The cells of the cheapest way, both ends included; none where there is none. Throws
// std::bad_alloc.
std::vector<Cell> way(const Terrain& terrain, Cell start, Cell goal);

}  // namespace semmap
