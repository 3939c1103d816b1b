// Convex polygons of a few cells, four rows at once in single precision.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "semmap/grid.hpp"
#include "semmap/locate.hpp"

namespace semmap {

// Rows and columns from the first to the last.
struct Extent {
    std::int32_t low_row;
    std::int32_t high_row;
    std::int32_t low_column;
    std::int32_t high_column;

    bool is_small(const GridFrame& grid) const {
        return (low_row >= 0) & (high_row < grid.rows) & (low_column >= 0) &
               (high_column < grid.columns) & (high_row - low_row < 30) &
               (high_column - low_column < 30);
    }
};

// Paints what has a small extent. False where single precision cannot decide; what is painted by
// then is right.
//
// Coordinates are below 32, so that each is off by less than 2^-19, and points of an edge of slope
// s = du/dv that rises by more than 2^-10 by less than 2^-15 (1 + |s|), rounding included.
class SmallPolygon {
    typedef double Pair __attribute__((vector_size(16)));
    typedef float Point __attribute__((vector_size(8)));
    typedef float Floats __attribute__((vector_size(16)));
    typedef std::int32_t Ints __attribute__((vector_size(16)));

  public:
    explicit SmallPolygon(const GridFrame& grid)
        : origin_{grid.origin_x, grid.origin_y},
          per_metre_(1.0 / grid.resolution),
          trusted_(Locator(grid).spot_error() < 0x1p-24) {}

    template <typename Canvas>
    bool triangle(const double* a, const double* b, const double* c, const Extent& extent,
                  Canvas& canvas) const {
        const auto near = [&](const double* p) {
            Pair at;
            std::memcpy(&at, p, sizeof at);
            return point((at - origin_) * per_metre_, extent);
        };
        return paint<3>({near(a), near(b), near(c)}, extent, canvas);
    }

    // One to five corners, in turn, known to within 2^-24.
    template <typename Canvas>
    bool polygon(const std::array<const Corner*, 5>& around, std::size_t count,
                 const Extent& extent, Canvas& canvas) const {
        std::array<Point, 5> points;
        for (std::size_t i = 0; i < 5; ++i) {
            const Corner& corner = *around[std::min(i, count - 1)];
            points[i] = point(Pair{corner.u, corner.v}, extent);
        }
        return paint<5>(points, extent, canvas);
    }

  private:
    // From column 1 and row 1.
    static Point point(Pair cells, const Extent& extent) {
        return __builtin_convertvector(cells - Pair{extent.low_column - 1.0, extent.low_row - 1.0},
                                       Point);
    }

    // Four of the edges, each from a corner to the next.
    struct Edges {
        Floats start;  // u = start + slope v
        Floats slope;
        Floats low;  // v
        Floats high;
        Floats first;  // rows
        Floats last;

        // False where an edge's rows are not sure, or it is too level to tell where it crosses one.
        bool take(Floats u, Floats v, Floats next_u, Floats next_v) {
            low = least(v, next_v);
            high = most(v, next_v);
            const Ints low_row = whole(low - 0x1p-19f);
            const Ints high_row = whole(high + 0x1p-19f);
            // Within a row an edge counts as its corner: the next is the next edge's.
            const Ints level = low_row == high_row;
            slope = (Floats)((Ints)((next_u - u) / (next_v - v)) & ~level);
            start = u - v * slope;
            first = __builtin_convertvector(low_row, Floats);
            last = __builtin_convertvector(high_row, Floats);
            return all((level | (high - low > 0x1p-10f)) & (low_row == whole(low + 0x1p-19f)) &
                       (high_row == whole(high - 0x1p-19f)));
        }

        float steepest() const {
            const Floats size = (Floats)((Ints)slope & 0x7FFFFFFF);
            return std::max(std::max(size[0], size[1]), std::max(size[2], size[3]));
        }
    };

    template <std::size_t kCorners, typename Canvas>
    bool paint(const std::array<Point, kCorners>& points, const Extent& extent,
               Canvas& canvas) const {
        if (!trusted_) return false;
        std::array<Edges, (kCorners + 3) / 4> edges;
        float steepest = 0;
        for (std::size_t k = 0; k < edges.size(); ++k) {
            const auto lanes = [&](int axis, std::size_t ahead) {
                const auto lane = [&](std::size_t i) {
                    return points[(std::min(4 * k + i, kCorners - 1) + ahead) % kCorners][axis];
                };
                return Floats{lane(0), lane(1), lane(2), lane(3)};
            };
            if (!edges[k].take(lanes(0, 0), lanes(1, 0), lanes(0, 1), lanes(1, 1))) return false;
            steepest = std::max(steepest, edges[k].steepest());
        }
        const float error = 0x1p-15f * (1.0f + steepest);

        const std::int32_t end = extent.high_row - extent.low_row + 1;
        Floats floor{1, 2, 3, 4};
        for (std::int32_t row = 0; row < end; row += 4) {
            const Floats roof = floor + 1.0f;
            Floats low = spread(1e9f);
            Floats high = spread(-1e9f);
            for (std::size_t i = 0; i < kCorners; ++i) {
                const Edges& edge = edges[i / 4];
                const std::size_t at = i % 4;
                const Floats from =
                    edge.start[at] + edge.slope[at] * most(floor, spread(edge.low[at]));
                const Floats to =
                    edge.start[at] + edge.slope[at] * least(roof, spread(edge.high[at]));
                const Ints missed =
                    (floor < spread(edge.first[at])) | (floor > spread(edge.last[at]));
                // With all bits set, the value is NaN.
                low = least((Floats)((Ints)least(from, to) | missed), low);
                high = most((Floats)((Ints)most(from, to) | missed), high);
            }
            const Ints from = whole(low - error);
            const Ints to = whole(high + error);
            if (!all((from == whole(low + error)) & (to == whole(high - error)))) return false;
            const std::int32_t left = extent.low_column - 1;
            const std::int32_t rows = std::min(end - row, 4);
            for (std::int32_t i = 0; i < rows; ++i) {
                canvas.run(extent.low_row + row + i, left + from[i], left + to[i]);
            }
            floor += 4.0f;
        }
        return true;
    }

    // b where a is NaN.
    static Floats least(Floats a, Floats b) {
#if defined(__SSE2__)
        return _mm_min_ps(a, b);
#else
        return a < b ? a : b;
#endif
    }

    static Floats most(Floats a, Floats b) {
#if defined(__SSE2__)
        return _mm_max_ps(a, b);
#else
        return a > b ? a : b;
#endif
    }

    static bool all(Ints mask) {
#if defined(__SSE2__)
        return _mm_movemask_ps((__m128)mask) == 15;
#else
        return (mask[0] & mask[1] & mask[2] & mask[3]) != 0;
#endif
    }

    static Floats spread(float number) { return Floats{number, number, number, number}; }

    static Ints whole(Floats numbers) { return __builtin_convertvector(numbers, Ints); }

    Pair origin_;
    double per_metre_;
    bool trusted_;
};

}  // namespace semmap
