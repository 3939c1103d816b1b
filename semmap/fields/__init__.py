"""Fields: what space contains and means, in sparse grids of voxels (OpenVDB)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.fields.maps.lattice import Lattice
    from semmap.fields.maps.map_buffer import MapBuffer
    from semmap.fields.maps.representation_map import RepresentationMap
    from semmap.fields.regions.region_map import Memory, Overlap, RegionMap
    from semmap.fields.regions.shaped_region import (
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

_HOMES = {
    "Box": "semmap.fields.regions.shaped_region",
    "Cone": "semmap.fields.regions.shaped_region",
    "Cylinder": "semmap.fields.regions.shaped_region",
    "DepthImage": "semmap.fields.regions.shaped_region",
    "Hull": "semmap.fields.regions.shaped_region",
    "Lattice": "semmap.fields.maps.lattice",
    "MapBuffer": "semmap.fields.maps.map_buffer",
    "Memory": "semmap.fields.regions.region_map",
    "Overlap": "semmap.fields.regions.region_map",
    "Property": "semmap.language.schema",
    "Region": "semmap.fields.regions.shaped_region",
    "RegionMap": "semmap.fields.regions.region_map",
    "RepresentationMap": "semmap.fields.maps.representation_map",
    "Solid": "semmap.fields.regions.shaped_region",
    "Sphere": "semmap.fields.regions.shaped_region",
    "SurfaceRegion": "semmap.fields.regions.shaped_region",
    "voxels_of": "semmap.fields.regions.shaped_region",
}

__getattr__ = load_on_use(__name__, _HOMES)
