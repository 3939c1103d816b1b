// Triangle meshes, in voxel units.
#pragma once

#include "semmap/fields/shapes.hpp"

namespace semmap::fields {

Voxels solid_voxels(const Solid& solid, double voxel_size);
Voxels surface_voxels(const Surface& surface, double voxel_size);

}  // namespace semmap::fields
