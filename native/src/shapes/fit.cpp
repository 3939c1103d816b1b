// Gauss-Newton steps with weights on the faces that points show.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "ends.hpp"
#include "faces.hpp"
#include "statistics.hpp"

namespace semmap::shapes {
namespace {

// The first six unknowns are a motion of the shape in its own frame: translation, rotation vector.
constexpr std::size_t kMotions = 6;
constexpr std::size_t kMostUnknowns = kMotions + kMostBounds;

using Row = std::array<double, kMostUnknowns>;
using Matrix = std::array<Row, kMostUnknowns>;

// The most steps of an iteration, and the part of the noise below which a step is the last.
struct Patience {
    int steps;
    double end;
};
constexpr Patience kRough{2, 0.3}, kFine{4, 0.02};

constexpr double kFarthest = 1e3;  // metres: no size of an object

// Two flat faces that are parallel.
struct Opposite {
    std::size_t low;
    std::size_t high;
};

std::vector<Opposite> opposite_faces(ShapeKind kind) {
    if (kind == ShapeKind::cylinder) return {{1, 2}};
    if (kind == ShapeKind::cuboid) return {{0, 3}, {1, 4}, {2, 5}};
    return {};
}

double diameter(const SurfelsView& cloud) {
    Vector low = cloud.points[0], high = low;
    for (std::size_t i = 0; i < cloud.count; ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], cloud.points[i][k]);
            high[k] = std::max(high[k], cloud.points[i][k]);
        }
    }
    return std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
}

// Sets bounds along the axis from the points near the shape.
void set_first_ends(PlacedShape& shape, const SurfelsView& cloud, double scale) {
    const bool cone = shape.kind == ShapeKind::cone;
    std::vector<double> z;
    for (std::size_t i = 0; i < cloud.count; ++i) {
        const Vector p = local(shape, cloud.points[i]);
        const double radius = cone ? shape.bounds[0] * -p[2] : shape.bounds[0];
        if (from_axis(p) < radius + 3 * scale) z.push_back(p[2]);
    }
    shape.bounds[1] = z.empty() ? (cone ? -1e-3 : 0) : quantile(z, 0.01);
    shape.bounds[2] = z.empty() || cone ? 0 : quantile(z, 0.99);
}

// Which faces have points on them with normals across them.
Seen seen_faces(const PlacedShape& shape, const SurfelsView& cloud, double scale) {
    Seen every, seen{};
    every.fill(true);
    std::array<double, kMostBounds> count{};
    for (std::size_t i = 0; i < cloud.count; ++i) {
        const Vector p = local(shape, cloud.points[i]);
        const auto [face, distance] = nearest_face(shape, p, every);
        if (std::abs(distance) >= 3 * scale) continue;
        const Vector normal = turned_to(shape, cloud.normals[i]);
        if (std::abs(dot(face_normal(shape, p, face), normal)) > 0.85) ++count[face];
    }
    const double fewest = std::max(10.0, 0.02 * static_cast<double>(cloud.count));
    for (std::size_t face = 0; face < face_count(shape.kind); ++face) {
        seen[face] = count[face] >= fewest;
    }
    for (const auto& [low, high] : opposite_faces(shape.kind)) {
        // A thin view could be of either face.
        if (seen[low] && seen[high] && shape.bounds[high] - shape.bounds[low] < 4 * scale) {
            seen[count[low] < count[high] ? low : high] = false;
        }
    }
    return seen;
}

// The weighted normal equations, and the distances of the points.
struct Equations {
    Matrix normal{};
    Row right{};
    std::vector<double> residuals;
};

