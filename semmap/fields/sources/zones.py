"""Zones: rooms and regions as prisms from their bottom to their top."""

from __future__ import annotations

from datetime import datetime

from semmap.fields.checks import positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.sources.percepts import Zone, Zones


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
        self._known: dict[str, tuple[Zone | None, RepresentationMap | str]] = {}

    def __call__(self, percept: Zones) -> list[RepresentationMap]:
        """Return a map for each zone; maps of unchanged zones are reused."""
        known = {}
        for zone in percept.zones:
            known[zone.name] = self._known.get(zone.name, (None, ""))
            if known[zone.name][0] != zone:
                known[zone.name] = (zone, self._map(zone, percept.time))
        self._known = known
        self.left_out = {name: map for name, (_, map) in known.items() if isinstance(map, str)}
        return [map for _, map in known.values() if isinstance(map, RepresentationMap)]

    def _map(self, zone: Zone, time: datetime) -> RepresentationMap | str:
        try:
            return RepresentationMap.of_regions(
                self._property[zone.kind],
                [(region, True) for region in zone.regions(self._voxel_size)],
                self._voxel_size,
                about=zone.name,
                time=time,
            )
        except ValueError as error:
            return str(error)
