#include "ends.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>

#include "statistics.hpp"

namespace semmap::shapes {
namespace {

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

}  // namespace

std::vector<FlatFace> flat_faces(ShapeKind kind) {
    switch (kind) {
        case ShapeKind::sphere:
            return {};
        case ShapeKind::cylinder:
            return {{1, 1, 2, -1}, {2, 2, 2, 1}};
        case ShapeKind::cone:
            return {{1, 1, 2, -1}};
        case ShapeKind::cuboid:
            break;
    }
    return {{0, 0, 0, -1}, {1, 1, 1, -1}, {2, 2, 2, -1}, {3, 3, 0, 1}, {4, 4, 1, 1}, {5, 5, 2, 1}};
}

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
    for (const auto& [face, bound, axis, side] : flat) {
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
        shape.bounds[bound] = side * value;
        ends.push_back({bound, axis, deviation});
    }
    return ends;
}

}  // namespace semmap::shapes
