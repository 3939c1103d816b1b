// Spheres, cylinders, cones and cuboids fitted to points of a surface.
//
// A shape is convex: a point's signed distance to its surface is the largest of those to its
// unbounded faces (planes, a cylinder or cone, a sphere), positive outside. Its bounds, in its own
// frame, are: sphere: radius; cylinder: radius, low z, high z; cone: slope (radius / height),
// low z, z of the tip; cuboid: low x, y, z, high x, y, z.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace semmap::shapes {

using Vector = std::array<double, 3>;

enum class ShapeKind { sphere, cylinder, cone, cuboid };

constexpr std::size_t kMostBounds = 6;

struct PlacedShape {
    ShapeKind kind;
    std::array<Vector, 3> axes;  // of the shape's frame, unit vectors
    Vector origin;
    std::array<double, kMostBounds> bounds;
};

struct PointsView {
    const Vector* points;
    std::size_t count;
};

// Points with normals of unit length and any sign.
struct SurfelsView {
    const Vector* points;
    const Vector* normals;
    std::size_t count;
    double spacing;  // median distance of neighbours
};

// The points x with normal * x = offset.
struct TablePlane {
    Vector normal;
    double offset;
};

struct FittedShape {
    PlacedShape shape;
    std::array<bool, kMostBounds> seen;  // which faces have points
    std::array<double, 3> deviations;    // of the sizes; infinite for those that are not seen
};

struct Counts {
    std::size_t bounds, faces, sizes;
};

constexpr Counts counts(ShapeKind kind) {
    constexpr Counts by_kind[] = {{1, 1, 1}, {3, 3, 2}, {3, 2, 2}, {6, 6, 3}};
    return by_kind[static_cast<std::size_t>(kind)];
}

// Returns a rough shape fitted to the points by weighted Gauss-Newton steps, or nothing if they
// show none of its faces. The faces that are seen are determined `turns` times; with 1, the fit is
// a rough one. The last time, the ends of the shape are those of the `whole` cloud.
std::optional<FittedShape> fit_shape(const PlacedShape& rough, const SurfelsView& cloud,
                                     const PointsView& whole, double noise,
                                     const std::optional<TablePlane>& table, int turns);

// Writes the signed distances of points to the surface.
void shape_distances(const PlacedShape& shape, const PointsView& points, double* distances);

// Returns how badly a shape explains points: the mean over them of the squared distance, in units
// of `within`, and of the turn of the normal, both at most 1. A cuboid pays for the part of its
// most seen face that the points leave open: of a disk, 0.21.
double shape_cost(const PlacedShape& shape, const SurfelsView& cloud, double within);

// Writes the normals of the planes through neighbours, (rows, k) numbers of points, and the
// variances across them.
void local_planes(const PointsView& points, const std::int64_t* near, std::size_t rows,
                  std::size_t k, Vector* normals, double* variances);

}  // namespace semmap::shapes
