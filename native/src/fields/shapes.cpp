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
    const Vector center = ball.center / voxel_size;
    const auto box = voxels_met(center - Vector(r), center + Vector(r));
    for (auto voxel = box.begin(); voxel; ++voxel) {
        const Vector low = (*voxel).asVec3d();
        const Vector nearest = maxComponent(low, minComponent(center, low + Vector(1)));
        if ((nearest - center).lengthSqr() <= r * r) voxels.add(*voxel);
    }
    return voxels.finish();
}

Voxels voxels_of(const std::vector<Vector>& points, double voxel_size) {
    VoxelCollector voxels;
    constexpr std::size_t few = 256;
    std::int32_t at[3 * few];
    for (std::size_t first = 0; first < points.size(); first += few) {
        const std::size_t here = std::min(few, points.size() - first);
        voxel_indices(points[first].asPointer(), 3 * here, voxel_size, at);
        for (std::size_t i = 0; i < here; ++i) voxels.add(Coord(at + 3 * i));
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
        return drawn({d, d, cylinder.height / size}, cylinder, prism_around);
    }
    Voxels operator()(const Cone& cone) const {
        const double h = cone.height / size;
        const double d = 2 * h * std::tan(cone.half_angle);
        const double slant = d * std::cos(cone.half_angle);
        return drawn({std::min(h, slant), d, std::max(h, slant)}, cone, pyramid_around);
    }
    Voxels operator()(const Polytope& polytope) const { return polytope_voxels(polytope, size); }
    Voxels operator()(const Points& points) const { return voxels_of(points.points, size); }
    Voxels operator()(const Solid& solid) const { return solid_voxels(solid, size); }
    Voxels operator()(const Surface& surface) const { return surface_voxels(surface, size); }

    // By the centres of voxels, unless it is too thin for them or they all miss it.
    template <typename Round, typename Around>
    Voxels drawn(const Vector& widths, const Round& round, const Around& around) const {
        if (!is_thin(widths)) {
            Voxels voxels = rasterise_convex(convex(round, size));
            if (voxels.blocks() > 0) return voxels;
        }
        Polytope polytope = around(round, size);
        polytope.corners = scaled(std::move(polytope.corners), size);
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
    each_point(
        depth, rows, columns, camera, farthest,
        [&](std::size_t pixel) { return mask == nullptr || mask[pixel] != 0; },
        [&](std::size_t, const Vector& point) { all.points.push_back(point); });
    return all;
}

}  // namespace semmap::fields
