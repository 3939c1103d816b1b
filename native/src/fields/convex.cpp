#include "convex.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace semmap::fields {
namespace {

constexpr double kMostVoxel = kFarthestVoxel;
constexpr const char* kTooFar =
    "a region or a point lies beyond 2^30 voxels from the origin: take larger voxels, or a nearer "
    "frame";
constexpr double kRoundness = 0.01;  // voxels by which a prism around a circle exceeds it
constexpr std::size_t kMostEdgePairs = 64;

struct Ends {
    double low[64];
    double high[64];
};

struct Columns {
    std::int32_t low[64];
    std::int32_t high[64];
};

#define SEMMAP_BODY "columns.inc"
#include "families.inc"

std::pair<double, double> extent(const std::vector<Vector>& corners, const Vector& n) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (const Vector& corner : corners) {
        const double at = n.dot(corner);
        low = std::min(low, at);
        high = std::max(high, at);
    }
    return {low, high};
}

// The least width over directions, and the direction.
struct Width {
    double size = std::numeric_limits<double>::infinity();
    Vector direction{1, 0, 0};

    void take(const std::vector<Vector>& corners, const std::optional<Vector>& n) {
        if (!n) return;
        const auto [low, high] = extent(corners, *n);
        if (high - low >= size) return;
        size = high - low;
        direction = *n;
    }
};

const Vector kAxes[] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

Vector widths(const Polytope& p) {
    Width least;
    for (const Vector& n : p.normals) least.take(p.corners, n);
    for (const Vector& n : kAxes) least.take(p.corners, n);
    const std::size_t few = std::min(p.edges.size(), kMostEdgePairs);
    for (std::size_t i = 0; i < few; ++i) {
        for (std::size_t j = i + 1; j < few; ++j) {
            const auto a = unit(p.edges[i]);
            const auto b = unit(p.edges[j]);
            if (a && b) least.take(p.corners, unit(a->cross(*b)));
        }
    }
    Width next;
    for (const Vector& edge : p.edges) next.take(p.corners, unit(least.direction.cross(edge)));
    for (const Vector& axis : kAxes) next.take(p.corners, unit(least.direction.cross(axis)));
    Width last;
    last.take(p.corners, unit(least.direction.cross(next.direction)));
    return {least.size, next.size, last.size};
}

CoordBBox centres_within(const Vector& low, const Vector& high) {
    return {Coord::ceil(checked(low - Vector(0.5 + kTolerance))),
            Coord::floor(checked(high - Vector(0.5 - kTolerance)))};
}

Convex by_centres(const Polytope& p) {
    Convex solid;
    const auto [low, high] = box_of(p.corners);
    solid.bounds = centres_within(low, high);
    for (const Vector& n : p.normals) {
        solid.half_spaces.push_back({n, extent(p.corners, n).second + kTolerance});
    }
    return solid;
}

// Points on a circle, and directions along its edges.
void circle(const Vector& center, const Vector& axis, double radius, double voxel_size,
            std::vector<Vector>& around, std::vector<Vector>& tangents,
            std::vector<Vector>& outwards) {
    const Vector helper = std::abs(axis[2]) < 0.9 ? Vector{0, 0, 1} : Vector{1, 0, 0};
    const Vector a = *unit(axis.cross(helper));
    const Vector b = axis.cross(a);
    const double voxels = radius / voxel_size;
    const int sides = std::clamp(
        static_cast<int>(std::ceil(M_PI * std::sqrt(voxels / (2 * kRoundness)))), 16, 512);
    const double outer = radius / std::cos(M_PI / sides);
    for (int i = 0; i < sides; ++i) {
        const double at = 2 * M_PI * i / sides;
        const double middle = at + M_PI / sides;
        around.push_back(center + outer * (std::cos(at) * a + std::sin(at) * b));
        tangents.push_back(std::cos(middle) * b - std::sin(middle) * a);
        outwards.push_back(std::cos(middle) * a + std::sin(middle) * b);
    }
}

