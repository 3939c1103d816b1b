#include "semmap/collisions.hpp"

#include <algorithm>

namespace semmap {

void collisions(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
                const std::vector<Run>& runs, std::uint16_t* bits) {
    std::fill_n(bits, rows * columns, std::uint16_t{0});
    const auto width = static_cast<std::int64_t>(columns);
    // How many cells are occupied before each one, modulo 2^16: a run is shorter than that.
    std::vector<std::uint16_t> before(columns + 1);
    for (std::size_t row = 0; row < rows; ++row) {
        const std::uint8_t* line = occupied + row * columns;
        if (std::none_of(line, line + columns, [](std::uint8_t cell) { return cell != 0; })) {
            continue;
        }
        for (std::size_t column = 0; column < columns; ++column) {
            before[column + 1] = static_cast<std::uint16_t>(before[column] + (line[column] != 0));
        }
        for (const Run& run : runs) {
            const std::int64_t at = static_cast<std::int64_t>(row) - run.row;
            if (at < 0 || at >= static_cast<std::int64_t>(rows)) continue;
            std::uint16_t* found = bits + at * width;
            const auto bit = static_cast<std::uint16_t>(1u << run.shape);
            const auto mark = [&](std::int64_t column) {
                const std::int64_t first = std::clamp<std::int64_t>(column + run.first, 0, width);
                const std::int64_t end = std::clamp<std::int64_t>(column + run.last + 1, 0, width);
                if (before[static_cast<std::size_t>(first)] !=
                    before[static_cast<std::size_t>(end)])
                    found[column] = static_cast<std::uint16_t>(found[column] | bit);
            };
            const std::int64_t low = std::clamp<std::int64_t>(-run.first, 0, width);
            const std::int64_t high = std::clamp<std::int64_t>(width - run.last, low, width);
            for (std::int64_t column = 0; column < low; ++column) mark(column);
            const std::uint16_t* first = before.data() + run.first;
            const std::uint16_t* end = before.data() + run.last + 1;
            for (std::int64_t column = low; column < high; ++column) {
                const unsigned meets = first[column] != end[column];
                found[column] = static_cast<std::uint16_t>(found[column] | (meets << run.shape));
            }
            for (std::int64_t column = high; column < width; ++column) mark(column);
        }
    }
}

}  // namespace semmap
