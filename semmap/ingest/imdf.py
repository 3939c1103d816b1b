"""Apple's Indoor Mapping Data Format 1.0 (OGC 20-094): a folder or zip of GeoJSON in degrees.

Levels have ordinals and no heights, so that elevations are assumed. Units are rooms, or solid;
openings are doors; fixtures and kiosks are objects of assumed heights; amenities are regions. The
occupant of a unit is its label.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from semmap.ingest.annotation.annotation import draft_entries
from semmap.ingest.annotation.draft_world import DraftWorld
from semmap.ingest.annotation.feature_file import (
    Feature,
    FeatureFile,
    into_metres,
    parse_json,
    read_collection,
)
from semmap.ingest.georeference import WGS84
from semmap.ingest.naming import guess_type
from semmap.ingest.storeys import ASSUMED_HEIGHT
from semmap.ingest.world import World, WorldError
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

NO_FLOOR = {"opentobelow"}
"""Categories of units in which nothing stands."""

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
            each["properties"] = {**own, "imdf": about}
        found = read_collection(path, {"type": "FeatureCollection", "features": given})
        drawn.features += [replace(each, crs=WGS84) for each in found.features]
        drawn.skipped += found.skipped
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
    world.name = (venue and _text(venue.properties.get("name"))) or world.name
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
                yield json.loads(archive.read(info))
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
        ordinal = level.properties.get("ordinal")
        number = float(ordinal) if isinstance(ordinal, int | float) else 0.0
        name = _name(level) or f"level {number:g}"
        while name in storeys.values():
            name += "_"
        storeys[_id(level)] = name
        about = {"kind": "storey", "name": name, "elevation": number * ASSUMED_HEIGHT}
        yield replace(level, properties=_free(level) | about)
    units = {str(a.properties.get("unit_id")): _id(a) for a in by_type.get("anchor", ())}
    occupants = {
        str(each.properties.get("anchor_id")): _text(each.properties.get("name"))
        for each in by_type.get("occupant", ())
    }
    for type_, kind in KINDS.items():
        for each in by_type.get(type_, ()):
            category = str(each.properties.get("category") or "").partition(".")[0]
            keys: dict[str, Any] = {"kind": kind, "name": _name(each)}
            keys["storey"] = storeys.get(str(each.properties.get("level_id")))
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
            elif type_ == "opening":
                door = each.properties.get("door")
                known = door.get("type") if isinstance(door, dict) else "open"
                keys["type"] = DOOR_TYPES.get(str(known), "door")
            elif kind == "object":
                keys["height"] = WALL_HEIGHT if category == "wall" else FIXTURE_HEIGHT
                keys["type"] = _known(category, "object")
            keys = {key: value for key, value in keys.items() if value is not None}
            yield replace(each, properties=_free(each) | keys)


def _known(category: str, kind: Any) -> str | None:
    guess = guess_type(category, kind)
    return None if guess is None else guess.type


def _id(feature: Feature) -> str:
    return str(feature.properties["imdf"].get("id"))


def _free(feature: Feature) -> dict[str, Any]:
    """The properties that a map keeps, names and restrictions as plain text."""
    named = ("name", "short_name", "kind", "type", "storey", "holder", "height", "label", "floor")
    return {k: v for k, v in feature.properties.items() if k not in (*LINKS, *named)}


def _name(feature: Feature) -> str | None:
    about = feature.properties
    return _text(about.get("name")) or _text(about.get("short_name"))


def _text(labels: Any) -> str | None:
    """The first text of labels by language."""
    given = next(iter(labels.values()), None) if isinstance(labels, dict) else labels
    return given.strip() or None if isinstance(given, str) else None