// How far a disk reaches along each coordinate axis.
Vector reach_of_disk(const Vector& axis, double radius) {
    Vector reach;
    for (int k = 0; k < 3; ++k) {
        reach[k] = radius * std::sqrt(std::max(0.0, 1 - axis[k] * axis[k]));
    }
    return reach;
}

// Clips the interval of z of one column to the inside of the quadric.
void clip(const Quadric& q, double x, double y, double& low, double& high) {
    const double dx = x - q.center[0];
    const double dy = y - q.center[1];
    const double flat = dx * dx + dy * dy;
    const Vector& u = q.axis;
    const double s = u[0] * dx + u[1] * dy;
    const double across = u[0] * u[0] + u[1] * u[1];
    // a z^2 + 2 b z + c <= 0, with z relative to the center.
    double a;
    double b = -u[2] * s;
    double c;
    double discriminant;
    if (q.kind == Quadric::Kind::cylinder) {
        a = across;
        c = flat - s * s - q.number;
        discriminant = a * (q.number - flat) + s * s;
        if (a < 1e-15) {
            if (c > 0) high = low - 1;
            return;
        }
    } else {
        a = q.number - u[2] * u[2];
        c = q.number * flat - s * s;
        discriminant = q.number * (s * s - a * flat);
    }
    if (discriminant < 0) {
        high = low - 1;
        return;
    }
    // Parallel to the cone: within it beyond one end, or never.
    if (a == 0 && (b * u[2] > 0 || (b == 0 && c > 0))) {
        high = low - 1;
        return;
    }
    const double root = -(b + std::copysign(std::sqrt(discriminant), b));
    double one = root / a;
    double two = root == 0 ? 0 : c / root;
    if (a == 0) one = two;
    const double least = q.center[2] + std::min(one, two);
    const double most = q.center[2] + std::max(one, two);
    if (a > 0) {
        low = std::max(low, least);
        high = std::min(high, most);
    } else if (u[2] > 0) {
        low = std::max(low, most);
    } else {
        high = std::min(high, least);
    }
}

void general_columns(const Convex& solid, std::int32_t x, std::int32_t y, Ends& ends) {
    std::fill(std::begin(ends.low), std::end(ends.low), 1e30);
    std::fill(std::begin(ends.high), std::end(ends.high), -1e30);
    const Coord first = solid.bounds.min();
    const Coord last = solid.bounds.max();
    const int first_i = std::max(first.x() - x, 0);
    const int last_i = std::min(last.x() - x, 7);
    const int first_j = std::max(first.y() - y, 0);
    const int last_j = std::min(last.y() - y, 7);
    for (int i = first_i; i <= last_i; ++i) {
        for (int j = first_j; j <= last_j; ++j) {
            const double px = x + i + 0.5;
            const double py = y + j + 0.5;
            double low = first.z();
            double high = last.z() + 1.0;
            for (const HalfSpace& h : solid.half_spaces) {
                const double rest = h.d - h.n[0] * px - h.n[1] * py;
                if (h.n[2] > 1e-15) {
                    high = std::min(high, rest / h.n[2]);
                } else if (h.n[2] < -1e-15) {
                    low = std::max(low, rest / h.n[2]);
                } else if (rest < 0) {
                    high = low - 1;
                }
                if (high < low) break;
            }
            if (high >= low && solid.quadric.kind != Quadric::Kind::none) {
                clip(solid.quadric, px, py, low, high);
            }
            if (high >= low) {
                ends.low[8 * i + j] = low;
                ends.high[8 * i + j] = high;
            }
        }
    }
}

