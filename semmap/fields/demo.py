"""What fields add to the demo: people look about in the map, and the paper's query is asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from semmap.draw.fields import FieldView, fields_picture
from semmap.draw.palette import object_colour
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.queries import Stored, query
from semmap.fields.maps.map_buffer import Maps
from semmap.language.names import Names
from semmap.fields.store.reader import read_names, read_props, read_vocabulary_of_map, read_zones
from semmap.fields.sources import (
    GazeSource,
    ObjectSource,
    PeopleSource,
    PersonalSpaceSource,
    Zones,
    ZoneSource,
)
from semmap.fields.sources.percepts import Zone
from semmap.fields.sources.synthetic_scene import Actor, Prop, Stage, standpoints

__all__ = ["field_demo", "perceived", "staged"]

PAPERS_QUERY = """PREFIX : http://kb.openrobots.org/
SELECT ?voxels
WHERE
?voxels :inFieldOfView human1 .
?voxels :containsObject '{type}'
STORE
:containsObject"""
"""As reMap, section 4, prints it."""

WANTED = ("mug", "muffin", "cup", "food", "kitchenware", "personal_thing", "object")
"""What the people look at: the first type of which there is something to see."""

AROUND = 3.3
"""Metres around it that are drawn."""


def field_demo(
    connection: Any, folder: Path, say: Callable[..., Any], *, voxel_size: float = 0.02
) -> list[Path]:
    """Two people, one of whom looks at a small thing; ask what is seen, and draw it."""
    names = read_names(connection)
    zones = read_zones(connection)
    props = read_props(connection)
    found = staged(props, names, zones)
    if found is None:
        say("   nobody finds a place to stand from which something small is seen")
        return []
    stage, target, eye = found
    maps = perceived(stage, eye, target, zones, voxel_size)
    text = PAPERS_QUERY.format(type=target.type)
    for line in text.splitlines():
        say(f"   {line}")
    catalogue = FieldCatalogue(read_vocabulary_of_map(), maps, names, voxel_size=voxel_size)
    answer = query(catalogue, text)
    assert isinstance(answer, Stored)
    count = len(answer.voxels)
    say(f"   {count} voxels of {voxel_size:g} m, {count * voxel_size**3 * 1e6:.0f} cm³")
    picture = _picture(stage, target, eye, maps, answer, names, folder / "fields.png")
    say(f"   {picture}")
    return [picture]


def staged(
    props: Sequence[Prop], names: Names, zones: Sequence[Zone]
) -> tuple[Stage, Prop, tuple[float, float, float]] | None:
    """Two people near something small, and where a camera sees it from; None if nobody can stand.

    human1 looks at it, human2 away from it.
    """
    now = datetime.now(UTC)
    for target in _wanted(props, names):
        points = target.triangles.reshape(-1, 3)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        ground = _ground(middle, props, zones)
        if not 0.3 < middle[2] - ground < 1.5:
            continue
        near = [p for p in props if _distance(p, middle) < AROUND + 2]
        places = standpoints(Stage(near, [], now), target.name, ground)
        if len(places) < 3:
            continue
        (x, y), one, other = places[:3]
        away = (*(2 * np.array(other) - middle[:2]), ground + 1.3)
        people = [
            Actor("human1", *one, ground, (middle[0], middle[1], middle[2])),
            Actor("human2", *other, ground, (float(away[0]), float(away[1]), float(away[2]))),
        ]
        return Stage(near, people, now), target, (x, y, ground + 1.5)
    return None


def perceived(
    stage: Stage,
    eye: tuple[float, float, float],
    target: Prop,
    zones: Sequence[Zone],
    voxel_size: float,
) -> Maps:
    """The maps of all sources: what a camera at `eye` sees, where people look, their spaces."""
    vocabulary = read_vocabulary_of_map()
    looks_at = target.triangles.reshape(-1, 3).mean(axis=0)
    seen = stage.seen(eye, looks_at)
    persons = stage.people(stage.seen(eye, looks_at, of=lambda prop: prop.name))
    maps, size = Maps(), voxel_size
    objects = ObjectSource(vocabulary, voxel_size=size)
    gaze = GazeSource(vocabulary, voxel_size=size, reach=3.0)
    space = PersonalSpaceSource(vocabulary, voxel_size=size)
    rooms = ZoneSource(vocabulary, voxel_size=0.05)
    maps.put("objects", objects(seen), stage.time)
    maps.put("people", PeopleSource(vocabulary, voxel_size=size)(persons), stage.time)
    maps.put("gaze", gaze(stage.gazes()), stage.time)
    maps.put("personal space", space(stage.motions()), stage.time)
    maps.put("zones", rooms(Zones(tuple(zones), stage.time)), stage.time)
    return maps


def _wanted(props: Sequence[Prop], names: Names) -> list[Prop]:
    """Small things, those of the types that are wanted first."""

    def rank(prop: Prop) -> tuple[int, float]:
        fits = [i for i, type_ in enumerate(WANTED) if names.is_a(prop.type, type_)]
        return fits[0], float(np.prod(np.ptp(prop.triangles.reshape(-1, 3), axis=0)))

    small = [
        p
        for p in props
        if names.is_a(p.type, "object") and np.ptp(p.triangles.reshape(-1, 3), axis=0).max() < 0.4
    ]
    return sorted(small, key=rank)


def _ground(point: NDArray[np.float64], props: Sequence[Prop], zones: Sequence[Zone]) -> float:
    """The floor of the room that a point is in, or the lowest of all things if it is in none."""
    floors = [
        z.low
        for z in zones
        if z.kind == "room" and z.low <= point[2] <= z.high and z.outline.covers(_flat(point))
    ]
    return max(floors) if floors else min(float(p.triangles[:, :, 2].min()) for p in props)


def _flat(point: NDArray[np.float64]) -> Any:
    from shapely import Point

    return Point(point[0], point[1])


def _distance(prop: Prop, point: NDArray[np.float64]) -> float:
    """Metres from a point to the box of a prop."""
    points = prop.triangles.reshape(-1, 3)
    off = np.maximum(np.maximum(points.min(axis=0) - point, point - points.max(axis=0)), 0)
    return float(np.linalg.norm(off))


def _picture(
    stage: Stage,
    target: Prop,
    eye: tuple[float, float, float],
    maps: Maps,
    answer: Stored,
    names: Names,
    path: Path,
) -> Path:
    middle = target.triangles.reshape(-1, 3).mean(axis=0)
    ground = eye[2] - 1.5
    triangles, colours = [_disc(middle, ground)], [np.tile(to_rgb("#efece4"), (72, 1))]
    for prop in stage.props:
        points = prop.triangles.reshape(-1, 3)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        indoors = names.is_a(prop.type, "object") or prop.type == "person"
        structure = names.is_a(prop.type, "building_element") or names.is_a(prop.type, "room")
        if not indoors or structure or np.linalg.norm(centre[:2] - middle[:2]) > AROUND:
            continue
        if not ground - 0.2 < centre[2] < ground + 2:
            continue
        supers = names.supers.get(prop.type, frozenset({prop.type}))
        colour = "#5b6b86" if prop.type == "person" else object_colour(supers)
        pale = 0.5 * np.array(to_rgb(colour)) + 0.5
        triangles.append(prop.triangles)
        colours.append(np.tile(pale, (len(prop.triangles), 1)))

    now = maps.now()
    seen = next(m for m in now if m.property.name == "containsObject")
    gaze = next(m for m in now if m.property.name == "inFieldOfView" and m.about == "human1")
    size = answer.voxel_size

    def near(voxels: NDArray[np.int32]) -> NDArray[np.int32]:
        off = (voxels[:, :2] + 0.5) * size - middle[:2]
        kept: NDArray[np.int32] = voxels[np.linalg.norm(off, axis=1) < AROUND]
        return kept

    chosen = {tuple(v) for v in answer.voxels.tolist()}
    voxels = seen.voxels()
    others = voxels[[tuple(v) not in chosen for v in voxels.tolist()]]
    fields = [
        FieldView(near(others), size, "#9fb8d0", "objects that the robot sees"),
        FieldView(
            answer.voxels, size, "#d6336c", f"{target.type} in human1's field of view: the answer"
        ),
        FieldView(near(gaze.voxels()), size, "#e8a200", "field of view of human1", 0.22),
    ]
    # From the camera's side, that what it sees is seen here, and a little off, that depth shows.
    robot = np.degrees(np.arctan2(eye[1] - middle[1], eye[0] - middle[0]))
    return fields_picture(
        np.concatenate(triangles), np.concatenate(colours), fields, path,
        title="What human1 sees", azimuth=float(robot) + 20, elevation=35, width=1400,
    )  # fmt: skip


def _disc(middle: NDArray[np.float64], ground: float) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * np.pi, 73)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(73)]) * AROUND
    ring += (middle[0], middle[1], ground)
    hub = np.tile((middle[0], middle[1], ground), (72, 1))
    return np.stack([hub, ring[:-1], ring[1:]], axis=1)
