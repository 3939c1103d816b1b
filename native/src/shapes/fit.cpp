// Gauss-Newton steps with weights on the faces that points show. A shape ends on faces that no
// points show at the table, or where the points beside end.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "faces.hpp"

namespace semmap::shapes {
namespace {

// The quantile of at least one number, interpolated between neighbours.
double quantile(std::vector<double>& numbers, double share) {
    const double at = share * static_cast<double>(numbers.size() - 1);
    const auto low = static_cast<std::ptrdiff_t>(at);
    const auto middle = numbers.begin() + low;
    std::nth_element(numbers.begin(), middle, numbers.end());
    if (middle + 1 == numbers.end()) return *middle;
    const double next = *std::min_element(middle + 1, numbers.end());
    return *middle + (at - static_cast<double>(low)) * (next - *middle);
}

double median(std::vector<double>& numbers) { return quantile(numbers, 0.5); }

constexpr std::size_t kAcrossNone = 3;

// A flat face, which has the bound of its number: the axis and the side that it is across.
struct FlatFace {
    std::size_t face;
    std::size_t axis;
    double side;
};

// A bound that no points are on, and what is known about it.
struct End {
    std::size_t bound;
    std::size_t axis;  // along which the bound moves, or kAcrossNone
    double deviation;
};

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kStands = 0.9659258262890683;  // cos 15 degrees: so level an end is on the table
constexpr double kTableDeviation = 1e-3;        // of the height of a table, metres
constexpr double kWindow = 6;  // widths over which the density beside an edge is counted
constexpr double kFewest = 20;
constexpr double kMostBins = 4096;

// A point on the axis of a shape, in its frame.
Vector middle_of(const PlacedShape& shape) {
    const auto& b = shape.bounds;
    if (shape.kind != ShapeKind::cuboid) return {0, 0, (b[1] + b[2]) / 2};
    return {(b[0] + b[3]) / 2, (b[1] + b[4]) / 2, (b[2] + b[5]) / 2};
}

// Where evenly spread points with noise end, and its standard deviation. The points beyond a line
// are as many as the density inside of it times the distance to the end: noise moves as many over
// the edge as back.
std::pair<double, double> edge(const std::vector<double>& along, double width, double spacing) {
    const auto [first, farthest] = std::minmax_element(along.begin(), along.end());
    const double start = *first, reach = *farthest - *first;
    const auto bins =
        static_cast<std::size_t>(std::clamp(std::trunc(reach / width * 2), 1.0, kMostBins));
    const double per_metre = static_cast<double>(bins) / std::max(reach, 1e-12);
    std::vector<double> count(bins, 0);
    for (const double at : along) {
        ++count[std::min(static_cast<std::size_t>((at - start) * per_metre), bins - 1)];
    }
    std::vector<double> filled;
    for (const double n : count) {
        if (n > 0) filled.push_back(n);
    }
    const double least = 0.3 * median(filled);
    std::size_t full = bins;
    while (count[full - 1] <= least) --full;
    // Beyond the last full bin are outliers.
    const double last = start + reach * static_cast<double>(full) / static_cast<double>(bins);
    const double line = last - width;
    double inside = 0, beyond = 0;
    for (const double at : along) {
        if (at > line - kWindow * width && at <= line) ++inside;
        if (at > line && at < last + width / 2) ++beyond;
    }
    if (inside < 10) return {last, std::max(width, spacing)};
    const double density = inside / (line - std::max(line - kWindow * width, start));
    const double counted = std::sqrt(beyond + beyond * beyond / inside) / density;
    return {line + beyond / density, std::hypot(counted, spacing / std::sqrt(12.0))};
}

// A cylinder of which an end alone is seen: its points fill the circle evenly.
End place_disk(PlacedShape& shape, std::vector<Vector>& points, double noise) {
    double count = 0, x = 0, y = 0;
    const auto is_on = [&](const Vector& p) {
        return std::min(std::abs(p[2] - shape.bounds[1]), std::abs(p[2] - shape.bounds[2])) <
               4 * noise;
    };
    for (const Vector& p : points) {
        if (is_on(p)) ++count, x += p[0], y += p[1];
    }
    if (count == 0) return {0, kAcrossNone, kInfinite};
    const Vector moved = turned_from(shape, {x / count, y / count, 0});
    double squares = 0;
    for (Vector& p : points) {
        p[0] -= x / count;
        p[1] -= y / count;
        if (is_on(p)) squares += p[0] * p[0] + p[1] * p[1];
    }
    for (std::size_t i = 0; i < 3; ++i) shape.origin[i] += moved[i];
    shape.bounds[0] = std::sqrt(2 * std::max(squares / count - 2 * noise * noise, 1e-12));
    return {0, kAcrossNone, shape.bounds[0] / std::sqrt(count)};
}

std::vector<FlatFace> flat_faces(ShapeKind kind) {
    switch (kind) {
        case ShapeKind::sphere:
            return {};
        case ShapeKind::cylinder:
            return {{1, 2, -1}, {2, 2, 1}};
        case ShapeKind::cone:
            return {{1, 2, -1}};
        case ShapeKind::cuboid:
            break;
    }
    return {{0, 0, -1}, {1, 1, -1}, {2, 2, -1}, {3, 0, 1}, {4, 1, 1}, {5, 2, 1}};
}

// Moves the ends of a shape that are not seen and returns them: to the table, or to where the
// points beside end.
std::vector<End> place_ends(PlacedShape& shape, const Seen& seen, const PointsView& cloud,
                            double spacing, double noise, const std::optional<TablePlane>& table) {
    std::vector<End> ends;
    const std::vector<FlatFace> flat = flat_faces(shape.kind);
    const bool disk = shape.kind == ShapeKind::cylinder && !seen[0];
    const auto is_open = [&](const FlatFace& face) { return !seen[face.face]; };
    if (!disk && std::none_of(flat.begin(), flat.end(), is_open)) return ends;
    std::vector<Vector> points(cloud.count);
    for (std::size_t i = 0; i < cloud.count; ++i) points[i] = local(shape, cloud.points[i]);
    if (disk) ends.push_back(place_disk(shape, points, noise));
    std::array<std::size_t, kMostBounds> axis_of;
    axis_of.fill(kAcrossNone);
    for (const FlatFace& face : flat) axis_of[face.face] = face.axis;
    std::vector<Vector> near;  // the points on faces that are seen
    std::vector<std::size_t> across;
    for (const Vector& p : points) {
        const auto [face, distance] = nearest_face(shape, p, seen);
        if (std::abs(distance) >= 4 * noise) continue;
        near.push_back(p);
        across.push_back(axis_of[face]);
    }
    for (const auto& [face, axis, side] : flat) {
        if (seen[face]) continue;
        std::vector<double> along;
        double farthest = 0;
        for (std::size_t i = 0; i < near.size(); ++i) {
            farthest = std::max(farthest, side * near[i][axis]);
            if (across[i] != axis) along.push_back(side * near[i][axis]);
        }
        const double upward = table ? side * dot(shape.axes[axis], table->normal) : 0;
        double value = farthest, deviation = kInfinite;
        if (upward < -kStands) {
            const Vector centre = middle_of(shape);
            const double height = dot(turned_from(shape, centre), table->normal) +
                                  dot(shape.origin, table->normal) - table->offset;
            value = side * centre[axis] - height / upward;
            deviation = kTableDeviation;
        } else if (static_cast<double>(along.size()) >= kFewest) {
            std::tie(value, deviation) = edge(along, 4 * std::max(noise, spacing), spacing);
        }
        shape.bounds[face] = side * value;
        ends.push_back({face, axis, deviation});
    }
    return ends;
}

// The first six unknowns are a motion of the shape in its own frame: translation, rotation vector.
constexpr std::size_t kMotions = 6;
constexpr std::size_t kMostUnknowns = kMotions + kMostBounds;

using Row = std::array<double, kMostUnknowns>;
using Matrix = std::array<Row, kMostUnknowns>;

// The most steps of an iteration, and the part of the noise below which a step is the last.
constexpr std::pair<int, double> kRough{2, 0.3}, kFine{4, 0.02};

constexpr double kFarthest = 1e3;  // metres: no size of an object

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
    Seen seen{};
    std::array<double, kMostBounds> count{};
    for (std::size_t i = 0; i < cloud.count; ++i) {
        const Vector p = local(shape, cloud.points[i]);
        const auto [face, distance] = nearest_face(shape, p, kEveryFace);
        if (std::abs(distance) >= 3 * scale) continue;
        const Vector normal = turned_to(shape, cloud.normals[i]);
        if (std::abs(dot(face_normal(shape, p, face), normal)) > 0.85) ++count[face];
    }
    const double fewest = std::max(10.0, 0.02 * static_cast<double>(cloud.count));
    for (std::size_t face = 0; face < counts(shape.kind).faces; ++face) {
        seen[face] = count[face] >= fewest;
    }
    const std::vector<FlatFace> flat = flat_faces(shape.kind);
    for (const auto& [low, axis, side] : flat) {
        for (const auto& [high, same_axis, other_side] : flat) {
            if (axis != same_axis || side >= other_side) continue;
            // A thin view could be of either face.
            if (seen[low] && seen[high] && shape.bounds[high] - shape.bounds[low] < 4 * scale) {
                seen[count[low] < count[high] ? low : high] = false;
            }
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
    const std::size_t unknowns = kMotions + counts(shape.kind).bounds;
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
    for (std::size_t b = 0; b < counts(shape.kind).bounds; ++b) {
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
    const std::size_t unknowns = kMotions + counts(shape.kind).bounds;
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
    for (std::size_t size = 0; size < counts(shape.kind).sizes; ++size) {
        Row row{};
        std::copy(gradient[size].begin(), gradient[size].end(), row.begin() + kMotions);
        const Row answer = solved(known, row, unknowns);
        double variance = 0;
        for (std::size_t a = 0; a < unknowns; ++a) variance += row[a] * answer[a];
        found[size] = std::sqrt(variance);
        for (const End& end : ends) {
            if (std::isinf(end.deviation) && gradient[size][end.bound] != 0) {
                found[size] = kInfinite;
            }
        }
    }
    return found;
}

// Whether no step diverged.
bool is_usable(const PlacedShape& shape) {
    for (std::size_t b = 0; b < counts(shape.kind).bounds; ++b) {
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
                solved(equations.normal, equations.right, kMotions + counts(shape.kind).bounds);
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