template <typename Sink>
void walk(const Convex& solid, Sink&& sink) {
    const Coord first = solid.bounds.min();
    const Coord last = solid.bounds.max();
    const double work = work_of(solid);
    if (work == 0) return;
    expect_little(work);
    const Family family = used_family();
    for (std::int32_t x = block_floor(first.x()); x <= last.x(); x += kBlock) {
        for (std::int32_t y = block_floor(first.y()); y <= last.y(); y += kBlock) {
            Ends ends;
            if (solid.quadric.kind == Quadric::Kind::ball) {
                SEMMAP_CALL(family, ball_columns(solid.quadric, x, y, ends));
            } else {
                general_columns(solid, x, y, ends);
            }
            Columns columns;
            SEMMAP_CALL(family, round_columns(ends, first.z(), last.z(), columns));
            std::int32_t lowest = last.z() + 1;
            std::int32_t highest = first.z() - 1;
            std::int32_t full_from = first.z();
            std::int32_t full_to = last.z();
            bool whole = true;
            for (int i = 0; i < 64; ++i) {
                if (columns.low[i] > columns.high[i]) {
                    whole = false;
                    columns.low[i] = last.z() + 1;
                    columns.high[i] = first.z() - 1;
                    continue;
                }
                lowest = std::min(lowest, columns.low[i]);
                highest = std::max(highest, columns.high[i]);
                full_from = std::max(full_from, columns.low[i]);
                full_to = std::min(full_to, columns.high[i]);
            }
            for (std::int32_t z = block_floor(lowest); z <= highest; z += kBlock) {
                Words words;
                if (whole && z >= full_from && z + (kBlock - 1) <= full_to) {
                    words.fill(~std::uint64_t{0});
                } else {
                    SEMMAP_CALL(family, block_words(columns, z, words));
                    if (is_empty(words)) continue;
                }
                sink(Coord(x, y, z), words);
            }
        }
    }
}

}  // namespace

double work_of(const Convex& solid) {
    if (solid.bounds.empty()) return 0;
    const Vector size = solid.bounds.max().asVec3d() - solid.bounds.min().asVec3d() + Vector(1);
    return size[0] * size[1] * static_cast<double>(solid.half_spaces.size() + 1);
}

void expect_little(double work) {
    const auto most = static_cast<double>(region_limits().voxels.load(std::memory_order_relaxed));
    if (work > most) {
        throw BadRegion(
            "the region spans too many columns of voxels: take larger voxels, or a smaller region "
            "(SEMMAP_MAX_REGION_VOXELS raises the limit)");
    }
}

const Vector& checked(const Vector& point) {
    for (int k = 0; k < 3; ++k) {
        if (!(std::abs(point[k]) < kMostVoxel)) throw BadRegion(kTooFar);
    }
    return point;
}

std::optional<Vector> unit(const Vector& v) {
    const double length = v.length();
    if (!(length > 1e-12)) return std::nullopt;
    return v / length;
}

std::vector<Vector> scaled(std::vector<Vector> points, double voxel_size) {
    for (Vector& point : points) point /= voxel_size;
    return points;
}

void voxel_indices(const double* p, std::size_t count, double voxel_size, std::int32_t* out) {
    const Family family = used_family();
    if (!SEMMAP_CALL(family, voxel_indices(p, count, voxel_size, out))) throw BadRegion(kTooFar);
}

bool is_thin(const Vector& widths) {
    const Vector w = widths.sorted();
    // With a tolerance: a solid that is a voxel wide up to rounding is not thin.
    return w[0] < 1 - kTolerance || w[1] < std::sqrt(2.0) - kTolerance ||
           w[2] < std::sqrt(3.0) - kTolerance;
}

CoordBBox voxels_met(const Vector& low, const Vector& high) {
    const Coord first = Coord::floor(checked(low + Vector(kTolerance)));
    const Coord last = Coord::floor(checked(high - Vector(kTolerance)));
    return {first, Coord::maxComponent(first, last)};
}

Convex convex(const Ball& ball, double voxel_size) {
    Convex solid;
    const double r = ball.radius / voxel_size;
    const Vector center = ball.center / voxel_size;
    solid.quadric = {Quadric::Kind::ball, center, {}, r * r};
    solid.bounds = centres_within(center - Vector(r), center + Vector(r));
    return solid;
}

Convex convex(const Cylinder& cylinder, double voxel_size) {
    Convex solid;
    const Vector& u = cylinder.axis;
    const double r = cylinder.radius / voxel_size;
    const double half = cylinder.height / voxel_size / 2;
    const Vector center = cylinder.center / voxel_size;
    const Vector reach = half * Abs(u) + reach_of_disk(u, r);
    solid.quadric = {Quadric::Kind::cylinder, center, u, (r + kTolerance) * (r + kTolerance)};
    const double at = u.dot(center);
    solid.half_spaces = {{u, at + half + kTolerance}, {-u, half - at + kTolerance}};
    solid.bounds = centres_within(center - reach, center + reach);
    return solid;
}

