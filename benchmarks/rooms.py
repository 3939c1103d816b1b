"""A building of rooms along corridors: as a topology, and as a world with furniture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from shapely import Polygon, box, unary_union

from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.mesh import box_mesh, join, prism_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.world import ConnectorDetail, Entry, PlaceDetail, Shape, StoreyDetail, World

__all__ = ["furnished", "rooms"]

PITCH, DEPTH, STOREY = 4.0, 6.0, 3.2  # metres: a room's width and depth, and from floor to floor
HALL, HEIGHT, WALL, DOOR = 3.0, 2.8, 0.05, 0.9
"""Metres: how wide a corridor is, how high and half as thick walls are, and how wide doors."""


def rooms(floors: int = 10, corridors: int = 5, along: int = 19) -> Topology:
    """Floors of corridors with rooms on one side, joined end to end, and an elevator in the first.

    A floor has ``corridors * (along + 1)`` rooms, corridors among them, and a cabin.
    """
    places, connectors = [], []
    for f in range(floors):
        z, storey = f * STOREY, f"floor-{f}"
        lift = f"lift-{f}"
        places.append(Place(lift, storey=storey, elevator="lift", floor=z))
        for c in range(corridors):
            y = c * (DEPTH + 3.0)
            hall = f"corridor-{f}-{c}"
            places.append(Place(hall, storey=storey, floor=z))
            for r in range(along):
                x = (r + 0.5) * PITCH
                places.append(Place(f"room-{f}-{c}-{r}", storey=storey, floor=z))
                connectors.append(_door(f"door-{f}-{c}-{r}", hall, places[-1].name, x, y, z, 1))
            if c:
                connectors.append(
                    _door(f"pass-{f}-{c}", f"corridor-{f}-{c - 1}", hall, -1.0, y - 2.0, z, 1)
                )
        connectors.append(_door(f"edoor-{f}", f"corridor-{f}-0", lift, 0.0, -1.5, z, -1))
    return Topology.of(places, connectors)


def _door(name: str, a: str, b: str, x: float, y: float, z: float, north: int) -> PlaceConnector:
    """A door at (x, y) that leads north or south from a to b."""
    heading = math.copysign(math.pi / 2, north)
    poses = (
        Pose.planar(x, y - 0.6 * north, heading, z),
        Pose.planar(x, y + 0.6 * north, -heading, z),
    )
    return PlaceConnector(name, (a, b), poses, width=0.9)


def furnished(floors: int = 10, corridors: int = 5, along: int = 19, cups: int = 9) -> World:
    """A world like `rooms`: 1,000 rooms with walls and doors, a table in each with cups on it."""
    entries: list[Entry] = []
    for f in range(floors):
        name, z = f"floor-{f}", f * STOREY
        entries.append(Entry(name, "storey", pose=Pose(z=z), detail=StoreyDetail(z, STOREY)))
        for c in range(corridors):
            for entry in _corridor(f"{f}-{c}", f"{f}-{c - 1}" if c else None, c, along, cups):
                entry.holder = name
                entries.append(entry)
    return World("rooms", Path("rooms"), entries)


def _corridor(n: str, before: str | None, c: int, along: int, cups: int) -> Iterator[Entry]:
    """A corridor with rooms on its north side, and a passage to the one before."""
    y, width, hall = c * (DEPTH + HALL), along * PITCH, f"corridor-{n}"
    to_next = box(-HALL, 0, 0, DEPTH)
    yield _room(hall, Pose(0, y), unary_union([box(-HALL, -HALL, width, 0), to_next]))
    sides = [*_gaps(width, [(r + 0.5) * PITCH for r in range(along)])]
    walls = [box_mesh((a, -WALL, 0), (b, WALL, HEIGHT)) for a, b in sides]
    walls += [box_mesh((0, DEPTH - WALL, 0), (width, DEPTH + WALL, HEIGHT))]
    for r in range(along + 1):
        x = r * PITCH
        walls.append(box_mesh((x - WALL, WALL, 0), (x + WALL, DEPTH - WALL, HEIGHT)))
    shape = Shape("mesh", join(walls))
    yield Entry(f"walls-{n}", "object", "wall", pose=Pose(0, y), shapes=[shape])
    for r in range(along):
        x, name = r * PITCH, f"room-{n}-{r}"
        yield _room(name, Pose(x, y), box(0, 0, PITCH, DEPTH))
        yield _passage(f"door-{n}-{r}", (hall, name), (x + PITCH / 2, y))
        yield from _furniture(f"{n}-{r}", Pose(x + 1, y + 4.5), cups)
    yield from _furniture(n, Pose(width - 1.0, y - HALL + 0.6), cups)
    if before is not None:
        yield _passage(f"pass-{n}", (f"corridor-{before}", hall), (-HALL / 2, y - HALL))


def _gaps(width: float, doors: list[float]) -> Iterator[tuple[float, float]]:
    """Where the wall beside the doors is."""
    begin = 0.0
    for door in doors:
        yield begin, door - DOOR / 2
        begin = door + DOOR / 2
    yield begin, width


def _room(name: str, at: Pose, outline: Polygon) -> Entry:
    shapes = [Shape("polygon", prism_mesh(outline, 0.0, HEIGHT), outline)]
    return Entry(name, "room", pose=at, shapes=shapes, detail=PlaceDetail(ceiling=HEIGHT))


def _passage(name: str, places: tuple[str, str], at: tuple[float, float]) -> Entry:
    """A door that leads north."""
    poses = Pose.planar(-0.6, 0, 0), Pose.planar(0.6, 0, math.pi)
    detail = ConnectorDetail(places, poses, width=DOOR)
    return Entry(name, "connector", pose=Pose.planar(*at, math.pi / 2), detail=detail)


def _furniture(name: str, at: Pose, cups: int) -> Iterator[Entry]:
    table = Shape("mesh", box_mesh((-0.8, -0.4, 0), (0.8, 0.4, 0.75)))
    cup = Shape("mesh", box_mesh((-0.04, -0.04, 0), (0.04, 0.04, 0.1)))
    yield Entry(f"table-{name}", "object", "table", pose=at, shapes=[table])
    for k in range(cups):
        place = Pose(at.x - 0.6 + 0.14 * k, at.y, 0.75)
        yield Entry(f"cup-{name}-{k}", "object", "cup", pose=place, shapes=[cup])
