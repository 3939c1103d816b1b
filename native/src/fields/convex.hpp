// How solids become voxels: convex ones in voxel units, with one interval of z per column; meshes.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "semmap/family.hpp"
#include "semmap/fields/shapes.hpp"
#include "semmap/fields/voxels.hpp"

namespace semmap::fields {

constexpr double kTolerance = 1e-9;

// The fastest of this processor, until another is chosen.
inline std::atomic<Family>& used_family() {
    static std::atomic<Family> used{families().back()};
    return used;
}

// n . p <= d
struct HalfSpace {
    Vector n;
    double d;
};

// About a unit axis u through `center`, with p relative to it: a ball |p| <= r, a cylinder
// |p|^2 - (u . p)^2 <= r^2, or a cone k |p|^2 <= (u . p)^2 within its half-space.
struct Quadric {
    enum class Kind { none, ball, cylinder, cone } kind = Kind::none;
    Vector center{};
    Vector axis{};
    double number = 0;  // r^2 or k
};

struct Convex {
    std::vector<HalfSpace> half_spaces;
    Quadric quadric;
    CoordBBox bounds;
};

// The unit vector, if the length is not 0.
std::optional<Vector> unit(const Vector& v);
// The lowest and the highest coordinates of points.
template <typename Points>
std::pair<Vector, Vector> box_of(const Points& points) {
    Vector low(std::numeric_limits<double>::infinity());
    Vector high = -low;
    for (const Vector& point : points) {
        low = minComponent(low, point);
        high = maxComponent(high, point);
    }
    return {low, high};
}

// In voxels.
std::vector<Vector> scaled(std::vector<Vector> points, double voxel_size);

Convex convex(const Ball& ball, double voxel_size);
Convex convex(const Cylinder& cylinder, double voxel_size);
Convex convex(const Cone& cone, double voxel_size);
// By the centres of voxels, unless it is too thin for them or they all miss it.
Voxels polytope_voxels(const Polytope& polytope, double voxel_size);
// Every voxel that the polytope meets; its corners in voxel units.
Convex meeting(const Polytope& polytope);

bool is_thin(const Vector& widths_in_voxels);
Polytope prism_around(const Cylinder& cylinder, double voxel_size);
Polytope pyramid_around(const Cone& cone, double voxel_size);

Voxels rasterise_convex(const Convex& solid);
void rasterise_convex(const Convex& solid, VoxelCollector& into);

// How many steps rasterising takes: columns of voxels, times the half-spaces that clip them.
double work_of(const Convex& solid);
// Throws BadRegion where that is more than a region of the largest size may take.
void expect_little(double work);

// Triangle meshes.
Voxels solid_voxels(const Solid& solid, double voxel_size);
Voxels surface_voxels(const Surface& surface, double voxel_size);

// The voxels that a box of points in voxels meets; a face on a border between voxels belongs to
// one side of it.
CoordBBox voxels_met(const Vector& low, const Vector& high);
// A point in voxels; throws BadRegion beyond what a grid can hold.
const Vector& checked(const Vector& point);
// floor(p / voxel_size) of each of `count` numbers.
void voxel_indices(const double* p, std::size_t count, double voxel_size, std::int32_t* out);

}  // namespace semmap::fields
