// Costs that fall off around what is occupied, by exact Euclidean distance of cell centres.
#pragma once

#include <cstddef>
#include <cstdint>

#include "semmap/family.hpp"

namespace semmap {

// The cost at each squared distance 0..radius^2 in cells; it is 0 beyond.
struct CostsByDistance {
    int radius;
    const std::uint8_t* cost;
};

// Writes to `costs` (rows x columns) the cost of the distance to the nearest cell that is not 0 in
// `occupied`. Throws std::bad_alloc.
void inflate(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
             const CostsByDistance& table, Family family, std::uint8_t* costs);

}  // namespace semmap
