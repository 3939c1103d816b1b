// Costs that fall off around what is occupied, by exact Euclidean distance of cell centres.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace semmap {

// The cost at each squared distance 0..radius^2 in cells; it is 0 beyond.
struct CostsByDistance {
    int radius;
    const std::uint8_t* cost;
};

// The same computation with the vectors of a processor family; results are equal.
enum class InflationVariant { baseline, avx2, avx512 };

// Names of the variants that this processor runs, the fastest last.
std::vector<std::string> inflation_variants();

// The variant of a name, if this processor runs it; the fastest for "".
std::optional<InflationVariant> inflation_variant(const std::string& name);

// Writes to `costs` (rows x columns) the cost of the distance to the nearest cell that is not 0 in
// `occupied`. Throws std::bad_alloc.
void inflate(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
             const CostsByDistance& table, InflationVariant variant, std::uint8_t* costs);

}  // namespace semmap
