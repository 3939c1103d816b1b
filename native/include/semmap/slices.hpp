// Planes parallel to the ground through a triangle mesh, drawn on a grid (Deeken et al.,
// section 4.2).
#pragma once

#include <cstddef>
#include <cstdint>

namespace semmap {

// A grid on the ground: row 0 is the lowest y, cell (r, c) covers the half-open square at
// origin + (c, r) * resolution.
struct GridFrame {
    double origin_x;
    double origin_y;
    double resolution;
    std::ptrdiff_t rows;
    std::ptrdiff_t columns;
};

// Marks in `cells` (rows x columns, row-major, not cleared) each cell that the section of the mesh
// at z = height touches. A face that lies in the plane gives its three edges. Double throughout:
// float would move edges that lie on cell borders by a cell.
void slice(const double* vertices, const std::int32_t* faces, std::size_t face_count, double height,
           const GridFrame& grid, std::uint8_t* cells);

}  // namespace semmap
