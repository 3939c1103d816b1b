#include "semmap/fields/shapes.hpp"

#include <algorithm>
#include <cmath>

#include "convex.hpp"

namespace semmap::fields {
namespace {

// A ball between centres: the voxels whose nearest point lies in it.
Voxels small_ball(const Ball& ball, double voxel_size) {
    VoxelCollector voxels;
    const double r = ball.radius / voxel_size;
    Vector c;
    std::array<std::int32_t, 3> low;
    std::array<std::int32_t, 3> high;
    for (std::size_t k = 0; k < 3; ++k) {
        c[k] = ball.center[k] / voxel_size;
        low[k] = checked_index(std::floor(c[k] - r + kTolerance));
        high[k] = std::max(low[k], checked_index(std::floor(c[k] + r - kTolerance)));
    }
    const auto off = [](double at, std::int32_t i) {
        return at < i ? i - at : at > i + 1.0 ? at - i - 1.0 : 0.0;
    };
    for (std::int32_t x = low[0]; x <= high[0]; ++x) {
        for (std::int32_t y = low[1]; y <= high[1]; ++y) {
            for (std::int32_t z = low[2]; z <= high[2]; ++z) {
                const double dx = off(c[0], x);
                const double dy = off(c[1], y);
                const double dz = off(c[2], z);
                if (dx * dx + dy * dy + dz * dz <= r * r) voxels.add(x, y, z);
            }
        }
    }
    return voxels.finish();
}

struct Rasteriser {
    double size;

    Voxels operator()(const Ball& ball) const {
        const double d = 2 * ball.radius / size;
        if (is_thin({d, d, d})) return small_ball(ball, size);
        return rasterise_convex(convex(ball, size));
    }
    Voxels operator()(const Cylinder& cylinder) const {
        const double d = 2 * cylinder.radius / size;
        if (!is_thin({d, d, cylinder.height / size})) {
            Voxels voxels = rasterise_convex(convex(cylinder, size));
            if (voxels.blocks() > 0) return voxels;
        }
        return met(prism_around(cylinder, size));
    }
    Voxels operator()(const Cone& cone) const {
        const double h = cone.height / size;
        const double d = 2 * h * std::tan(cone.half_angle);
        const double slant = d * std::cos(cone.half_angle);
        if (!is_thin({std::min(h, slant), d, std::max(h, slant)})) {
            Voxels voxels = rasterise_convex(convex(cone, size));
            if (voxels.blocks() > 0) return voxels;
        }
        return met(pyramid_around(cone, size));
    }
    Voxels operator()(const Polytope& polytope) const { return polytope_voxels(polytope, size); }
    Voxels operator()(const Points& points) const {
        return voxels_of_points(points.points.empty() ? nullptr : points.points[0].data(),
                                points.points.size(), size);
    }
    Voxels operator()(const Solid& solid) const { return solid_voxels(solid, size); }
    Voxels operator()(const Surface& surface) const { return surface_voxels(surface, size); }

    Voxels met(Polytope polytope) const {
        for (Vector& corner : polytope.corners) {
            for (double& at : corner) at /= size;
        }
        return rasterise_convex(meeting(polytope));
    }
};

}  // namespace

Voxels rasterise(const Shape& shape, double voxel_size) {
    Voxels voxels = std::visit(Rasteriser{voxel_size}, shape);
    const auto part = std::count_if(voxels.words.begin(), voxels.words.end(),
                                    [](const Words& w) { return !is_full(w); });
    const std::int64_t most = region_limits().blocks.load(std::memory_order_relaxed);
    if (part > most) {
        throw BadRegion("the region's border passes through " + std::to_string(part) +
                        " blocks of 8 x 8 x 8 voxels, more than " + std::to_string(most) +
                        ": take larger voxels, or a smaller region "
                        "(SEMMAP_MAX_REGION_BLOCKS raises the limit)");
    }
    return voxels;
}

Points points_of_depth(const float* depth, const std::uint8_t* mask, std::size_t rows,
                       std::size_t columns, const Camera& camera, double farthest) {
    Points all;
    if (mask == nullptr) all.points.reserve(rows * columns);
    for (std::size_t row = 0; row < rows; ++row) {
        const double y = (static_cast<double>(row) - camera.cy) / camera.fy;
        for (std::size_t column = 0; column < columns; ++column) {
            const std::size_t i = row * columns + column;
            const double d = depth[i];
            if ((mask != nullptr && mask[i] == 0) || !(d > 0 && d <= farthest && d < 1e30))
                continue;
            const double x = (static_cast<double>(column) - camera.cx) / camera.fx;
            Vector p;
            for (std::size_t k = 0; k < 3; ++k) {
                const std::array<double, 4>& r = camera.pose[k];
                p[k] = d * (r[0] * x + r[1] * y + r[2]) + r[3];
            }
            all.points.push_back(p);
        }
    }
    return all;
}

Voxels voxels_of_points(const double* points, std::size_t count, double voxel_size) {
    VoxelCollector voxels;
    constexpr std::size_t few = 256;
    std::int32_t at[3 * few];
    for (std::size_t first = 0; first < count; first += few) {
        const std::size_t here = std::min(few, count - first);
        voxel_indices(points + 3 * first, 3 * here, voxel_size, at);
        for (std::size_t i = 0; i < here; ++i) voxels.add(at[3 * i], at[3 * i + 1], at[3 * i + 2]);
    }
    return voxels.finish();
}

}  // namespace semmap::fields
