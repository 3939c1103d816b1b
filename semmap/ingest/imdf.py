"""Apple's Indoor Mapping Data Format 1.0 (OGC 20-094): a folder or zip of GeoJSON in degrees.

Levels have ordinals and no heights, so that elevations are assumed. Units are rooms, or solid;
openings are doors; fixtures and kiosks are objects of assumed heights; amenities are regions. The
occupant of a unit is its label. Stairs, escalators and ramps on one another join levels, as do
those of a relationship; elevators on one another are cabins of one lift.
"""

from __future__ import annotations

import itertools
import zipfile
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import shapely

from semmap.geometry.overlay import common
from semmap.ingest.annotation.annotation import draft_entries
from semmap.ingest.annotation.draft_world import DraftWorld
from semmap.ingest.annotation.feature_file import (
    Feature,
    FeatureFile,
    into_metres,
    parse_json,
    read_collection,
    read_json,
)
from semmap.ingest.annotation.level_ways import WAYS, leads_into, way_between, way_feature
from semmap.ingest.georeference import WGS84
from semmap.ingest.naming import guess_type
from semmap.ingest.storeys import ASSUMED_HEIGHT
from semmap.ingest.world import World, WorldError, unique_name
from semmap.limits import TEXT_BYTES

KINDS = {
    "unit": "room",
    "opening": "connector",
    "fixture": "object",
    "kiosk": "object",
    "amenity": "region",
}
"""The kind of each type of feature that is on a level."""

ROOM_TYPES = {
    "conferenceroom": "meeting_room",
    "elevator": "elevator_cabin",
    "escalator": "stairwell",
    "fitnessroom": "fitness_room",
    "huddleroom": "meeting_room",
    "laboratory": "lab",
    "lounge": "break_room",
    "stairs": "stairwell",
    "steps": "stairwell",
    "storage": "storeroom",
    "walkway": "corridor",
}
"""Types of units by category; others are those of which the T-Box has the word."""

SOLID = {"brick", "column", "concrete", "drywall", "glass", "structure", "vegetation"}
"""Categories of units that are filled."""

LIFT = "elevator"
"""The category of units that are cabins of lifts."""

NO_FLOOR = {"opentobelow"}
"""Categories of units in which nothing stands."""

OUT_OF_SERVICE = "outofservice"
"""A value of `access_control` that is no permission, such as that of a badge reader."""

DOOR_TYPES = {
    "folding": "folding_door",
    "open": "opening",
    "revolving": "revolving_door",
    "sliding": "sliding_door",
}
"""Types of connectors by the type of a door; others are doors."""

WALL_HEIGHT, FIXTURE_HEIGHT = 2.5, 1.0
"""Assumed heights of walls and solid units, and of other fixtures, metres."""

LINKS = ("level_id", "display_point", "building_ids", "unit_ids", "anchor_id", "address_id")
"""Properties that are read, or refer to features by ids that a map does not keep."""


def is_imdf(path: Path) -> bool:
    """Return whether a path is a folder with the levels of an IMDF archive."""
    return (path / "level.geojson").is_file()


def read_imdf(
    path: Path,
    types: Collection[str] | None = None,
    georeference: Mapping[str, float] | None = None,
) -> World:
    """Return the world of an IMDF archive; types and georeference as of `read_annotation`.

    Raises
    ------
    WorldError
        The archive is damaged, too large or has no levels. A feature that cannot be used is in
        `skipped`.
    """
    drawn = FeatureFile()
    for root in _members(path):
        given = root.get("features") if isinstance(root, dict) else None
        if not isinstance(given, list):
            continue  # the manifest
        for each in (e for e in given if isinstance(e, dict)):
            stated = each.get("properties")
            own: dict[str, Any] = stated if isinstance(stated, dict) else {}
            about = {"id": each.get("id"), "feature_type": each.get("feature_type")}
            named = {key: _text(own.get(key)) for key in ("name", "short_name")}
            each["properties"] = {**own, **named, "imdf": about}
        found = read_collection(path, {"type": "FeatureCollection", "features": given})
        drawn.features += [replace(each, crs=WGS84) for each in found.features]
        drawn.skipped += found.skipped
        drawn.raised += found.raised
    by_type: dict[str, list[Feature]] = {}
    for feature in into_metres(path, drawn, georeference).features:
        kind = feature.properties["imdf"].get("feature_type")
        if isinstance(kind, str):
            by_type.setdefault(kind, []).append(feature)
    if not by_type.get("level"):
        raise WorldError(path, "level", "has no levels", "Is it an IMDF archive, with units?")
    drawn.features = [*_features(by_type)]
    drawn.notes.append(
        f"IMDF has no heights: a level is {ASSUMED_HEIGHT:g} m high, walls {WALL_HEIGHT:g} m, "
        f"other fixtures {FIXTURE_HEIGHT:g} m"
    )
    world = draft_entries(DraftWorld(path, drawn, types))
    venue = next(iter(by_type.get("venue", ())), None)
    world.name = (venue and venue.properties.get("name")) or world.name
    return world


