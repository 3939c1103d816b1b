#include <openvdb/math/Mat3.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "convex.hpp"

namespace semmap::fields {
namespace {

constexpr double kHitsAtOnce = 1 << 22;
constexpr double kStepsOfHit = 64;

std::vector<Vector> scaled(const std::vector<Vector>& vertices, double voxel_size) {
    std::vector<Vector> v = vertices;
    for (Vector& vertex : v) {
        for (double& at : vertex) at /= voxel_size;
    }
    return v;
}

Vector minus(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Polytope polytope_of(const Vector& a, const Vector& b, const Vector& c) {
    Polytope p;
    p.corners = {a, b, c};
    p.edges = {minus(b, a), minus(c, b), minus(a, c)};
    const Vector& u = p.edges[0];
    const Vector& v = p.edges[1];
    Vector n{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (length > 1e-12) p.normals = {{n[0] / length, n[1] / length, n[2] / length}};
    return p;
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

// Widths along the principal axes of the corners, in voxels.
std::array<double, 3> principal_widths(const std::vector<Vector>& corners) {
    Vector mean{};
    for (const Vector& p : corners) {
        for (std::size_t k = 0; k < 3; ++k) mean[k] += p[k] / static_cast<double>(corners.size());
    }
    openvdb::Mat3d spread = openvdb::Mat3d::zero(), axes;
    openvdb::Vec3d lengths;
    for (const Vector& p : corners) {
        const Vector d = minus(p, mean);
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                spread(i, j) += d[static_cast<std::size_t>(i)] * d[static_cast<std::size_t>(j)];
            }
        }
    }
    openvdb::math::diagonalizeSymmetricMatrix(spread, axes, lengths);
    std::array<double, 3> widths{};
    for (std::size_t k = 0; k < 3; ++k) {
        double low = std::numeric_limits<double>::infinity();
        double high = -low;
        for (const Vector& p : corners) {
            const double at = axes.col(static_cast<int>(k)).dot({p[0], p[1], p[2]});
            low = std::min(low, at);
            high = std::max(high, at);
        }
        widths[k] = high - low;
    }
    return widths;
}

bool is_thin_part(const std::vector<Vector>& corners) {
    std::array<double, 3> box{};
    for (std::size_t k = 0; k < 3; ++k) {
        const auto [low, high] =
            std::minmax_element(corners.begin(), corners.end(),
                                [k](const Vector& a, const Vector& b) { return a[k] < b[k]; });
        box[k] = (*high)[k] - (*low)[k];
    }
    return is_thin(box) || is_thin(principal_widths(corners));
}

Polytope polytope_of(const std::vector<Vector>& v, const Triangle& face) {
    const auto at = [&](std::size_t k) { return v[static_cast<std::size_t>(face[k])]; };
    return polytope_of(at(0), at(1), at(2));
}

void add_surface(const std::vector<Vector>& v, const Triangle& face, VoxelCollector& into) {
    rasterise_convex(meeting(polytope_of(v, face)), into);
}

// Steps that drawing triangles takes, as `work_of` counts them: they have 20 half-spaces.
double work_of(const std::vector<Vector>& v, const Triangle& face) {
    double columns = 1;
    for (std::size_t k = 0; k < 2; ++k) {
        const auto [low, high] = std::minmax({v[static_cast<std::size_t>(face[0])][k],
                                              v[static_cast<std::size_t>(face[1])][k],
                                              v[static_cast<std::size_t>(face[2])][k]});
        columns *= high - low + 1;
    }
    return 21 * columns;
}

// Estimates how often the surface of a solid crosses columns of voxels.
double crossings(const std::vector<Vector>& v, const std::vector<Triangle>& faces) {
    double total = 0;
    for (const Triangle& face : faces) {
        const Vector& a = v[static_cast<std::size_t>(face[0])];
        const Vector& b = v[static_cast<std::size_t>(face[1])];
        const Vector& c = v[static_cast<std::size_t>(face[2])];
        const double area =
            std::abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / 2;
        total += area + std::max({a[0], b[0], c[0]}) - std::min({a[0], b[0], c[0]});
    }
    return total;
}

// The voxels of x = first .. last whose centres the surface encloses.
void add_inside(const std::vector<Vector>& v, const std::vector<Triangle>& faces,
                std::int32_t first_x, std::int32_t last_x, VoxelCollector& into) {
    double low_y = std::numeric_limits<double>::infinity();
    double high_y = -low_y;
    for (const Vector& p : v) {
        low_y = std::min(low_y, p[1]);
        high_y = std::max(high_y, p[1]);
    }
    // Columns of a tower of blocks follow each other: its blocks are looked up once.
    const std::int32_t corner_x = block_floor(first_x);
    const std::int32_t corner_y = block_floor(checked_index(std::floor(low_y)));
    const auto towers = static_cast<std::uint64_t>((std::floor(high_y) - corner_y) / kBlock) + 1;
    std::vector<Hit> hits;
    for (const Triangle& face : faces) {
        const Vector& a = v[static_cast<std::size_t>(face[0])];
        const Vector& b = v[static_cast<std::size_t>(face[1])];
        const Vector& c = v[static_cast<std::size_t>(face[2])];
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
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (const Vector& p : v) {
        for (const double at : p) checked_index(std::floor(at));
        low = std::min(low, p[0]);
        high = std::max(high, p[0]);
    }
    if (!(low <= high)) return;
    const auto first = block_floor(static_cast<std::int32_t>(std::floor(low)) - 1);
    const auto last = static_cast<std::int32_t>(std::ceil(high)) + 1;
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
        if (!is_thin_part(corners)) {
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
