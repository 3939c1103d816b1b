// Distances of points to shapes, and how well a shape explains them.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "faces.hpp"

namespace semmap::shapes {
namespace {

constexpr double kTurned = 0.3;  // 1 - cos of the angle of a normal that is as bad as none
constexpr double kFull = 0.9;    // so much of a face is filled at least by even points

using Flat = std::array<double, 2>;

double turn(const Flat& a, const Flat& b, const Flat& c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

// The area of the convex hull (Andrew's monotone chain).
double hull_area(std::vector<Flat>& points) {
    std::sort(points.begin(), points.end());
    double area = 0;
    for (int side = 0; side < 2; ++side) {
        std::vector<Flat> chain;
        for (const Flat& p : points) {
            while (chain.size() > 1 && turn(chain[chain.size() - 2], chain.back(), p) <= 0) {
                chain.pop_back();
            }
            chain.push_back(p);
        }
        for (std::size_t i = 1; i < chain.size(); ++i) {
            area += chain[i - 1][0] * chain[i][1] - chain[i - 1][1] * chain[i][0];
        }
        std::reverse(points.begin(), points.end());
    }
    return area / 2;
}

// The share of the most seen face of a cuboid that points on faces fill; 1 where they have no area.
double filled_share(const PlacedShape& shape, const std::vector<Vector>& points,
                    const std::vector<std::size_t>& faces) {
    std::array<std::size_t, 3> count{};
    for (const std::size_t face : faces) ++count[face % 3];
    const auto axis =
        static_cast<std::size_t>(std::max_element(count.begin(), count.end()) - count.begin());
    const std::size_t u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
    std::vector<Flat> flat;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (faces[i] % 3 == axis) flat.push_back({points[i][u], points[i][v]});
    }
    const auto& b = shape.bounds;
    const double area = flat.empty() ? 0 : hull_area(flat);
    return area > 0 ? area / ((b[u + 3] - b[u]) * (b[v + 3] - b[v])) : 1;
}

}  // namespace

void shape_distances(const PlacedShape& shape, const PointsView& points, double* distances) {
    for (std::size_t i = 0; i < points.count; ++i) {
        distances[i] = nearest_face(shape, local(shape, points.points[i]), kEveryFace).distance;
    }
}

double shape_cost(const PlacedShape& shape, const SurfelsView& cloud, double within) {
    std::vector<Vector> on;
    std::vector<std::size_t> faces;
    double sum = 0;
    for (std::size_t i = 0; i < cloud.count; ++i) {
        const Vector p = local(shape, cloud.points[i]);
        const auto [face, distance] = nearest_face(shape, p, kEveryFace);
        const double across =
            std::abs(dot(face_normal(shape, p, face), turned_to(shape, cloud.normals[i])));
        const double far = distance / within;
        sum += std::max(std::min(far * far, 1.0), 0.5 * std::min((1 - across) / kTurned, 1.0));
        if (shape.kind == ShapeKind::cuboid && std::abs(distance) <= within) {
            on.push_back(p);
            faces.push_back(face);
        }
    }
    const double mean = sum / static_cast<double>(cloud.count);
    if (shape.kind != ShapeKind::cuboid) return mean;
    return mean + std::max(0.0, kFull - filled_share(shape, on, faces));
}

}  // namespace semmap::shapes
