#include <openvdb/math/Mat3.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <utility>

#include "convex.hpp"

namespace semmap::fields {
namespace {

constexpr double kHitsAtOnce = 1 << 22;
constexpr double kStepsOfHit = 64;

std::array<Vector, 3> corners_of(const std::vector<Vector>& v, const Triangle& face) {
    const auto at = [&](std::size_t k) { return v[static_cast<std::size_t>(face[k])]; };
    return {at(0), at(1), at(2)};
}

// Where an edge crosses x; the same to the last bit for both of its triangles.
struct Crossing {
    double y;
    double z;
};

bool crosses(const Vector& a, const Vector& b, double x, Crossing& at) {
    if ((a[0] <= x) == (b[0] <= x)) return false;
    const Vector& low = a[0] <= b[0] ? a : b;
    const Vector& high = a[0] <= b[0] ? b : a;
    const double part = (x - low[0]) / (high[0] - low[0]);
    at = {low[1] + part * (high[1] - low[1]), low[2] + part * (high[2] - low[2])};
    return true;
}

// Where the surface crosses the line of voxel centres in a column, and which way it turns there.
struct Hit {
    std::uint64_t column;
    double z;
    int turn;
};

// Components share no vertex.
std::vector<std::int32_t> components(std::size_t vertices, const std::vector<Triangle>& faces) {
    std::vector<std::int32_t> parent(vertices);
    std::iota(parent.begin(), parent.end(), 0);
    const auto root = [&](std::int32_t v) {
        while (parent[static_cast<std::size_t>(v)] != v) {
            auto& up = parent[static_cast<std::size_t>(v)];
            v = up = parent[static_cast<std::size_t>(up)];
        }
        return v;
    };
    for (const Triangle& face : faces) {
        for (const std::int32_t other : {face[1], face[2]}) {
            parent[static_cast<std::size_t>(root(other))] = root(face[0]);
        }
    }
    std::vector<std::int32_t> part(faces.size());
    for (std::size_t i = 0; i < faces.size(); ++i) part[i] = root(faces[i][0]);
    return part;
}

template <typename Points>
Vector size_of(const Points& points) {
    const auto [low, high] = box_of(points);
    return high - low;
}

// Widths along the principal axes of the corners, in voxels.
Vector principal_widths(const std::vector<Vector>& corners) {
    Vector mean(0);
    for (const Vector& p : corners) mean += p / static_cast<double>(corners.size());
    openvdb::Mat3d spread = openvdb::Mat3d::zero(), axes;
    Vector lengths;
    for (const Vector& p : corners) spread += outerProduct(p - mean, p - mean);
    openvdb::math::diagonalizeSymmetricMatrix(spread, axes, lengths);
    std::vector<Vector> turned;
    for (const Vector& p : corners) turned.push_back(p * axes);
    return size_of(turned);
}

void add_surface(const std::vector<Vector>& v, const Triangle& face, VoxelCollector& into) {
    const auto [a, b, c] = corners_of(v, face);
    Polytope flat{{a, b, c}, {}, {b - a, c - b, a - c}};
    if (const auto n = unit((b - a).cross(c - b))) flat.normals = {*n};
    rasterise_convex(meeting(flat), into);
}

// Steps that drawing triangles takes, as `work_of` counts them: they have 20 half-spaces.
double work_of(const std::vector<Vector>& v, const Triangle& face) {
    const Vector size = size_of(corners_of(v, face));
    return 21 * (size[0] + 1) * (size[1] + 1);
}

// Estimates how often the surface of a solid crosses columns of voxels.
double crossings(const std::vector<Vector>& v, const std::vector<Triangle>& faces) {
    double total = 0;
    for (const Triangle& face : faces) {
        const auto [a, b, c] = corners_of(v, face);
        total += std::abs((b - a).cross(c - a)[2]) / 2 + size_of(std::array{a, b, c})[0];
    }
    return total;
}

// The voxels of x = first .. last whose centres the surface encloses.
void add_inside(const std::vector<Vector>& v, const std::vector<Triangle>& faces,
                std::int32_t first_x, std::int32_t last_x, VoxelCollector& into) {
    const auto [lowest, highest] = box_of(v);
    // Columns of a tower of blocks follow each other: its blocks are looked up once.
    const std::int32_t corner_x = block_floor(first_x);
    const std::int32_t corner_y = block_floor(static_cast<std::int32_t>(std::floor(lowest[1])));
    const auto towers =
        static_cast<std::uint64_t>((std::floor(highest[1]) - corner_y) / kBlock) + 1;
    std::vector<Hit> hits;
    for (const Triangle& face : faces) {
        const auto [a, b, c] = corners_of(v, face);
        const auto from = static_cast<std::int32_t>(std::floor(std::min({a[0], b[0], c[0]}) - 0.5));
        const auto to = static_cast<std::int32_t>(std::ceil(std::max({a[0], b[0], c[0]}) - 0.5));
        for (std::int32_t x = std::max(from, first_x); x <= std::min(to, last_x); ++x) {
            const double cx = x + 0.5;
            Crossing ends[3];
            int turns[3];
            int found = 0;
            for (const auto& [p, q] : {std::pair{&a, &b}, std::pair{&b, &c}, std::pair{&c, &a}}) {
                if (!crosses(*p, *q, cx, ends[found])) continue;
                turns[found++] = (*p)[0] <= cx ? 1 : -1;
            }
            if (found != 2) continue;
            const bool swap = ends[1].y < ends[0].y;
            const Crossing& low = ends[swap ? 1 : 0];
            const Crossing& high = ends[swap ? 0 : 1];
            // Counted where low.y <= centre < high.y, so that each centre meets one of two
            // triangles.
            const auto first = static_cast<std::int32_t>(std::ceil(low.y - 0.5));
            const auto past = static_cast<std::int32_t>(std::ceil(high.y - 0.5));
            for (std::int32_t y = first; y < past; ++y) {
                const double part = (y + 0.5 - low.y) / (high.y - low.y);
                const auto i = static_cast<std::uint64_t>(x - corner_x);
                const auto j = static_cast<std::uint64_t>(y - corner_y);
                const std::uint64_t tower = i / kBlock * towers + j / kBlock;
                const std::uint64_t column = 64 * tower + kBlock * (i % kBlock) + j % kBlock;
                hits.push_back({column, low.z + part * (high.z - low.z), turns[swap ? 1 : 0]});
            }
        }
    }
    std::sort(hits.begin(), hits.end(), [](const Hit& a, const Hit& b) {
        return std::tie(a.column, a.z) < std::tie(b.column, b.z);
    });
    for (std::size_t i = 0; i < hits.size();) {
        const std::uint64_t column = hits[i].column;
        const std::uint64_t tower = column / 64;
        const auto i_x = kBlock * (tower / towers) + column % 64 / kBlock;
        const auto i_y = kBlock * (tower % towers) + column % kBlock;
        const std::int32_t x = corner_x + static_cast<std::int32_t>(i_x);
        const std::int32_t y = corner_y + static_cast<std::int32_t>(i_y);
        int winding = 0;
        double start = 0;
        for (; i < hits.size() && hits[i].column == column; ++i) {
            if (winding == 0) start = hits[i].z;
            winding += hits[i].turn;
            if (winding != 0) continue;
            const auto low = static_cast<std::int32_t>(std::ceil(start - 0.5 - kTolerance));
            const auto high = static_cast<std::int32_t>(std::floor(hits[i].z - 0.5 + kTolerance));
            if (low <= high) into.add_column(x, y, low, high);
        }
    }
}

// In strips along x, so that the hits of a strip fit into memory.
void add_inside(const std::vector<Vector>& v, const std::vector<Triangle>& faces, double hits,
                VoxelCollector& into) {
    if (v.empty()) return;
    const auto [low, high] = box_of(v);
    const std::int32_t first = block_floor(Coord::floor(checked(low)).x() - 1);
    const std::int32_t last = Coord::ceil(checked(high)).x() + 1;
    const double strips = std::max(1.0, std::ceil(hits / kHitsAtOnce));
    const auto width =
        std::max(kBlock, block_floor(static_cast<std::int32_t>((last - first + 1) / strips)));
    for (std::int32_t x = first; x <= last; x += width) {
        add_inside(v, faces, x, std::min(x + width - 1, last), into);
    }
}

}  // namespace

std::size_t weld(std::vector<Vector>& vertices, std::vector<Triangle>& faces) {
    std::vector<std::int32_t> order(vertices.size());
    std::iota(order.begin(), order.end(), 0);
    const auto at = [&](std::int32_t i) -> const Vector& {
        return vertices[static_cast<std::size_t>(i)];
    };
    std::sort(order.begin(), order.end(),
              [&](std::int32_t a, std::int32_t b) { return at(a) < at(b); });
    std::vector<std::int32_t> number(vertices.size());
    std::vector<Vector> kept;
    for (const std::int32_t i : order) {
        if (kept.empty() || kept.back() != at(i)) kept.push_back(at(i));
        number[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(kept.size()) - 1;
    }
    vertices = std::move(kept);
    std::vector<std::pair<std::uint64_t, int>> edges;
    std::vector<Triangle> whole;
    for (const Triangle& face : faces) {
        Triangle f;
        for (std::size_t k = 0; k < 3; ++k) f[k] = number[static_cast<std::size_t>(face[k])];
        if (f[0] == f[1] || f[1] == f[2] || f[2] == f[0]) continue;
        whole.push_back(f);
        for (std::size_t k = 0; k < 3; ++k) {
            const auto a = static_cast<std::uint64_t>(f[k]);
            const auto b = static_cast<std::uint64_t>(f[(k + 1) % 3]);
            edges.emplace_back(std::min(a, b) << 32 | std::max(a, b), a < b ? 1 : -1);
        }
    }
    faces = std::move(whole);
    std::sort(edges.begin(), edges.end());
    std::size_t open = 0;
    for (std::size_t i = 0; i < edges.size();) {
        const std::uint64_t edge = edges[i].first;
        int balance = 0;
        for (; i < edges.size() && edges[i].first == edge; ++i) balance += edges[i].second;
        open += balance != 0 ? 1 : 0;
    }
    return open;
}

Voxels surface_voxels(const Surface& surface, double voxel_size) {
    const std::vector<Vector> v = scaled(surface.vertices, voxel_size);
    double work = 0;
    for (const Triangle& face : surface.faces) work += work_of(v, face);
    expect_little(work);
    VoxelCollector collector;
    for (const Triangle& face : surface.faces) add_surface(v, face, collector);
    return collector.finish();
}

Voxels solid_voxels(const Solid& solid, double voxel_size) {
    std::vector<Vector> v = scaled(solid.vertices, voxel_size);
    const double hits = crossings(v, solid.faces);
    expect_little(kStepsOfHit * hits);
    VoxelCollector collector;
    add_inside(v, solid.faces, hits, collector);
    const std::vector<std::int32_t> part = components(v.size(), solid.faces);
    std::vector<std::size_t> order(part.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return part[a] < part[b]; });
    double work = 0;
    for (std::size_t i = 0; i < order.size();) {
        std::size_t past = i;
        std::vector<Vector> corners;
        for (; past < order.size() && part[order[past]] == part[order[i]]; ++past) {
            for (const std::int32_t vertex : solid.faces[order[past]]) {
                corners.push_back(v[static_cast<std::size_t>(vertex)]);
            }
        }
        if (!is_thin(size_of(corners)) && !is_thin(principal_widths(corners))) {
            i = past;
            continue;
        }
        for (std::size_t k = i; k < past; ++k) work += work_of(v, solid.faces[order[k]]);
        expect_little(work);
        for (; i < past; ++i) add_surface(v, solid.faces[order[i]], collector);
    }
    return collector.finish();
}

}  // namespace semmap::fields
