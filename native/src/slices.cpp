#include "semmap/slices.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace semmap {
namespace {

struct Point {
    double x;
    double y;
};

// Marks the cells that a segment touches: per row, the columns of its part within that row.
void draw(Point a, Point b, const GridFrame& grid, std::uint8_t* cells) {
    // In cells from the origin.
    a = {(a.x - grid.origin_x) / grid.resolution, (a.y - grid.origin_y) / grid.resolution};
    b = {(b.x - grid.origin_x) / grid.resolution, (b.y - grid.origin_y) / grid.resolution};
    if (a.y > b.y) std::swap(a, b);
    const double last_row = static_cast<double>(grid.rows) - 1;
    const double last_column = static_cast<double>(grid.columns) - 1;
    const double first = std::max(std::floor(a.y), 0.0);
    const double last = std::min(std::floor(b.y), last_row);
    for (double row = first; row <= last; ++row) {
        double xa = a.x;
        double xb = b.x;
        if (b.y > a.y) {
            const double slope = (b.x - a.x) / (b.y - a.y);
            if (a.y < row) xa = a.x + (row - a.y) * slope;
            if (b.y > row + 1) xb = a.x + (row + 1 - a.y) * slope;
        }
        const double low = std::max(std::floor(std::min(xa, xb)), 0.0);
        const double high = std::min(std::floor(std::max(xa, xb)), last_column);
        if (low > high) continue;
        std::uint8_t* line = cells + static_cast<std::ptrdiff_t>(row) * grid.columns;
        std::fill(line + static_cast<std::ptrdiff_t>(low),
                  line + static_cast<std::ptrdiff_t>(high) + 1, std::uint8_t{1});
    }
}

}  // namespace

void slice(const double* vertices, const std::int32_t* faces, std::size_t face_count, double height,
           const GridFrame& grid, std::uint8_t* cells) {
    for (std::size_t f = 0; f < face_count; ++f) {
        std::array<const double*, 3> corner;
        for (int k = 0; k < 3; ++k) {
            corner[k] = vertices + 3 * static_cast<std::ptrdiff_t>(faces[3 * f + k]);
        }
        const double lowest = std::min({corner[0][2], corner[1][2], corner[2][2]});
        const double highest = std::max({corner[0][2], corner[1][2], corner[2][2]});
        if (!(lowest <= height && height <= highest)) continue;

        std::array<Point, 4> found;
        int count = 0;
        for (int k = 0; k < 3; ++k) {
            const double* p = corner[k];
            const double* q = corner[(k + 1) % 3];
            if (p[2] == height) found[count++] = {p[0], p[1]};
            if ((p[2] < height && q[2] > height) || (p[2] > height && q[2] < height)) {
                const double t = (height - p[2]) / (q[2] - p[2]);
                found[count++] = {p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])};
            }
        }
        for (int k = 0; k < count; ++k) {
            draw(found[k], found[(k + 1) % count], grid, cells);
        }
    }
}

}  // namespace semmap
