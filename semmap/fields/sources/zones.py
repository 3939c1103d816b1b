"""Zones: rooms and regions as prisms from their bottom to their top."""

from __future__ import annotations

import numpy as np
from shapely import Polygon
from trimesh.creation import extrude_polygon

from semmap.fields.checks import positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.shapes import Region
from semmap.fields.sources.percepts import Zone, Zones
from semmap.geometry.mesh import Mesh
from semmap.geometry.morphology import polygons


class ZoneSource:
    """Makes a bool map for each zone: of `inRoom` for rooms, of `inZone` for regions.

    `left_out` has the reason for each zone with more voxels than `semmap.limits` allow.
    """

    takes = Zones
    provides = ("inRoom", "inZone")

    def __init__(self, vocabulary: Vocabulary, *, voxel_size: float = 0.05) -> None:
        self._property = {"room": vocabulary["inRoom"], "region": vocabulary["inZone"]}
        self._voxel_size = positive(voxel_size, "voxel_size")
        self.left_out: dict[str, str] = {}
        self._known: dict[str, tuple[Zone, RepresentationMap | None]] = {}

    def __call__(self, percept: Zones) -> list[RepresentationMap]:
        """Return a map for each zone; maps of unchanged zones are reused."""
        known = {}
        left_out = {}
        for zone in percept.zones:
            before = self._known.get(zone.name)
            if before is not None and before[0] == zone:
                known[zone.name] = before
                if before[1] is None:
                    left_out[zone.name] = self.left_out[zone.name]
                continue
            grid = None
            try:
                grid = RepresentationMap.of_regions(
                    self._property[zone.kind],
                    [(region, True) for region in prism(zone, self._voxel_size)],
                    self._voxel_size,
                    about=zone.name,
                    time=percept.time,
                )
            except ValueError as error:
                left_out[zone.name] = str(error)
            known[zone.name] = (zone, grid)
        self._known = known
        self.left_out = left_out
        return [each for _, each in known.values() if each is not None]


def prism(zone: Zone, voxel_size: float) -> list[Region]:
    """Return the space of a zone, from its bottom to its top."""
    regions: list[Region] = []
    for polygon in polygons(zone.outline):
        made = extrude_polygon(Polygon(polygon), zone.high - zone.low)
        mesh = Mesh(np.add(made.vertices, (0, 0, zone.low)), made.faces)
        regions += mesh_parts(mesh).regions(voxel_size)
    return regions
