"""The part of the demo about fields: two people in the map, and the query of reMap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from shapely import Point

from semmap.draw.fields import FieldView, fields_picture
from semmap.draw.palette import object_colour
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.queries import StoreResult, query
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.sources import (
    GazeSource,
    ObjectSource,
    PeopleSource,
    PersonalSpaceSource,
    Zones,
    ZoneSource,
)
from semmap.fields.sources.percepts import Zone
from semmap.fields.sources.synthetic_scene import (
    ScenePerson,
    SyntheticScene,
    VisibleObject,
    standpoints,
)
from semmap.fields.store.names import read_map_vocabulary, read_names
from semmap.fields.store.reader import read_visible_objects, read_zones
from semmap.language.names import NameIndex
from semmap.query.snapshot import Snapshot

PAPERS_QUERY = """PREFIX : http://kb.openrobots.org/
SELECT ?voxels
WHERE
?voxels :inFieldOfView human1 .
?voxels :containsObject '{type}'
STORE
:containsObject"""
"""The query of reMap, section 4."""

WANTED = ("food", "kitchenware", "personal_thing", "object")
"""The types of objects that the people look at, the preferred ones first."""

AROUND = 3.3
"""Metres around the object that are drawn."""


def field_demo(
    seen: Snapshot,
    folder: Path,
    say: Callable[..., Any],
    *,
    voxel_size: float = 0.02,
    pixels: int = 1400,
) -> list[Path]:
    """Put two people into the map, query what one of them sees, and draw it; the picture made.

    There is none without a small object that has a free place beside it. `voxel_size` in metres.
    """
    names = read_names(seen)
    zones = list(read_zones(seen).values())
    objects = read_visible_objects(seen)
    found = arrange_scene(objects, names, zones)
    if found is None:
        say("   there is no free place from which a small object is visible")
        return []
    scene, target, eye = found
    maps = perceived_maps(scene, eye, target, zones, voxel_size)
    text = PAPERS_QUERY.format(type=target.type)
    for line in text.splitlines():
        say(f"   {line}")
    catalogue = FieldCatalogue(read_map_vocabulary(), maps, names, voxel_size=voxel_size)
    result = query(catalogue, text)
    assert isinstance(result, StoreResult)
    count = len(result)
    say(f"   {count} voxels of {voxel_size:g} m, {count * voxel_size**3 * 1e6:.0f} cm³")
    picture = _picture(scene, target, eye, maps, result, names, folder / "fields.png", pixels)
    say(f"   {picture}")
    return [picture]


def arrange_scene(
    objects: Sequence[VisibleObject], names: NameIndex, zones: Sequence[Zone]
) -> tuple[SyntheticScene, VisibleObject, tuple[float, float, float]] | None:
    """Return a scene of two people near a small object, the object, and the place of a camera.

    human1 looks at the object, human2 away from it. None if there is no object with free places
    around it.
    """
    now = datetime.now(UTC)
    for target in _small_objects(objects, names):
        points = target.triangles.reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        floor = _floor(middle, objects, zones)
        if not 0.3 < middle[2] - floor < 1.5:
            continue
        near = [each for each in objects if _distance(each, middle) < AROUND + 2]
        places = standpoints(SyntheticScene(near, [], now), target.name, floor)
        if len(places) < 3:
            continue
        (x, y), one, other = places[:3]
        away = (*(2 * np.array(other) - middle[:2]), floor + 1.3)
        people = [
            ScenePerson("human1", *one, floor, (middle[0], middle[1], middle[2])),
            ScenePerson("human2", *other, floor, (float(away[0]), float(away[1]), float(away[2]))),
        ]
        return SyntheticScene(near, people, now), target, (x, y, floor + 1.5)
    return None


def perceived_maps(
    scene: SyntheticScene,
    eye: tuple[float, float, float],
    target: VisibleObject,
    zones: Sequence[Zone],
    voxel_size: float,
) -> MapBuffer:
    """Return the maps of all sources; the camera at `eye`, (3,) metres, looks at the target."""
    vocabulary = read_map_vocabulary()
    looks_at = target.triangles.reshape(-1, 3).mean(axis=0)
    seen = scene.image(eye, looks_at)
    by_name = scene.image(eye, looks_at, label=lambda each: each.name)
    persons = scene.image_of_people(by_name)
    maps, size = MapBuffer(), voxel_size
    objects = ObjectSource(vocabulary, voxel_size=size)
    gaze = GazeSource(vocabulary, voxel_size=size, reach=3.0)
    space = PersonalSpaceSource(vocabulary, voxel_size=size)
    rooms = ZoneSource(vocabulary, voxel_size=0.05)
    maps.put("objects", objects(seen), scene.time)
    maps.put("people", PeopleSource(vocabulary, voxel_size=size)(persons), scene.time)
    maps.put("gaze", gaze(scene.gazes()), scene.time)
    maps.put("personal space", space(scene.motions()), scene.time)
    maps.put("zones", rooms(Zones(tuple(zones), scene.time)), scene.time)
    return maps


def _small_objects(objects: Sequence[VisibleObject], names: NameIndex) -> list[VisibleObject]:
    """Return small objects, those of the preferred types first."""

    def rank(each: VisibleObject) -> tuple[int, float]:
        fits = [i for i, type_ in enumerate(WANTED) if names.is_a(each.type, type_)]
        return fits[0], float(np.prod(_extent(each)))

    small = [
        each for each in objects if names.is_a(each.type, "object") and _extent(each).max() < 0.4
    ]
    return sorted(small, key=rank)


def _extent(object: VisibleObject) -> NDArray[np.float64]:
    extent: NDArray[np.float64] = np.ptp(object.triangles.reshape(-1, 3), axis=0)
    return extent


def _floor(
    point: NDArray[np.float64], objects: Sequence[VisibleObject], zones: Sequence[Zone]
) -> float:
    """Return the floor of the room around a point, or the lowest point of all objects."""
    here, rooms = Point(point[:2]), [z for z in zones if z.kind == "room"]
    floors = [z.low for z in rooms if z.low <= point[2] <= z.high and z.outline.covers(here)]
    return max(floors) if floors else min(float(o.triangles[:, :, 2].min()) for o in objects)


def _distance(object: VisibleObject, point: NDArray[np.float64]) -> float:
    """Return the distance in metres from a point to the box of an object."""
    points = object.triangles.reshape(-1, 3)
    off = np.maximum(np.maximum(points.min(axis=0) - point, point - points.max(axis=0)), 0)
    return float(np.linalg.norm(off))


def _picture(
    scene: SyntheticScene,
    target: VisibleObject,
    eye: tuple[float, float, float],
    maps: MapBuffer,
    result: StoreResult,
    names: NameIndex,
    path: Path,
    pixels: int,
) -> Path:
    middle = target.triangles.reshape(-1, 3).mean(axis=0)
    floor = eye[2] - 1.5
    triangles, colours = [_disc(middle, floor)], [np.tile(to_rgb("#efece4"), (72, 1))]
    for each in scene.objects:
        points = each.triangles.reshape(-1, 3)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        indoors = names.is_a(each.type, "object") or each.type == "person"
        structure = names.is_a(each.type, "building_element") or names.is_a(each.type, "room")
        if not indoors or structure or np.linalg.norm(centre[:2] - middle[:2]) > AROUND:
            continue
        if not floor - 0.2 < centre[2] < floor + 2:
            continue
        supertypes = names.supertypes.get(each.type, frozenset({each.type}))
        colour = "#5b6b86" if each.type == "person" else object_colour(supertypes)
        pale = 0.5 * np.array(to_rgb(colour)) + 0.5
        triangles.append(each.triangles)
        colours.append(np.tile(pale, (len(each.triangles), 1)))

    now = maps.now()
    seen = next(m for m in now if m.property.name == "containsObject")
    gaze = next(m for m in now if m.property.name == "inFieldOfView" and m.about == "human1")
    size = result.voxel_size

    def near(voxels: NDArray[np.int32]) -> NDArray[np.int32]:
        off = (voxels[:, :2] + 0.5) * size - middle[:2]
        kept: NDArray[np.int32] = voxels[np.linalg.norm(off, axis=1) < AROUND]
        return kept

    chosen = {tuple(v) for v in result.voxels.tolist()}
    voxels = seen.voxels()
    others = voxels[[tuple(v) not in chosen for v in voxels.tolist()]]
    fields = [
        FieldView(near(others), size, "#9fb8d0", "objects that the robot sees"),
        FieldView(
            result.voxels, size, "#d6336c", f"{target.type} in human1's field of view: the result"
        ),
        FieldView(near(gaze.voxels()), size, "#e8a200", "field of view of human1", 0.22),
    ]
    # Draw from the side of the camera, turned by 20 degrees so that depth is visible.
    robot = np.degrees(np.arctan2(eye[1] - middle[1], eye[0] - middle[0]))
    return fields_picture(
        np.concatenate(triangles),
        np.concatenate(colours),
        fields,
        path,
        title="What human1 sees",
        azimuth=float(robot) + 20,
        elevation=35,
        width=pixels,
    )


def _disc(middle: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * np.pi, 73)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(73)]) * AROUND
    ring += (middle[0], middle[1], floor)
    hub = np.tile((middle[0], middle[1], floor), (72, 1))
    return np.stack([hub, ring[:-1], ring[1:]], axis=1)
