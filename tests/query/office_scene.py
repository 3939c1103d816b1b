"""A small building whose spatial relations are known: what stands on, in, under and beside what."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import shapely
import trimesh
from sqlalchemy import Engine, text

from semmap.geometry.mesh import Mesh, box_mesh, join, prism_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import (
    ConnectorDetail,
    Entry,
    Kind,
    PlaceDetail,
    Shape,
    StoreyDetail,
    World,
)

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


def boxes(*parts: Box) -> Shape:
    """One mesh of boxes, each from its lowest to its highest corner."""
    return Shape("mesh", join([box_mesh(low, high) for low, high in parts]))


def block(x: float, y: float, z: float) -> Shape:
    """A box of that size that stands on its frame's origin."""
    return boxes(((-x / 2, -y / 2, 0), (x / 2, y / 2, z)))


def ball(radius: float) -> Shape:
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return Shape("mesh", Mesh(np.asarray(sphere.vertices), sphere.faces.astype(np.int32)))


def table() -> Shape:
    """1.6 x 0.8 m, 0.75 high: a top of 4 cm on four legs."""
    legs: list[Box] = [
        (
            (sx * 0.775 - 0.025, sy * 0.375 - 0.025, 0),
            (sx * 0.775 + 0.025, sy * 0.375 + 0.025, 0.71),
        )
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return boxes(((-0.8, -0.4, 0.71), (0.8, 0.4, 0.75)), *legs)


def shelf() -> Shape:
    """0.8 x 0.3 m, 1.9 high, open to -y: five boards, two sides and a back."""
    boards: list[Box] = [
        ((-0.4, -0.15, z), (0.4, 0.15, z + 0.02)) for z in (0, 0.5, 0.9, 1.4, 1.88)
    ]
    sides: list[Box] = [((s - 0.01, -0.15, 0), (s + 0.01, 0.15, 1.9)) for s in (-0.39, 0.39)]
    return boxes(*boards, *sides, ((-0.4, 0.14, 0), (0.4, 0.15, 1.9)))


def crate() -> Shape:
    """0.4 x 0.4 m, 0.3 high, walls of 1 cm, open at the top."""
    walls: list[Box] = [((s, -0.2, 0), (s + 0.01, 0.2, 0.3)) for s in (-0.2, 0.19)]
    walls += [((-0.2, s, 0), (0.2, s + 0.01, 0.3)) for s in (-0.2, 0.19)]
    return boxes(((-0.2, -0.2, 0), (0.2, 0.2, 0.02)), *walls)


def drawn(x0: float, y0: float, x1: float, y1: float, low: float, high: float) -> Shape:
    outline = shapely.box(x0, y0, x1, y1)
    return Shape("polygon", prism_mesh(outline, low, high), outline=outline)


def flat(x: float, y: float, z: float) -> Shape:
    """A drawn rectangle at one height, without a mesh."""
    corners = [(-x / 2, -y / 2, z), (x / 2, -y / 2, z), (x / 2, y / 2, z), (-x / 2, y / 2, z)]
    return Shape("polygon", outline=shapely.Polygon(corners))


def thing(
    name: str,
    shape: Shape | None,
    x: float,
    y: float,
    z: float = 0,
    yaw: float = 0,
    holder: str = "first",
    kind: Kind = "object",
    front: float = 0,
) -> Entry:
    shapes = [] if shape is None else [shape]
    return Entry(
        name, kind, holder=holder, pose=Pose.planar(x, y, yaw, z), shapes=shapes, front=front
    )


def room(name: str, shape: Shape | None, holder: str = "first", **place: Any) -> Entry:
    shapes = [] if shape is None else [shape]
    return Entry(name, "room", holder=holder, shapes=shapes, detail=PlaceDetail(**place))


def door(name: str, x: float, a: str, b: str, **said: Any) -> Entry:
    poses = (Pose(-0.5), Pose.planar(0.5, 0, math.pi))
    detail = ConnectorDetail((a, b), poses, **said)
    return Entry(name, "connector", holder="first", pose=Pose(x, 5, 1), detail=detail)


def office(frame: Pose) -> World:
    """The building with its origin at `frame`: all relations but those of the map's frame stay."""
    quarter = math.pi / 2
    entries = [
        Entry("first", "storey", pose=frame, detail=StoreyDetail(0, 3)),
        Entry("second", "storey", pose=frame @ Pose(z=3), detail=StoreyDetail(3, 3)),
        Entry("lift", "elevator", holder=None, pose=frame),
        room("office", drawn(0, 0, 6, 4, 0, 2.6), floor=0, ceiling=2.6),
        room("corridor", drawn(6.2, 0, 8, 4, 0, 2.6), floor=0, ceiling=2.6),
        room("store", None, holder="office"),
        room("vault", None),
        room("cabin1", None, elevator="lift"),
        room("cabin2", None, holder="second", elevator="lift"),
        room("attic", drawn(0, 0, 6, 4, 0, 2.6), holder="second"),
        door("door1", 1, "office", "corridor"),
        door("door2", 2, "corridor", "store", direction="forward"),
        door("door3", 3, "corridor", "vault", state="locked"),
        door("door4", 4, "corridor", "cabin1", type="elevator_door"),
        door("door5", 5, "attic", "cabin2", type="elevator_door", direction="backward"),
        door("door6", 6, "office", "outside"),
        door("door7", 7, "vault", "outside"),
        thing("rug", block(1.95, 1.6, 0.02), 1.8, 2),
        thing("table", table(), 2, 2, 0.02),
        thing("tray", block(0.4, 0.3, 0.02), 2.2, 2.1, 0.77, yaw=0.3),
        thing("muffin", ball(0.04), 2.2, 2.1, 0.83),
        thing("paper", block(0.2, 0.3, 0.001), 1.6, 2, 0.7705),
        thing("sheet", flat(0.2, 0.2, 0), 1.4, 2.15, 0.77),
        thing("ball", ball(0.11), 1.7, 2.1, 0.13),
        thing("lamp", block(0.3, 0.3, 0.2), 2.1, 2, 1.6),
        # Its side reaches 1 cm into the table's.
        thing("shelf", shelf(), 3.19, 2),
        thing("book", block(0.03, 0.2, 0.25), 3.1, 2.0, 0.92),
        thing("vase", block(0.1, 0.1, 0.3), 3.2, 2, 1.9),
        thing("crate", crate(), 5, 1),
        thing("mug", block(0.08, 0.08, 0.1), 5.05, 1.05, 0.02, yaw=0.5),
        # Two of a height, side by side; a plate ends where the first does.
        thing("chest1", block(0.5, 0.5, 0.4), 4.5, 3, yaw=quarter),
        thing("chest2", block(0.5, 0.5, 0.4), 5, 3),
        thing("plate", block(0.2, 0.2, 0.02), 4.65, 3, 0.4),
        thing("robot", block(0.4, 0.4, 1.2), 0.8, 0.7, kind="agent", front=quarter),
        thing("pin", None, 4, 0.5, 1.5),
        thing("stone", ball(0.1), 3, 0.95, 0.1),
        thing("stool", block(0.3, 0.3, 0.4), 7, 2, holder="corridor"),
        thing("desk", block(1.6, 0.8, 0.75), 2, 2, holder="second"),
        thing("home", drawn(0.3, 0.3, 1.15, 1.15, 0, 0.01), 0, 0, kind="region"),
        Entry("idea", "object", pose=None),
    ]
    return World("office", Path("office"), entries)


def store(engine: Engine, name: str, world: World) -> dict[str, int]:
    """The world as a map of that name: the ids of its entities."""
    with engine.begin() as connection:
        of_map = connection.execute(
            text("INSERT INTO map (name) VALUES (:name) RETURNING id"), {"name": name}
        ).scalar_one()
        driver = connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        store_world(driver, of_map, world, name)
        rows = connection.execute(
            text("SELECT name, id FROM entity WHERE map_id = :map"), {"map": of_map}
        )
        return {row[0]: row[1] for row in rows}


def bodies(name: str, meshes: Iterable[Mesh]) -> World:
    """Meshes in world coordinates, named body0, body1, ..."""
    entries = [Entry(f"body{i}", "object", shapes=[Shape("mesh", m)]) for i, m in enumerate(meshes)]
    return World(name, Path(name), entries)
