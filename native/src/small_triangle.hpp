// Triangles of a few cells, four rows at once in single precision.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "semmap/grid.hpp"
#include "semmap/locate.hpp"

namespace semmap {

class SmallTriangle {
    typedef double Pair __attribute__((vector_size(16)));
    typedef float Point __attribute__((vector_size(8)));
    typedef float Floats __attribute__((vector_size(16)));
    typedef std::int32_t Ints __attribute__((vector_size(16)));

  public:
    // Rows and columns beyond the first.
    static constexpr std::int32_t kMost = 29;

    explicit SmallTriangle(const GridFrame& grid)
        : origin_{grid.origin_x, grid.origin_y},
          per_metre_(1.0 / grid.resolution),
          trusted_(Locator(grid).spot_error() < 0x1p-24) {}

    // Paints a triangle between those rows and from that column on, which the grid holds. False
    // where single precision cannot decide; what is painted by then is right.
    //
    // Coordinates are below 32, so that each is off by less than 2^-19, and points of an edge of
    // slope s = du/dv that rises by kLeastRise by less than 2^-15 (1 + |s|), rounding included.
    template <typename Canvas>
    bool paint(const double* a, const double* b, const double* c, std::int32_t low_row,
               std::int32_t high_row, std::int32_t low_column, Canvas& canvas) const {
        if (!trusted_) return false;
        const Pair base{low_column - 1.0, low_row - 1.0};
        const auto near = [&](const double* p) {
            Pair at;
            std::memcpy(&at, p, sizeof at);
            return __builtin_convertvector((at - origin_) * per_metre_ - base, Point);
        };
        const Point p = near(a);
        const Point q = near(b);
        const Point r = near(c);
        // Edges p-q, q-r, r-p.
        const Floats u{p[0], q[0], r[0], p[0]};
        const Floats v{p[1], q[1], r[1], p[1]};
        const Floats next_u{q[0], r[0], p[0], q[0]};
        const Floats next_v{q[1], r[1], p[1], q[1]};
        const Floats low_v = least(v, next_v);
        const Floats high_v = most(v, next_v);
        const Ints first_row = whole(low_v - 0x1p-19f);
        const Ints last_row = whole(high_v + 0x1p-19f);
        const Floats rise = high_v - low_v;
        const Ints level = first_row == last_row;  // its ends are those of the other edges
        if (!all((level | (rise > 0x1p-10f)) & (first_row == whole(low_v + 0x1p-19f)) &
                 (last_row == whole(high_v - 0x1p-19f)))) {
            return false;
        }
        const Floats slope = (Floats)((Ints)((next_u - u) / (next_v - v)) & ~level);
        const Floats start = u - v * slope;
        // No row is between those of a level edge.
        const Floats first = __builtin_convertvector(first_row - level, Floats);
        const Floats last = __builtin_convertvector(last_row, Floats);
        const Floats tilt = (Floats)((Ints)slope & 0x7FFFFFFF);
        const float error = 0x1p-15f * (1.0f + std::max({tilt[0], tilt[1], tilt[2]}));

        const std::int32_t end = high_row - low_row + 1;
        Floats floor{1, 2, 3, 4};
        for (std::int32_t row = 0; row < end; row += 4) {
            const Floats roof = floor + 1.0f;
            Floats low = spread(1e9f);
            Floats high = spread(-1e9f);
            for (int edge = 0; edge < 3; ++edge) {
                const Floats from = start[edge] + slope[edge] * most(floor, spread(low_v[edge]));
                const Floats to = start[edge] + slope[edge] * least(roof, spread(high_v[edge]));
                const Ints missed = (floor < spread(first[edge])) | (floor > spread(last[edge]));
                // All bits are set in what is no number.
                low = least((Floats)((Ints)least(from, to) | missed), low);
                high = most((Floats)((Ints)most(from, to) | missed), high);
            }
            const Ints from = whole(low - error);
            const Ints to = whole(high + error);
            if (!all((from == whole(low + error)) & (to == whole(high - error)))) return false;
            const std::int32_t left = low_column - 1;
            const std::int32_t rows = std::min(end - row, 4);
            for (std::int32_t i = 0; i < rows; ++i) {
                canvas.run(low_row + row + i, left + from[i], left + to[i]);
            }
            floor += 4.0f;
        }
        return true;
    }

  private:
    // b where a is no number.
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