def _members(path: Path) -> Iterator[Any]:
    """Yield the JSON files of a folder or zip file."""
    if path.is_dir():
        yield from (parse_json(each) for each in sorted(path.glob("*.geojson")))
        return
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [i for i in archive.infolist() if i.filename.endswith(".geojson")]
            size = sum(info.file_size for info in infos)
            TEXT_BYTES.check(size, partial(WorldError, path, "file"), "Split it.")
            for info in infos:
                yield read_json(path, archive.read(info).decode("utf-8-sig"))
    except WorldError:
        raise
    except (
        zipfile.BadZipFile,
        OSError,
        ValueError,
        RecursionError,
        NotImplementedError,
        RuntimeError,
        EOFError,
        zlib.error,
    ) as error:
        problem = f"is not a readable archive of GeoJSON ({error})"
        raise WorldError(path, "file", problem, "It may be truncated: restore it.") from error


def _features(by_type: Mapping[str, list[Feature]]) -> Iterator[Feature]:
    """Yield the features of an archive with the keys of annotations."""
    storeys: dict[str, str] = {}
    for level in by_type["level"]:
        number = _ordinal(level)
        name = _name(level) or f"level {number:g}"
        while name in storeys.values():
            name += "_"
        storeys[_id(level)] = name
        about = {"kind": "storey", "name": name, "elevation": number * ASSUMED_HEIGHT}
        yield replace(level, properties=_free(level) | about)
    units = {str(a.properties.get("unit_id")): _id(a) for a in by_type.get("anchor", ())}
    occupants = {
        str(each.properties.get("anchor_id")): each.properties.get("name")
        for each in by_type.get("occupant", ())
    }
    shared = _Shared(by_type, storeys)
    levels = {_id(unit): _level(unit) for unit in by_type.get("unit", ())}
    for type_, kind in KINDS.items():
        for each, level_id in _on_levels(by_type.get(type_, ()), levels):
            category = _category(each)
            keys: dict[str, Any] = {"kind": kind, "name": _name(each)}
            keys["storey"] = storeys.get(level_id)
            if type_ == "unit" and category in NO_FLOOR:
                continue
            if type_ == "unit" and category in SOLID:
                keys |= {
                    "kind": "object",
                    "height": WALL_HEIGHT,
                    "type": _known(category, "object"),
                }
            elif type_ == "unit":
                keys["type"] = ROOM_TYPES.get(category) or _known(category, "room")
                keys["label"] = occupants.get(units.get(_id(each), ""))
                keys["name"] = shared.names.get(_id(each), keys["name"])
                keys["elevator"] = shared.lifts.get(_id(each))
            elif type_ == "opening":
                door = each.properties.get("door")
                known = door.get("type") if isinstance(door, dict) else "open"
                lift = each.geometry is not None and leads_into(shared.cabins(each), each.geometry)
                keys["type"] = "elevator_door" if lift else DOOR_TYPES.get(str(known), "door")
                control = each.properties.get("access_control")
                needed = [*map(str, control)] if isinstance(control, list) else []
                keys["state"] = "locked" if OUT_OF_SERVICE in needed else None
                keys["permissions"] = [each for each in needed if each != OUT_OF_SERVICE] or None
            elif kind == "object":
                keys["height"] = WALL_HEIGHT if category == "wall" else FIXTURE_HEIGHT
                keys["type"] = _known(category, "object")
            keys = {key: value for key, value in keys.items() if value is not None}
            yield replace(each, properties=_free(each) | keys)
    yield from shared.ways()


def _on_levels(
    features: Iterable[Feature], levels: Mapping[str, str]
) -> Iterator[tuple[Feature, str]]:
    """Yield features with their level; an amenity has none, but is in units, each on its level."""
    for each in features:
        given = each.properties.get("unit_ids")
        units = given if isinstance(given, list) else ()
        of_units = dict.fromkeys(levels[str(unit)] for unit in units if str(unit) in levels)
        for level in [_level(each)] if "level_id" in each.properties else of_units or [""]:
            yield each, level


