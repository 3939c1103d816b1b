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

#define SEMMAP_FAMILY baseline
#define SEMMAP_TARGET
#include "columns.inc"

#if defined(__x86_64__)
#define SEMMAP_FAMILY avx2
#define SEMMAP_TARGET __attribute__((target("avx2")))
#include "columns.inc"

#define SEMMAP_FAMILY avx512
#define SEMMAP_TARGET __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq")))
#include "columns.inc"
#endif

struct Kernels {
    void (*ball_columns)(const Quadric&, std::int32_t, std::int32_t, Ends&);
    void (*round_columns)(const Ends&, std::int32_t, std::int32_t, Columns&);
    void (*block_words)(const Columns&, std::int32_t, Words&);
    bool (*voxel_indices)(const double*, std::size_t, double, std::int32_t*);
};

Kernels kernels() {
#if defined(__x86_64__)
    const Family family = used_family();
    if (family == Family::avx512) {
        return {avx512::ball_columns, avx512::round_columns, avx512::block_words,
                avx512::voxel_indices};
    }
    if (family == Family::avx2) {
        return {avx2::ball_columns, avx2::round_columns, avx2::block_words, avx2::voxel_indices};
    }
#endif
    return {baseline::ball_columns, baseline::round_columns, baseline::block_words,
            baseline::voxel_indices};
}

