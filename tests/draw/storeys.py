"""A small storey by hand, for pictures and grids."""

from __future__ import annotations

import math

import numpy as np
from shapely import box

from semmap.draw.view import DoorView, ObjectView, RegionView, RoomView, StoreyView
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.geometry.pose import Pose


def box_view(name: str, types: tuple[str, ...], low: tuple, high: tuple) -> ObjectView:
    return ObjectView(name, types, box_mesh(low, high), box(*low[:2], *high[:2]))


def walls(z: float = 0.0, height: float = 2.5) -> Mesh:
    """Around two rooms, 4 x 3 m each, with a doorway of 1 m between them."""
    solids = [
        ((-0.1, -0.1), (8.3, 0.0)),
        ((-0.1, 3.0), (8.3, 3.1)),
        ((-0.1, 0.0), (0.0, 3.0)),
        ((8.2, 0.0), (8.3, 3.0)),
        ((4.02, 0.0), (4.18, 1.0)),
        ((4.02, 2.0), (4.18, 3.0)),
    ]
    return join([box_mesh((*a, z), (*b, z + height)) for a, b in solids])


def two_rooms(z: float = 0.0, state: str = "open", name: str = "ground") -> StoreyView:
    """A lab and a kitchen; a table with a muffin, a carpet, a ceiling, a blocked corner."""
    door = DoorView(
        "door1",
        (Pose.planar(3.4, 1.5, 0.0, z), Pose.planar(4.8, 1.5, math.pi, z)),
        1.0,
        "door",
        state,
    )
    return StoreyView(
        name,
        z,
        rooms=[
            RoomView("lab", box(0, 0, 4, 3), z, z + 2.5, ("lab", "work_room", "room"), "lab"),
            RoomView("kitchen", box(4.2, 0, 8.2, 3), z, z + 2.5, ("kitchen", "room")),
        ],
        objects=[
            ObjectView("walls", ("wall", "building_element", "object"), walls(z)),
            box_view("slab", ("floor", "building_element"), (-0.1, -0.1, z - 0.2), (8.3, 3.1, z)),
            box_view(
                "ceiling", ("ceiling", "building_element"), (0, 0, z + 2.5), (8.2, 3, z + 2.6)
            ),
            box_view("rug", ("carpet",), (1.5, 1.0, z), (2.5, 2.0, z + 0.06)),
            box_view("table1", ("table", "furniture"), (6.02, 1.02, z), (7.22, 1.82, z + 0.77)),
            box_view("muffin1", ("muffin", "food"), (6.5, 1.3, z + 0.77), (6.6, 1.4, z + 0.83)),
            box_view("robot", ("robot", "agent"), (1.0, 2.2, z), (1.4, 2.6, z + 1.0)),
        ],
        doors=[door],
        regions=[
            RegionView("stairs", box(0.2, 0.2, 0.8, 1.0), ("staircase", "region"), True),
            RegionView("home", box(3.0, 2.2, 3.8, 2.8), ("home_region", "region")),
        ],
        path=[np.array([[3.4, 2.5], [3.4, 1.5], [4.8, 1.5], [5.4, 0.6]])],
    )