class _Shared:
    """The units that join levels: of one category on one another, or of a relationship."""

    def __init__(self, by_type: Mapping[str, list[Feature]], storeys: Mapping[str, str]) -> None:
        floors = {_id(level): _ordinal(level) for level in by_type["level"]}
        drawn = [u for u in by_type.get("unit", ()) if shapely.area(u.geometry) > 0]
        units = [u for u in drawn if _level(u) in floors and shapely.is_valid(u.geometry)]
        self.units = {_id(u): u for u in sorted(units, key=lambda u: floors[_level(u)])}
        self.floors = {id_: floors[_level(unit)] for id_, unit in self.units.items()}
        self.storeys = {id_: storeys[_level(unit)] for id_, unit in self.units.items()}
        self.pairs = dict(self._related(by_type.get("relationship", ())))
        for low, high in self._stacked():
            if (high, low) not in self.pairs:
                self.pairs.setdefault((low, high), "both")
        taken = {str(_name(unit)) for unit in by_type.get("unit", ())}
        self.names: dict[str, str] = {}
        for id_ in dict.fromkeys(itertools.chain(*self.pairs)):
            unit = self.units[id_]
            wanted = f"{_name(unit) or _category(unit)} {self.storeys[id_]}"
            self.names[id_] = unique_name(wanted, {*taken, *self.names.values()})
        self.lifts: dict[str, str] = {}  # the elevators of cabins, the lowest cabin first
        for id_, unit in self.units.items():
            if _category(unit) == LIFT:
                below = (self.lifts[low] for low, high in self.pairs if high == id_)
                new = unique_name(f"{_name(unit) or LIFT} lift", {*taken, *self.lifts.values()})
                self.lifts[id_] = next(below, new)

    def _related(self, relationships: Iterable[Feature]) -> Iterator[tuple[tuple[str, str], str]]:
        """Yield two units of different levels that a relationship joins, and its direction."""
        for each in relationships:
            about = each.properties
            between = about.get("intermediary")
            given = [about.get("origin"), *(between if isinstance(between, list) else ())]
            chain = [
                str(e.get("id")) for e in (*given, about.get("destination")) if isinstance(e, dict)
            ]
            direction = "forward" if about.get("direction") == "directed" else "both"
            for pair in itertools.pairwise(id_ for id_ in chain if id_ in self.units):
                ways = WAYS.keys() & {_category(self.units[id_]) for id_ in pair}
                if ways and self.floors[pair[0]] != self.floors[pair[1]]:
                    yield pair, direction

    def _stacked(self) -> Iterator[tuple[str, str]]:
        """Yield each unit with the next above it that has its category and half of its area."""
        shared = [(i, u) for i, u in self.units.items() if _category(u) in (LIFT, *WAYS)]
        met: set[str] = set()
        for (low, unit), (high, above) in itertools.combinations(shared, 2):
            if (
                low not in met
                and self.floors[low] < self.floors[high]
                and _category(unit) == _category(above)
            ):
                areas: list[Any] = [unit.geometry, above.geometry]
                if common(*areas).area >= min(a.area for a in areas) / 2:
                    met.add(low)
                    yield low, high

    def cabins(self, each: Feature) -> list[Any]:
        """Return the cabins of lifts on the level of a feature."""
        units = [self.units[id_] for id_ in self.lifts]
        return [unit.geometry for unit in units if _level(unit) == _level(each)]

    def ways(self) -> Iterator[Feature]:
        """Yield the stairs, escalators and ramps between units."""
        for (a, b), direction in self.pairs.items():
            units = first, second = self.units[a], self.units[b]
            type_ = next((WAYS[c] for unit in units if (c := _category(unit)) in WAYS), None)
            if type_ is not None:
                line = way_between(first.geometry, second.geometry)
                joins, about = (self.names[a], self.names[b]), {"direction": direction}
                yield way_feature(first.where, line, joins, self.storeys[a], type_, **about)


def _known(category: str, kind: Any) -> str | None:
    guess = guess_type(category, kind)
    return None if guess is None else guess.type


def _category(feature: Feature) -> str:
    return str(feature.properties.get("category") or "").partition(".")[0]


def _level(feature: Feature) -> str:
    return str(feature.properties.get("level_id"))


def _ordinal(level: Feature) -> float:
    given = level.properties.get("ordinal")
    return float(given) if isinstance(given, int | float) else 0.0


def _id(feature: Feature) -> str:
    return str(feature.properties["imdf"].get("id"))


def _free(feature: Feature) -> dict[str, Any]:
    """The properties that a map keeps, names and restrictions as plain text."""
    named = ("name", "short_name", "kind", "type", "storey", "holder", "height", "label", "floor")
    return {k: v for k, v in feature.properties.items() if k not in (*LINKS, *named)}


def _name(feature: Feature) -> str | None:
    about = feature.properties
    return about.get("name") or about.get("short_name")


def _text(labels: Any) -> str | None:
    """The first text of labels by language."""
    given = next(iter(labels.values()), None) if isinstance(labels, dict) else labels
    return given.strip() or None if isinstance(given, str) else None