double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vector cross(const Vector& a, const Vector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// Returns the unit vector, if the length is not 0.
std::optional<Vector> unit(const Vector& v) {
    const double length = std::sqrt(dot(v, v));
    if (!(length > 1e-12)) return std::nullopt;
    return Vector{v[0] / length, v[1] / length, v[2] / length};
}

double extent(const std::vector<Vector>& corners, const Vector& n, double& low) {
    double high = -std::numeric_limits<double>::infinity();
    low = std::numeric_limits<double>::infinity();
    for (const Vector& corner : corners) {
        const double at = dot(n, corner);
        high = std::max(high, at);
        low = std::min(low, at);
    }
    return high;
}

double width(const std::vector<Vector>& corners, const Vector& n) {
    double low;
    const double high = extent(corners, n, low);
    return high - low;
}

// The least width over directions, and the direction.
struct Width {
    double size = std::numeric_limits<double>::infinity();
    Vector direction{1, 0, 0};

    void take(const std::vector<Vector>& corners, const std::optional<Vector>& n) {
        if (!n) return;
        const double here = width(corners, *n);
        if (here < size) {
            size = here;
            direction = *n;
        }
    }
};

std::array<double, 3> widths(const Polytope& p) {
    constexpr Vector axes[] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    Width least;
    for (const Vector& n : p.normals) least.take(p.corners, n);
    for (const Vector& n : axes) least.take(p.corners, n);
    const std::size_t few = std::min(p.edges.size(), kMostEdgePairs);
    for (std::size_t i = 0; i < few; ++i) {
        for (std::size_t j = i + 1; j < few; ++j) {
            const auto a = unit(p.edges[i]);
            const auto b = unit(p.edges[j]);
            if (a && b) least.take(p.corners, unit(cross(*a, *b)));
        }
    }
    Width next;
    for (const Vector& edge : p.edges) next.take(p.corners, unit(cross(least.direction, edge)));
    for (const Vector& axis : axes) next.take(p.corners, unit(cross(least.direction, axis)));
    Width last;
    last.take(p.corners, unit(cross(least.direction, next.direction)));
    return {least.size, next.size, last.size};
}

Polytope scaled(const Polytope& polytope, double voxel_size) {
    Polytope p = polytope;
    for (Vector& corner : p.corners) {
        for (double& v : corner) v /= voxel_size;
    }
    return p;
}

void box_of(const std::vector<Vector>& corners, Vector& low, Vector& high) {
    for (std::size_t k = 0; k < 3; ++k) {
        Vector axis{};
        axis[k] = 1;
        high[k] = extent(corners, axis, low[k]);
    }
}

Bounds centres_within(const Vector& low, const Vector& high) {
    Bounds bounds;
    for (std::size_t k = 0; k < 3; ++k) {
        bounds.low[k] = checked_index(std::ceil(low[k] - 0.5 - kTolerance));
        bounds.high[k] = checked_index(std::floor(high[k] - 0.5 + kTolerance));
    }
    return bounds;
}

// A face that lies on a border between voxels belongs to one side of it.
Bounds voxels_met(const Vector& low, const Vector& high) {
    Bounds bounds;
    for (std::size_t k = 0; k < 3; ++k) {
        bounds.low[k] = checked_index(std::floor(low[k] + kTolerance));
        bounds.high[k] = std::max(bounds.low[k], checked_index(std::floor(high[k] - kTolerance)));
    }
    return bounds;
}

Convex by_centres(const Polytope& p) {
    Convex solid;
    Vector low;
    Vector high;
    box_of(p.corners, low, high);
    solid.bounds = centres_within(low, high);
    for (const Vector& n : p.normals) {
        double least;
        solid.half_spaces.push_back({n, extent(p.corners, n, least) + kTolerance});
    }
    return solid;
}

// Points on a circle, and directions along its edges.
void circle(const Vector& center, const Vector& axis, double radius, double voxel_size,
            std::vector<Vector>& around, std::vector<Vector>& tangents,
            std::vector<Vector>& outwards) {
    const Vector helper = std::abs(axis[2]) < 0.9 ? Vector{0, 0, 1} : Vector{1, 0, 0};
    const Vector a = *unit(cross(axis, helper));
    const Vector b = cross(axis, a);
    const double voxels = radius / voxel_size;
    const int sides = std::clamp(
        static_cast<int>(std::ceil(M_PI * std::sqrt(voxels / (2 * kRoundness)))), 16, 512);
    const double outer = radius / std::cos(M_PI / sides);
    for (int i = 0; i < sides; ++i) {
        const double at = 2 * M_PI * i / sides;
        const double middle = at + M_PI / sides;
        Vector point;
        Vector tangent;
        Vector outward;
        for (std::size_t k = 0; k < 3; ++k) {
            point[k] = center[k] + outer * (std::cos(at) * a[k] + std::sin(at) * b[k]);
            tangent[k] = std::cos(middle) * b[k] - std::sin(middle) * a[k];
            outward[k] = std::cos(middle) * a[k] + std::sin(middle) * b[k];
        }
        around.push_back(point);
        tangents.push_back(tangent);
        outwards.push_back(outward);
    }
}

Vector along(const Vector& from, const Vector& axis, double distance) {
    return {from[0] + distance * axis[0], from[1] + distance * axis[1],
            from[2] + distance * axis[2]};
}

Vector negative(const Vector& v) { return {-v[0], -v[1], -v[2]}; }

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
    const int first_i = std::max(solid.bounds.low[0] - x, 0);
    const int last_i = std::min(solid.bounds.high[0] - x, 7);
    const int first_j = std::max(solid.bounds.low[1] - y, 0);
    const int last_j = std::min(solid.bounds.high[1] - y, 7);
    for (int i = first_i; i <= last_i; ++i) {
        for (int j = first_j; j <= last_j; ++j) {
            const double px = x + i + 0.5;
            const double py = y + j + 0.5;
            double low = solid.bounds.low[2];
            double high = solid.bounds.high[2] + 1.0;
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
    const Bounds& bounds = solid.bounds;
    const double work = work_of(solid);
    if (work == 0) return;
    expect_little(work);
    const Kernels kernel = kernels();
    for (std::int32_t x = block_floor(bounds.low[0]); x <= bounds.high[0]; x += kBlock) {
        for (std::int32_t y = block_floor(bounds.low[1]); y <= bounds.high[1]; y += kBlock) {
            Ends ends;
            if (solid.quadric.kind == Quadric::Kind::ball) {
                kernel.ball_columns(solid.quadric, x, y, ends);
            } else {
                general_columns(solid, x, y, ends);
            }
            Columns columns;
            kernel.round_columns(ends, bounds.low[2], bounds.high[2], columns);
            std::int32_t lowest = std::numeric_limits<std::int32_t>::max();
            std::int32_t highest = std::numeric_limits<std::int32_t>::min();
            std::int32_t full_from = lowest;
            std::int32_t full_to = highest;
            bool whole = true;
            for (int i = 0; i < 64; ++i) {
                if (columns.low[i] > columns.high[i]) {
                    whole = false;
                    columns.low[i] = bounds.high[2] + 1;
                    columns.high[i] = bounds.low[2] - 1;
                    continue;
                }
                full_from = lowest == std::numeric_limits<std::int32_t>::max()
                                ? columns.low[i]
                                : std::max(full_from, columns.low[i]);
                full_to = highest == std::numeric_limits<std::int32_t>::min()
                              ? columns.high[i]
                              : std::min(full_to, columns.high[i]);
                lowest = std::min(lowest, columns.low[i]);
                highest = std::max(highest, columns.high[i]);
            }
            if (lowest > highest) continue;
            for (std::int32_t z = block_floor(lowest); z <= highest; z += kBlock) {
                Words words;
                if (whole && z >= full_from && z + (kBlock - 1) <= full_to) {
                    words.fill(~std::uint64_t{0});
                } else {
                    kernel.block_words(columns, z, words);
                    if (is_empty(words)) continue;
                }
                sink(Origin{x, y, z}, words);
            }
        }
    }
}

}  // namespace

double work_of(const Convex& solid) {
    double columns = 1;
    for (std::size_t k = 0; k < 3; ++k) {
        if (solid.bounds.high[k] < solid.bounds.low[k]) return 0;
        if (k == 2) continue;
        columns *= static_cast<double>(solid.bounds.high[k]) - solid.bounds.low[k] + 1;
    }
    return columns * static_cast<double>(solid.half_spaces.size() + 1);
}

void expect_little(double work) {
    const auto most = static_cast<double>(region_limits().voxels.load(std::memory_order_relaxed));
    if (work > most) {
        throw BadRegion(
            "the region spans too many columns of voxels: take larger voxels, or a smaller region "
            "(SEMMAP_MAX_REGION_VOXELS raises the limit)");
    }
}

std::int32_t checked_index(double voxel) {
    if (!(std::abs(voxel) < kMostVoxel)) throw BadRegion(kTooFar);
    return static_cast<std::int32_t>(voxel);
}

void voxel_indices(const double* p, std::size_t count, double voxel_size, std::int32_t* out) {
    const Kernels kernel = kernels();
    if (!kernel.voxel_indices(p, count, voxel_size, out)) throw BadRegion(kTooFar);
}

bool is_thin(std::array<double, 3> w) {
    std::sort(w.begin(), w.end());
    // With a tolerance: a solid that is a voxel wide up to rounding is not thin.
    return w[0] < 1 - kTolerance || w[1] < std::sqrt(2.0) - kTolerance ||
           w[2] < std::sqrt(3.0) - kTolerance;
}

Convex convex(const Ball& ball, double voxel_size) {
    Convex solid;
    const double r = ball.radius / voxel_size;
    Vector low;
    Vector high;
    for (std::size_t k = 0; k < 3; ++k) {
        const double c = ball.center[k] / voxel_size;
        solid.quadric.center[k] = c;
        low[k] = c - r;
        high[k] = c + r;
    }
    solid.quadric.kind = Quadric::Kind::ball;
    solid.quadric.number = r * r;
    solid.bounds = centres_within(low, high);
    return solid;
}

Convex convex(const Cylinder& cylinder, double voxel_size) {
    Convex solid;
    const Vector& u = cylinder.axis;
    const double r = cylinder.radius / voxel_size;
    const double half = cylinder.height / voxel_size / 2;
    Vector low;
    Vector high;
    for (std::size_t k = 0; k < 3; ++k) {
        const double c = cylinder.center[k] / voxel_size;
        const double reach = half * std::abs(u[k]) + r * std::sqrt(std::max(0.0, 1 - u[k] * u[k]));
        solid.quadric.center[k] = c;
        low[k] = c - reach;
        high[k] = c + reach;
    }
    solid.quadric.kind = Quadric::Kind::cylinder;
    solid.quadric.axis = u;
    solid.quadric.number = (r + kTolerance) * (r + kTolerance);
    const double at = dot(u, solid.quadric.center);
    solid.half_spaces = {{u, at + half + kTolerance}, {negative(u), half - at + kTolerance}};
    solid.bounds = centres_within(low, high);
    return solid;
}

Convex convex(const Cone& cone, double voxel_size) {
    Convex solid;
    const Vector& u = cone.axis;
    const double height = cone.height / voxel_size;
    const double r = height * std::tan(cone.half_angle);
    Vector low;
    Vector high;
    for (std::size_t k = 0; k < 3; ++k) {
        const double apex = cone.apex[k] / voxel_size;
        const double base = apex + height * u[k];
        const double reach = r * std::sqrt(std::max(0.0, 1 - u[k] * u[k]));
        solid.quadric.center[k] = apex;
        low[k] = std::min(apex, base - reach);
        high[k] = std::max(apex, base + reach);
    }
    solid.quadric.kind = Quadric::Kind::cone;
    solid.quadric.axis = u;
    const double cosine = std::cos(cone.half_angle);
    solid.quadric.number = cosine * cosine;
    const double at = dot(u, solid.quadric.center);
    solid.half_spaces = {{u, at + height + kTolerance}, {negative(u), kTolerance - at}};
    solid.bounds = centres_within(low, high);
    return solid;
}

// The sum of a polytope and a voxel (about the voxel's centre): its facets are those of either, or
// lie along an edge of each.
Convex meeting(const Polytope& p) {
    constexpr Vector axes[] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    Convex solid;
    Vector low;
    Vector high;
    box_of(p.corners, low, high);
    solid.bounds = voxels_met(low, high);
    const auto add = [&](const Vector& n) {
        const double reach = (std::abs(n[0]) + std::abs(n[1]) + std::abs(n[2])) / 2;
        double least;
        const double most = extent(p.corners, n, least);
        solid.half_spaces.push_back({n, most + reach + kTolerance});
        solid.half_spaces.push_back({negative(n), reach - least + kTolerance});
    };
    for (const Vector& n : p.normals) add(n);
    for (const Vector& edge : p.edges) {
        for (const Vector& axis : axes) {
            const auto n = unit(cross(edge, axis));
            if (n) add(*n);
        }
    }
    return solid;
}

Voxels polytope_voxels(const Polytope& polytope, double voxel_size) {
    const Polytope p = scaled(polytope, voxel_size);
    if (!is_thin(widths(p))) {
        Voxels voxels = rasterise_convex(by_centres(p));
        if (voxels.blocks() > 0) return voxels;
    }
    return rasterise_convex(meeting(p));
}

Polytope prism_around(const Cylinder& cylinder, double voxel_size) {
    Polytope prism;
    std::vector<Vector> ring;
    circle({0, 0, 0}, cylinder.axis, cylinder.radius, voxel_size, ring, prism.edges, prism.normals);
    for (const double end : {-0.5, 0.5}) {
        const Vector middle = along(cylinder.center, cylinder.axis, end * cylinder.height);
        for (const Vector& p : ring) {
            prism.corners.push_back({middle[0] + p[0], middle[1] + p[1], middle[2] + p[2]});
        }
    }
    prism.edges.push_back(cylinder.axis);
    prism.normals.push_back(cylinder.axis);
    prism.normals.push_back(negative(cylinder.axis));
    return prism;
}

Polytope pyramid_around(const Cone& cone, double voxel_size) {
    Polytope pyramid;
    std::vector<Vector> outwards;
    const Vector base = along(cone.apex, cone.axis, cone.height);
    circle(base, cone.axis, cone.height * std::tan(cone.half_angle), voxel_size, pyramid.corners,
           pyramid.edges, outwards);
    for (const Vector& corner : pyramid.corners) {
        const auto edge =
            unit({corner[0] - cone.apex[0], corner[1] - cone.apex[1], corner[2] - cone.apex[2]});
        if (edge) pyramid.edges.push_back(*edge);
    }
    const double c = std::cos(cone.half_angle);
    const double s = std::sin(cone.half_angle);
    for (const Vector& out : outwards) {
        pyramid.normals.push_back({c * out[0] - s * cone.axis[0], c * out[1] - s * cone.axis[1],
                                   c * out[2] - s * cone.axis[2]});
    }
    pyramid.normals.push_back(cone.axis);
    pyramid.corners.push_back(cone.apex);
    return pyramid;
}

Voxels rasterise_convex(const Convex& solid) {
    Voxels voxels;
    walk(solid, [&](const Origin& origin, const Words& words) {
        expect_few(voxels.blocks());
        voxels.append(origin, words);
    });
    return voxels;
}

void rasterise_convex(const Convex& solid, VoxelCollector& into) {
    walk(solid, [&](const Origin& origin, const Words& words) { into.add(origin, words); });
}

}  // namespace semmap::fields