void build(Equations& equations, const PlacedShape& shape, const SurfelsView& cloud,
           const Seen& seen, double scale) {
    const std::size_t unknowns = kMotions + bound_count(shape.kind);
    equations.normal = {};
    equations.right = {};
    equations.residuals.clear();
    for (std::size_t i = 0; i < cloud.count; ++i) {
        const Vector p = local(shape, cloud.points[i]);
        const auto [face, residual] = nearest_face(shape, p, seen);
        const Vector normal = face_normal(shape, p, face);
        const double across = dot(normal, turned_to(shape, cloud.normals[i]));
        const double far = residual / (2 * scale);
        const double cauchy = 1 / (1 + far * far);
        const double weight = across * across * across * across * cauchy * cauchy;
        const Vector turn = cross(normal, p);
        Row row{};
        for (std::size_t k = 0; k < 3; ++k) row[k] = -normal[k], row[3 + k] = turn[k];
        write_slopes(shape, p, face, row.data() + kMotions);
        for (std::size_t a = 0; a < unknowns; ++a) {
            const double weighted = weight * row[a];
            if (weighted == 0) continue;
            for (std::size_t b = 0; b <= a; ++b) equations.normal[a][b] += weighted * row[b];
            equations.right[a] += weighted * residual;
        }
        equations.residuals.push_back(std::abs(residual));
    }
    double trace = 0;
    for (std::size_t a = 0; a < unknowns; ++a) trace += equations.normal[a][a];
    for (std::size_t a = 0; a < unknowns; ++a) equations.normal[a][a] += 1e-7 * trace + 1e-12;
}

// Solves a positive definite system, of which the lower half is given, by Cholesky's method.
Row solved(Matrix lower, Row right, std::size_t unknowns) {
    for (std::size_t a = 0; a < unknowns; ++a) {
        for (std::size_t b = 0; b <= a; ++b) {
            for (std::size_t c = 0; c < b; ++c) lower[a][b] -= lower[a][c] * lower[b][c];
            lower[a][b] = a == b ? std::sqrt(lower[a][a]) : lower[a][b] / lower[b][b];
        }
    }
    for (std::size_t a = 0; a < unknowns; ++a) {
        for (std::size_t b = 0; b < a; ++b) right[a] -= lower[a][b] * right[b];
        right[a] /= lower[a][a];
    }
    for (std::size_t a = unknowns; a-- > 0;) {
        for (std::size_t b = a + 1; b < unknowns; ++b) right[a] -= lower[b][a] * right[b];
        right[a] /= lower[a][a];
    }
    return right;
}

void move(PlacedShape& shape, const Row& step) {
    const Vector shift = turned_from(shape, {step[0], step[1], step[2]});
    Vector half;
    for (std::size_t k = 0; k < 3; ++k) {
        shape.origin[k] += shift[k];
        half[k] = std::clamp(step[3 + k], -0.5, 0.5) / 2;
    }
    // Cayley's map, a rotation: (1 - [half])^-1 (1 + [half]).
    const double scale = 2 / (1 + dot(half, half));
    const std::array<Vector, 3> axes = shape.axes;
    for (std::size_t k = 0; k < 3; ++k) {
        Vector unit{};
        unit[k] = 1;
        const Vector once = cross(half, unit), twice = cross(half, once);
        for (std::size_t i = 0; i < 3; ++i) unit[i] += scale * (once[i] + twice[i]);
        for (std::size_t i = 0; i < 3; ++i) {
            shape.axes[k][i] = 0;
            for (std::size_t j = 0; j < 3; ++j) shape.axes[k][i] += axes[j][i] * unit[j];
        }
    }
    for (std::size_t b = 0; b < bound_count(shape.kind); ++b) {
        shape.bounds[b] += step[kMotions + b];
    }
}

// The derivatives of each size by the bounds.
std::array<std::array<double, kMostBounds>, 3> size_gradient(const PlacedShape& shape) {
    const auto& b = shape.bounds;
    switch (shape.kind) {
        case ShapeKind::sphere:
            return {{{1}}};
        case ShapeKind::cylinder:
            return {{{1}, {0, -1, 1}}};
        case ShapeKind::cone:
            return {{{b[2] - b[1], -b[0], b[0]}, {0, -1, 1}}};
        case ShapeKind::cuboid:
            break;
    }
    return {{{-1, 0, 0, 1}, {0, -1, 0, 0, 1}, {0, 0, -1, 0, 0, 1}}};
}

