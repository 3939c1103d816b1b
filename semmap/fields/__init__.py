"""Fields of meaning over space: which entities are where. Needs OpenVDB, knows no database."""

from semmap.fields.region_map import Memory, Overlap, RegionMap
from semmap.fields.regions import (
    Box,
    Cone,
    Cylinder,
    DepthImage,
    Hull,
    Region,
    Solid,
    Sphere,
    Surface,
    voxels_of,
)

__all__ = [
    "Box",
    "Cone",
    "Cylinder",
    "DepthImage",
    "Hull",
    "Memory",
    "Overlap",
    "Region",
    "RegionMap",
    "Solid",
    "Sphere",
    "Surface",
    "voxels_of",
]
