// Regions of space in metres, and the voxels that belong to them.
//
// The voxel of a point p is floor(p / size). A voxel belongs to a solid if its centre lies in the
// solid or on its surface, to 1e-9 of a voxel. All voxels that it meets belong to a surface, and to
// a solid that could lie between centres: one that is narrower than a voxel in one direction, than
// sqrt(2) voxels in two, or than sqrt(3) in three.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <variant>
#include <vector>

#include "semmap/fields/limits.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

using Vector = std::array<double, 3>;

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

// A closed mesh: each edge occurs as often in one direction as in the other. A point is inside
// where the winding number is not 0, so that parts may overlap, be hollow or be mirrored.
struct Solid {
    std::vector<Vector> vertices;
    std::vector<Triangle> faces;
};

// Triangles without an inside.
struct Surface {
    std::vector<Vector> vertices;
    std::vector<Triangle> faces;
};

using Shape = std::variant<Ball, Cylinder, Cone, Polytope, Points, Solid, Surface>;

// Throws BadRegion if it would have more voxels than `region_limits` allow, before they are
// computed.
Voxels rasterise(const Shape& shape, double voxel_size);

// Merges vertices at the same place; returns the number of edges that are not closed.
std::size_t weld(std::vector<Vector>& vertices, std::vector<Triangle>& faces);

// A pinhole camera; pixel (row, column) looks along ((column - cx) / fx, (row - cy) / fy, 1).
struct Camera {
    double fx;
    double fy;
    double cx;
    double cy;
    std::array<std::array<double, 4>, 3> pose;  // rows of its rotation and translation
};

// Returns the points of the masked pixels of a depth image; `mask` may be null. Depths that are not
// above 0, not finite or beyond `farthest` are left out.
Points points_of_depth(const float* depth, const std::uint8_t* mask, std::size_t rows,
                       std::size_t columns, const Camera& camera, double farthest);

Voxels voxels_of_points(const double* points, std::size_t count, double voxel_size);

}  // namespace semmap::fields