Convex convex(const Cone& cone, double voxel_size) {
    Convex solid;
    const Vector& u = cone.axis;
    const double height = cone.height / voxel_size;
    const Vector apex = cone.apex / voxel_size;
    const Vector base = apex + height * u;
    const Vector reach = reach_of_disk(u, height * std::tan(cone.half_angle));
    const double cosine = std::cos(cone.half_angle);
    solid.quadric = {Quadric::Kind::cone, apex, u, cosine * cosine};
    const double at = u.dot(apex);
    solid.half_spaces = {{u, at + height + kTolerance}, {-u, kTolerance - at}};
    solid.bounds =
        centres_within(minComponent(apex, base - reach), maxComponent(apex, base + reach));
    return solid;
}

// The sum of a polytope and a voxel (about the voxel's centre): its facets are those of either, or
// lie along an edge of each.
Convex meeting(const Polytope& p) {
    Convex solid;
    const auto [first, last] = box_of(p.corners);
    solid.bounds = voxels_met(first, last);
    const auto add = [&](const Vector& n) {
        const double reach = (std::abs(n[0]) + std::abs(n[1]) + std::abs(n[2])) / 2;
        const auto [low, high] = extent(p.corners, n);
        solid.half_spaces.push_back({n, high + reach + kTolerance});
        solid.half_spaces.push_back({-n, reach - low + kTolerance});
    };
    for (const Vector& n : p.normals) add(n);
    for (const Vector& edge : p.edges) {
        for (const Vector& axis : kAxes) {
            if (const auto n = unit(edge.cross(axis))) add(*n);
        }
    }
    return solid;
}

Voxels polytope_voxels(const Polytope& polytope, double voxel_size) {
    const Polytope p{scaled(polytope.corners, voxel_size), polytope.normals, polytope.edges};
    if (!is_thin(widths(p))) {
        Voxels voxels = rasterise_convex(by_centres(p));
        if (voxels.blocks() > 0) return voxels;
    }
    return rasterise_convex(meeting(p));
}

Polytope prism_around(const Cylinder& cylinder, double voxel_size) {
    Polytope prism;
    std::vector<Vector> ring;
    circle(Vector(0), cylinder.axis, cylinder.radius, voxel_size, ring, prism.edges, prism.normals);
    for (const double end : {-0.5, 0.5}) {
        const Vector middle = cylinder.center + end * cylinder.height * cylinder.axis;
        for (const Vector& p : ring) prism.corners.push_back(middle + p);
    }
    prism.edges.push_back(cylinder.axis);
    prism.normals.push_back(cylinder.axis);
    prism.normals.push_back(-cylinder.axis);
    return prism;
}

Polytope pyramid_around(const Cone& cone, double voxel_size) {
    Polytope pyramid;
    std::vector<Vector> outwards;
    const Vector base = cone.apex + cone.height * cone.axis;
    circle(base, cone.axis, cone.height * std::tan(cone.half_angle), voxel_size, pyramid.corners,
           pyramid.edges, outwards);
    for (const Vector& corner : pyramid.corners) {
        if (const auto edge = unit(corner - cone.apex)) pyramid.edges.push_back(*edge);
    }
    const double c = std::cos(cone.half_angle);
    const double s = std::sin(cone.half_angle);
    for (const Vector& out : outwards) pyramid.normals.push_back(c * out - s * cone.axis);
    pyramid.normals.push_back(cone.axis);
    pyramid.corners.push_back(cone.apex);
    return pyramid;
}

Voxels rasterise_convex(const Convex& solid) {
    Voxels voxels;
    walk(solid, [&](const Coord& origin, const Words& words) {
        expect_few(voxels.blocks());
        voxels.append(origin, words);
    });
    return voxels;
}

void rasterise_convex(const Convex& solid, VoxelCollector& into) {
    walk(solid, [&](const Coord& origin, const Words& words) { into.add(origin, words); });
}

}  // namespace semmap::fields
