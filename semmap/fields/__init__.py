"""Fields: what space contains and means, in sparse grids of voxels (OpenVDB)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.fields.maps.lattice import Lattice
    from semmap.fields.maps.map_buffer import MapBuffer
    from semmap.fields.maps.representation_map import RepresentationMap
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
    "Box": "semmap.fields.regions.shapes",
    "Cone": "semmap.fields.regions.shapes",
    "Cylinder": "semmap.fields.regions.shapes",
    "DepthImage": "semmap.fields.regions.shapes",
    "Hull": "semmap.fields.regions.shapes",
    "Lattice": "semmap.fields.maps.lattice",
    "MapBuffer": "semmap.fields.maps.map_buffer",
    "Memory": "semmap.fields.regions.region_map",
    "Overlap": "semmap.fields.regions.region_map",
    "Property": "semmap.language.schema",
    "Region": "semmap.fields.regions.shapes",
    "RegionMap": "semmap.fields.regions.region_map",
    "RepresentationMap": "semmap.fields.maps.representation_map",
    "Solid": "semmap.fields.regions.shapes",
    "Sphere": "semmap.fields.regions.shapes",
    "SurfaceRegion": "semmap.fields.regions.shapes",
    "voxels_of": "semmap.fields.regions.shapes",
}

__getattr__ = load_on_use(__name__, _HOMES)
