"""Fields: what space contains and means, in sparse grids of voxels (OpenVDB).

Maps that sources make, operators on maps, regions of entities, relations between entities, and
queries. Only the modules in `store` read and write the database.
"""

from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.regions.measures import Memory, Overlap
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.regions.shapes import (
    Box,
    Cone,
    Cylinder,
    DepthImage,
    Hull,
    Region,
    Solid,
    Sphere,
    SurfaceRegion,
    voxels_of,
)
from semmap.language.schema import Property

__all__ = [
    "Box",
    "Cone",
    "Cylinder",
    "DepthImage",
    "Hull",
    "Lattice",
    "MapBuffer",
    "Memory",
    "Overlap",
    "Property",
    "Region",
    "RegionMap",
    "RepresentationMap",
    "Solid",
    "Sphere",
    "SurfaceRegion",
    "voxels_of",
]
