// The unbounded faces of shapes: distances, normals, and derivatives by the bounds.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "semmap/shapes.hpp"

namespace semmap::shapes {

using Seen = std::array<bool, kMostBounds>;
constexpr Seen kEveryFace{true, true, true, true, true, true};

inline double dot(const Vector& a, const Vector& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline Vector cross(const Vector& a, const Vector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// A direction in the frame of a shape.
inline Vector turned_to(const PlacedShape& shape, const Vector& v) {
    return {dot(shape.axes[0], v), dot(shape.axes[1], v), dot(shape.axes[2], v)};
}

// A point in the frame of a shape.
inline Vector local(const PlacedShape& shape, const Vector& p) {
    return turned_to(shape,
                     {p[0] - shape.origin[0], p[1] - shape.origin[1], p[2] - shape.origin[2]});
}

// A direction of the shape's frame in that of the points.
inline Vector turned_from(const PlacedShape& shape, const Vector& v) {
    Vector found{};
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t k = 0; k < 3; ++k) found[i] += shape.axes[k][i] * v[k];
    }
    return found;
}

inline double from_axis(const Vector& p) {
    return std::max(std::sqrt(p[0] * p[0] + p[1] * p[1]), 1e-12);
}

struct FaceDistance {
    std::size_t face;
    double distance;
};

// The face of those chosen that a point, in the frame of the shape, is farthest out of.
inline FaceDistance nearest_face(const PlacedShape& shape, const Vector& p, const Seen& chosen) {
    const auto& b = shape.bounds;
    std::array<double, kMostBounds> distances{};
    switch (shape.kind) {
        case ShapeKind::sphere:
            distances[0] = std::sqrt(dot(p, p)) - b[0];
            break;
        case ShapeKind::cylinder:
            distances[0] = from_axis(p) - b[0];
            distances[1] = b[1] - p[2];
            distances[2] = p[2] - b[2];
            break;
        case ShapeKind::cone:
            distances[0] = (from_axis(p) - b[0] * (b[2] - p[2])) / std::sqrt(1 + b[0] * b[0]);
            distances[1] = b[1] - p[2];
            break;
        case ShapeKind::cuboid:
            for (std::size_t i = 0; i < 3; ++i) {
                distances[i] = b[i] - p[i];
                distances[i + 3] = p[i] - b[i + 3];
            }
    }
    FaceDistance found{kMostBounds, -INFINITY};
    for (std::size_t face = 0; face < counts(shape.kind).faces; ++face) {
        if (chosen[face] && (found.face == kMostBounds || distances[face] > found.distance)) {
            found = {face, distances[face]};
        }
    }
    return found;
}

// The outward normal of a face at a point.
inline Vector face_normal(const PlacedShape& shape, const Vector& p, std::size_t face) {
    Vector normal{};
    if (shape.kind == ShapeKind::sphere) {
        const double length = std::max(std::sqrt(dot(p, p)), 1e-12);
        return {p[0] / length, p[1] / length, p[2] / length};
    }
    if (shape.kind == ShapeKind::cuboid) {
        normal[face % 3] = face < 3 ? -1 : 1;
    } else if (face == 0) {
        const double slope = shape.kind == ShapeKind::cone ? shape.bounds[0] : 0;
        const double cos = 1 / std::sqrt(1 + slope * slope), rho = from_axis(p);
        normal = {p[0] / rho * cos, p[1] / rho * cos, slope * cos};
    } else {
        normal[2] = face == 1 ? -1 : 1;
    }
    return normal;
}

// Adds the derivatives of the distance to a face by the bounds.
inline void write_slopes(const PlacedShape& shape, const Vector& p, std::size_t face,
                         double* slopes) {
    if (shape.kind == ShapeKind::cuboid) {
        slopes[face] = face < 3 ? 1 : -1;
    } else if (face > 0) {
        slopes[face] = face == 1 ? 1 : -1;
    } else if (shape.kind == ShapeKind::cone) {
        const double tangent = shape.bounds[0], below = shape.bounds[2] - p[2];
        const double cos = 1 / std::sqrt(1 + tangent * tangent);
        slopes[0] = -cos * below - (from_axis(p) - tangent * below) * tangent * cos * cos * cos;
        slopes[2] = -cos * tangent;
    } else {
        slopes[0] = -1;
    }
}

}  // namespace semmap::shapes
