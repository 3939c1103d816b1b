// Regions of space in metres, and the voxels that belong to them.
//
// A voxel is floor(p / size). It belongs to a solid if its centre lies in it, the surface included,
// to 1e-9 of a voxel. Where a solid is so thin that it could lie between centres (narrower than a
// voxel in one direction, than sqrt(2) voxels in two or than sqrt(3) in three), all the voxels that
// it meets belong to it; so do they to a surface.
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

// Closed: each edge is walked as often one way as the other. Inside is what the winding number
// says, whichever way its faces turn, so that parts may overlap, be hollow or be mirrored.
struct Solid {
    std::vector<Vector> vertices;
    std::vector<Triangle> faces;
};

// Triangles with no inside.
struct Surface {
    std::vector<Vector> vertices;
    std::vector<Triangle> faces;
};

using Shape = std::variant<Ball, Cylinder, Cone, Polytope, Points, Solid, Surface>;

// Throws BadRegion where it would have more than `region_limits` allow, before it has.
Voxels rasterise(const Shape& shape, double voxel_size);

// Vertices of the same place are one; how many of the edges are not closed.
std::size_t weld(std::vector<Vector>& vertices, std::vector<Triangle>& faces);

// A pinhole camera; pixel (row, column) looks along ((column - cx) / fx, (row - cy) / fy, 1).
struct Camera {
    double fx;
    double fy;
    double cx;
    double cy;
    std::array<std::array<double, 4>, 3> pose;  // rows of its rotation and translation
};

// Where the masked pixels of a depth image lie; `mask` may be null. Left out: what is not above 0,
// not finite or beyond `farthest`.
Points points_of_depth(const float* depth, const std::uint8_t* mask, std::size_t rows,
                       std::size_t columns, const Camera& camera, double farthest);

Voxels voxels_of_points(const double* points, std::size_t count, double voxel_size);

}  // namespace semmap::fields
