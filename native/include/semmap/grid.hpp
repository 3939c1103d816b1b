// Grids on the ground.
#pragma once

#include <cstddef>
#include <cstdint>

namespace semmap {

// Row 0 is the lowest y; cell (r, c) covers the half-open square at origin + (c, r) * resolution,
// rounded to a double as it is written: 390 * 0.05 is 19.5. Both counts are below 2^30.
struct GridFrame {
    double origin_x;
    double origin_y;
    double resolution;
    std::int32_t rows;
    std::int32_t columns;

    std::size_t cells() const {
        return static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
    }
};

}  // namespace semmap
