#include "semmap/collisions.hpp"

#include <algorithm>

namespace semmap {

void collisions(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
                const std::vector<Run>& runs, std::uint16_t* bits) {
    std::fill_n(bits, rows * columns, std::uint16_t{0});
    std::int32_t reach = 0;
    for (const Run& run : runs) reach = std::max({reach, -run.first, run.last});
    const auto margin = static_cast<std::size_t>(reach);
    // How many cells are occupied before each one, modulo 2^16: a run is shorter than that. Beyond
    // the grid none are.
    std::vector<std::uint16_t> before(columns + 1 + 2 * margin);
    for (std::size_t row = 0; row < rows; ++row) {
        const std::uint8_t* line = occupied + row * columns;
        if (std::none_of(line, line + columns, [](std::uint8_t cell) { return cell != 0; })) {
            continue;
        }
        std::uint16_t* inside = before.data() + margin;
        for (std::size_t column = 0; column < columns; ++column) {
            inside[column + 1] = static_cast<std::uint16_t>(inside[column] + (line[column] != 0));
        }
        std::fill_n(inside + columns + 1, margin, inside[columns]);
        for (const Run& run : runs) {
            const std::int64_t at = static_cast<std::int64_t>(row) - run.row;
            if (at < 0 || at >= static_cast<std::int64_t>(rows)) continue;
            std::uint16_t* found = bits + static_cast<std::size_t>(at) * columns;
            const std::uint16_t* first = inside + run.first;
            const std::uint16_t* end = inside + run.last + 1;
            for (std::size_t column = 0; column < columns; ++column) {
                const unsigned meets = first[column] != end[column];
                found[column] = static_cast<std::uint16_t>(found[column] | (meets << run.shape));
            }
        }
    }
}

}  // namespace semmap
