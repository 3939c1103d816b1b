#include "semmap/inflation.hpp"

#include <algorithm>
#include <vector>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace semmap {
namespace {

// A part of the grid whose intermediate rows stay in the cache.
constexpr std::size_t kTileRows = 128;
constexpr std::size_t kTileColumns = 1024;
constexpr std::size_t kSlack = 256;  // what the last block of a row may touch beyond it

struct Tile {
    const std::uint8_t* occupied;  // the whole grid
    std::uint8_t* costs;
    std::size_t rows;
    std::size_t columns;
    std::size_t row;
    std::size_t column;
    std::size_t height;
    std::size_t width;
    int radius;
};

// A Word is wide enough for none + radius^2, where none is above radius^2.
template <typename Word>
struct Scratch {
    explicit Scratch(const CostsByDistance& table)
        : stride(kTileColumns + 2 * static_cast<std::size_t>(table.radius) + kSlack),
          none(static_cast<Word>(
              std::min((table.radius + 1) * (table.radius + 1),
                       static_cast<int>(Word(-1)) - table.radius * table.radius))),
          cost(std::max<std::size_t>(none, 255) + 1, 0),
          distance(stride),
          squared(stride),
          below(stride * kTileRows),
          counts(stride / 16 + 2) {
        std::copy(table.cost, table.cost + table.radius * table.radius + 1, cost.begin());
    }

    std::size_t stride;
    Word none;
    std::vector<std::uint8_t> cost;      // by squared distance, 0 for none
    std::vector<std::uint8_t> distance;  // in a column, to what is occupied above or below
    std::vector<Word> squared;           // of one row
    std::vector<std::uint8_t> below;     // of all rows of a tile
    std::vector<std::uint32_t> counts;
};

constexpr int kMostInByte = 11;    // 11^2 < 255 - 11^2
constexpr int kMostInShort = 181;  // 181^2 < 65535 - 181^2

#define SEMMAP_BODY "inflation_tile.inc"
#include "families.inc"

template <typename Word>
void inflate_tiles(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
                   const CostsByDistance& table, Family family, std::uint8_t* costs) {
    Scratch<Word> scratch(table);
    for (std::size_t row = 0; row < rows; row += kTileRows) {
        for (std::size_t column = 0; column < columns; column += kTileColumns) {
            const Tile tile{occupied,
                            costs,
                            rows,
                            columns,
                            row,
                            column,
                            std::min(kTileRows, rows - row),
                            std::min(kTileColumns, columns - column),
                            table.radius};
            SEMMAP_CALL(family, cost_tile(tile, scratch));
        }
    }
}

// Any radius: the lower envelope of the parabolas g(x')^2 + (x - x')^2 of a row (Felzenszwalb and
// Huttenlocher, Distance Transforms of Sampled Functions, 2012), in integers.
void inflate_far(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
                 const CostsByDistance& table, std::uint8_t* costs) {
    const std::int64_t unreached = std::int64_t{table.radius} + 1;
    const std::int64_t farthest = std::int64_t{table.radius} * table.radius;
    std::vector<std::uint16_t> column_distance(rows * columns);
    std::vector<std::int64_t> distance(columns, unreached);
    for (std::size_t row = 0; row < rows; ++row) {
        for (std::size_t x = 0; x < columns; ++x) {
            const std::size_t i = row * columns + x;
            distance[x] = occupied[i] != 0 ? 0 : std::min(distance[x] + 1, unreached);
            column_distance[i] = static_cast<std::uint16_t>(distance[x]);
        }
    }
    std::fill(distance.begin(), distance.end(), unreached);
    std::vector<std::int64_t> apex(columns);
    std::vector<std::int64_t> from(columns);
    std::vector<std::int64_t> square(columns);
    for (std::size_t row = rows; row-- > 0;) {
        const std::uint16_t* above = column_distance.data() + row * columns;
        std::uint8_t* out = costs + row * columns;
        std::size_t count = 0;
        for (std::size_t i = 0; i < columns; ++i) {
            distance[i] =
                occupied[row * columns + i] != 0 ? 0 : std::min(distance[i] + 1, unreached);
            const std::int64_t g = std::min<std::int64_t>(distance[i], above[i]);
            if (g == unreached) continue;
            const auto x = static_cast<std::int64_t>(i);
            square[i] = g * g;
            // From where on this parabola lies below the last one.
            std::int64_t start = 0;
            while (count > 0) {
                const std::int64_t last = apex[count - 1];
                const std::int64_t over =
                    (square[i] + x * x) - (square[static_cast<std::size_t>(last)] + last * last);
                const std::int64_t twice = 2 * (x - last);
                start = over < 0 ? 0 : over / twice + 1;
                if (start > from[count - 1]) break;
                --count;
                start = 0;
            }
            if (start >= static_cast<std::int64_t>(columns)) continue;
            apex[count] = x;
            from[count++] = start;
        }
        std::size_t k = 0;
        for (std::size_t i = 0; i < columns; ++i) {
            out[i] = 0;
            if (count == 0) continue;
            const auto x = static_cast<std::int64_t>(i);
            while (k + 1 < count && from[k + 1] <= x) ++k;
            const std::int64_t dx = x - apex[k];
            const std::int64_t squared = square[static_cast<std::size_t>(apex[k])] + dx * dx;
            if (squared <= farthest) out[i] = table.cost[squared];
        }
    }
}

}  // namespace

void inflate(const std::uint8_t* occupied, std::size_t rows, std::size_t columns,
             const CostsByDistance& table, Family family, std::uint8_t* costs) {
    if (table.radius <= kMostInByte) {
        inflate_tiles<std::uint8_t>(occupied, rows, columns, table, family, costs);
    } else if (table.radius <= kMostInShort) {
        inflate_tiles<std::uint16_t>(occupied, rows, columns, table, family, costs);
    } else {
        inflate_far(occupied, rows, columns, table, costs);
    }
}

}  // namespace semmap
