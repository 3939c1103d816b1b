// Regions of space in metres, and the voxels that belong to them.
//
// The voxel of a point p is floor(p / size). A voxel belongs to a solid if its centre lies in the
// solid or on its surface, to 1e-9 of a voxel. All voxels that it meets belong to a surface, and to
// a solid that could lie between centres: one that is narrower than a voxel in one direction, than
// sqrt(2) voxels in two, or than sqrt(3) in three.
#pragma once

#include <openvdb/math/Mat3.h>
#include <openvdb/math/Vec3.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <variant>
#include <vector>

#include "semmap/fields/limits.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

using Vector = openvdb::math::Vec3d;

struct Ball {
    Vector center;
    double radius;
};

// Both ends are flat; `axis` is a unit vector.
struct Cylinder {
    Vector center;
    Vector axis;
    double radius;
    double height;
};

// From the apex along the unit axis to a flat base; `half_angle` between axis and surface.
struct Cone {
    Vector apex;
    Vector axis;
    double half_angle;
    double height;
};

// The convex hull of `corners`, with the unit normals of its facets (both of a flat one) and the
// directions of its edges.
struct Polytope {
    std::vector<Vector> corners;
    std::vector<Vector> normals;
    std::vector<Vector> edges;
};

struct Points {
    std::vector<Vector> points;
};

using Triangle = std::array<std::int32_t, 3>;

struct Mesh {
    std::vector<Vector> vertices;
    std::vector<Triangle> faces;
};

// A closed mesh: each edge occurs as often in one direction as in the other. A point is inside
// where the winding number is not 0, so that parts may overlap, be hollow or be mirrored.
struct Solid : Mesh {};

// Triangles without an inside.
struct Surface : Mesh {};

using Shape = std::variant<Ball, Cylinder, Cone, Polytope, Points, Solid, Surface>;

// Throws BadRegion if it would have more voxels than `region_limits` allow, before they are
// computed.
Voxels rasterise(const Shape& shape, double voxel_size);

// Merges vertices at the same place; returns the number of edges that are not closed.
std::size_t weld(std::vector<Vector>& vertices, std::vector<Triangle>& faces);

// Rows of a rotation and translation.
using Placement = std::array<std::array<double, 4>, 3>;

inline openvdb::math::Mat3d turn_of(const Placement& p) {
    return {p[0][0], p[0][1], p[0][2], p[1][0], p[1][1], p[1][2], p[2][0], p[2][1], p[2][2]};
}

inline Vector shift_of(const Placement& p) { return {p[0][3], p[1][3], p[2][3]}; }

// A pinhole camera; pixel (row, column) looks along ((column - cx) / fx, (row - cy) / fy, 1).
struct Camera {
    double fx;
    double fy;
    double cx;
    double cy;
    Placement pose;
};

// Calls found(pixel, point) for the pixels of a depth image (rows x columns) that are
// wanted(pixel). Depths that are not above 0, not finite or beyond `farthest` are left out.
template <typename Wanted, typename Found>
void each_point(const float* depth, std::size_t rows, std::size_t columns, const Camera& camera,
                double farthest, Wanted&& wanted, Found&& found) {
    const auto turn = turn_of(camera.pose);
    const Vector shift = shift_of(camera.pose), right = turn.col(0);
    std::vector<double> along(columns);
    for (std::size_t column = 0; column < columns; ++column) {
        along[column] = (static_cast<double>(column) - camera.cx) / camera.fx;
    }
    for (std::size_t row = 0, pixel = 0; row < rows; ++row) {
        const double y = (static_cast<double>(row) - camera.cy) / camera.fy;
        const Vector middle = y * turn.col(1) + turn.col(2);
        for (std::size_t column = 0; column < columns; ++column, ++pixel) {
            const double d = depth[pixel];
            if (!wanted(pixel) || !(d > 0 && d <= farthest && d < 1e30)) continue;
            found(pixel, d * (along[column] * right + middle) + shift);
        }
    }
}

// Returns the points of the masked pixels; `mask` may be null.
Points points_of_depth(const float* depth, const std::uint8_t* mask, std::size_t rows,
                       std::size_t columns, const Camera& camera, double farthest);

}  // namespace semmap::fields