// Standard deviations of the sizes, by the normal equations of points and ends.
std::array<double, 3> deviations(const PlacedShape& shape, const Matrix& normal, double noise,
                                 const std::vector<End>& ends) {
    const std::size_t unknowns = kMotions + bound_count(shape.kind);
    Matrix known = normal;
    for (Row& row : known) {
        for (double& number : row) number /= noise * noise;
    }
    for (const auto& [bound, axis, deviation] : ends) {
        const double weight = 1 / (deviation * deviation);  // 0 where nothing is known
        known[kMotions + bound][kMotions + bound] += weight;
        if (axis == kAcrossNone) continue;
        known[axis][axis] += weight;
        known[kMotions + bound][axis] += weight;
    }
    for (std::size_t a = 0; a < unknowns; ++a) known[a][a] += 1;  // known to a metre at least
    const auto gradient = size_gradient(shape);
    std::array<double, 3> found{};
    for (std::size_t size = 0; size < size_count(shape.kind); ++size) {
        Row row{};
        std::copy(gradient[size].begin(), gradient[size].end(), row.begin() + kMotions);
        const Row answer = solved(known, row, unknowns);
        double variance = 0;
        for (std::size_t a = 0; a < unknowns; ++a) variance += row[a] * answer[a];
        found[size] = std::sqrt(variance);
        for (const End& end : ends) {
            if (std::isinf(end.deviation) && gradient[size][end.bound] != 0) {
                found[size] = std::numeric_limits<double>::infinity();
            }
        }
    }
    return found;
}

// Whether no step diverged.
bool is_usable(const PlacedShape& shape) {
    for (std::size_t b = 0; b < bound_count(shape.kind); ++b) {
        if (!(std::abs(shape.bounds[b]) <= kFarthest)) return false;
    }
    return std::isfinite(dot(shape.origin, shape.origin)) &&
           std::isfinite(shape.axes[0][0] + shape.axes[1][1] + shape.axes[2][2]);
}

}  // namespace

std::optional<FittedShape> fit_shape(const PlacedShape& rough, const SurfelsView& cloud,
                                     const PointsView& whole, double noise,
                                     const std::optional<TablePlane>& table, int turns) {
    PlacedShape shape = rough;
    double scale = std::max(2 * noise, 0.02 * diameter(cloud));
    if (shape.kind == ShapeKind::cylinder || shape.kind == ShapeKind::cone) {
        set_first_ends(shape, cloud, scale);
    }
    const auto [steps, end] = turns == 1 ? kRough : kFine;
    Equations equations;
    Seen seen{};
    std::vector<End> ends;
    for (int turn = 0; turn < turns; ++turn) {
        seen = seen_faces(shape, cloud, scale);
        if (std::none_of(seen.begin(), seen.end(), [](bool one) { return one; })) return {};
        for (int i = 0; i < steps; ++i) {
            build(equations, shape, cloud, seen, scale);
            Row step =
                solved(equations.normal, equations.right, kMotions + bound_count(shape.kind));
            double largest = 0;
            for (double& number : step) {
                number = -number;
                largest = std::max(largest, std::abs(number));
            }
            move(shape, step);
            if (!is_usable(shape)) return {};
            if (largest < end * noise) break;
        }
        scale = std::min(scale, std::max(noise, 1.48 * median(equations.residuals)));
        const PointsView points = turn == turns - 1 ? whole : PointsView{cloud.points, cloud.count};
        const double denser =
            std::sqrt(static_cast<double>(cloud.count) / static_cast<double>(points.count));
        ends = place_ends(shape, seen, points, cloud.spacing * denser, noise, table);
        if (!is_usable(shape)) return {};
    }
    return FittedShape{shape, seen, deviations(shape, equations.normal, noise, ends)};
}

}  // namespace semmap::shapes
