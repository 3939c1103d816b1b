"""Fields of meaning over space: maps, their sources and operators, and a language to ask them.

Needs OpenVDB. The working modules know no database; `source`, `mirror` and `announce` do.
"""

from semmap.fields.maps.map_buffer import Maps
from semmap.language.property import Property
from semmap.fields.regions.region_map import Memory, Overlap, RegionMap
from semmap.fields.regions.shapes import (
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
from semmap.fields.maps.representation_map import Lattice, RepresentationMap

__all__ = [
    "Box",
    "Cone",
    "Cylinder",
    "DepthImage",
    "Hull",
    "Lattice",
    "Maps",
    "Memory",
    "Overlap",
    "Property",
    "Region",
    "RegionMap",
    "RepresentationMap",
    "Solid",
    "Sphere",
    "Surface",
    "voxels_of",
]
