"""A leaf across a doorway: grids, costmaps, routes and `check` go by the state of its door."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
import shapely

import semmap
from planner.robot_class import RobotClass
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.robot import Part

SQUARE = np.array([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
ROBOT = RobotClass("cart", (Part("cart", ("cart",), (0.03, 0.8), SQUARE, 0.2, 0.283),))
"""A robot that opens no door."""


@pytest.mark.parametrize("seed", range(8))
def test_the_state_of_the_door_decides_what_a_leaf_blocks(database: str, seed: int) -> None:
    """Two rooms at an angle; the leaf is shut, or turned about its hinge, or stands in a room."""
    draw = random.Random(seed)
    turn, wide = draw.uniform(0, math.tau), draw.uniform(0.8, 1.4)
    type_ = draw.choice(["door", "door_leaf"])
    where = ("across", "open", "across", "away")[seed % 4]
    placed = Pose.planar(draw.uniform(-9, 9), draw.uniform(-9, 9), turn)

    def at(*points: tuple[float, float]) -> list[tuple[float, float]]:
        return [tuple(p[:2]) for p in placed.apply([[x, y, 0] for x, y in points]).tolist()]

    with semmap.connect(database) as db:
        here = db.create_map("m")
        here.add_room("one", at((-4, -2), (-0.1, -2), (-0.1, 2), (-4, 2)), floor=0, ceiling=2.6)
        here.add_room("two", at((0.1, -2), (4, -2), (4, 2), (0.1, 2)), floor=0, ceiling=2.6)
        for name, low, high in (("w1", -2, -wide / 2), ("w2", wide / 2, 2)):
            mesh = box_mesh((-0.1, low, 0), (0.1, high, 2.6))
            here.add_object(name, mesh=mesh, type="wall", pose=(placed.x, placed.y, 0, turn))
        here.add_door("gate", "one", "two", at((0, -wide / 2), (0, wide / 2)))
        leaf = box_mesh((-0.02, -wide / 2 + 0.01, 0), (0.02, wide / 2 - 0.01, 2.1))
        x, y, yaw = {
            "across": (draw.uniform(-0.06, 0.06), 0.0, 0.0),
            "open": (0.1 + wide / 2, wide / 2 - 0.04, math.pi / 2),
            "away": (2.0, 0.0, 0.0),
        }[where]
        spot = placed @ Pose.planar(x, y, yaw)
        here.add_object("panel", mesh=leaf, type=type_, pose=(spot.x, spot.y, 0, turn + yaw))
        for state in ("open", "closed", "locked"):
            here.doors["gate"].state = state
            is_open = state == "open"
            grid = here.grid()
            costmap = here.costmap(ROBOT)
            for cells, made in (
                (grid.cells == 100, grid.grid),
                (costmap.occupied["room_geometry"][0], costmap.grid),
            ):
                other = 0 if made is grid.grid else costmap.occupied["admissible_objects"][0]
                blocked = cells | np.asarray(other, bool)
                assert _is_taken(blocked, made, shapely.Point(spot.x, spot.y)) == (
                    where != "across" or not is_open
                )
                line = shapely.LineString(at((0, -wide / 2 + 0.2), (0, wide / 2 - 0.2)))
                assert _is_taken(blocked, made, line) == (not is_open)
            robot = RobotClass("cart", ROBOT.parts, opens=False)
            try:
                here.route("one", "two", robot=robot)
            except ValueError:
                assert not is_open
            else:
                assert is_open
            said = [f for f in here.check() if "panel" in f.entities and "gate" in f.entities]
            shut = [f.kind for f in said]
            assert shut == (["shut leaf of an open door"] if where == "across" and is_open else [])
            assert all(f.severity == "warning" for f in said)


def _is_taken(cells: np.ndarray, grid: object, shape: shapely.Geometry) -> bool:
    """Whether a shape meets blocked cells."""
    (x0, y0), size = grid.origin, grid.resolution  # type: ignore[attr-defined]
    rows, columns = np.nonzero(cells)
    boxes = shapely.box(
        x0 + columns * size, y0 + rows * size, x0 + (columns + 1) * size, y0 + (rows + 1) * size
    )
    return bool(shapely.intersects(boxes, shape).any())
