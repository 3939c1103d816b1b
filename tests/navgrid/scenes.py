"""Small scenes by hand: boxes as things, and parts of a robot that is made of boxes."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.scene import Place, Scene, Thing
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.robot import Part

Corner = tuple[float, float, float]


def thing(
    number: int, low: Corner, high: Corner, *types: str, yaw: float = 0.0, **said: Any
) -> Thing:
    """A box as an object, turned about its middle."""
    box = box_mesh(low, high).triangles.reshape(-1, 3)
    middle = (np.array(low) + high) / 2
    pose = Pose.planar(float(middle[0]), float(middle[1]), yaw)
    turned = pose.apply(box - (middle[0], middle[1], 0))
    said.setdefault("kind", "object")
    kind = said.pop("kind")
    return Thing(number, f"thing{number}", kind, (*types, kind), turned.reshape(-1, 3, 3), **said)


def sheet(number: int, corners: list[Corner], *types: str, kind: Any = "object") -> Thing:
    """A flat convex polygon as an object."""
    fan = [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
    return Thing(number, f"thing{number}", kind, (*types, kind), np.array(fan, float))


def room(name: str, x0: float, y0: float, x1: float, y1: float, floor: float = 0.0) -> Place:
    return Place(name, shapely.box(x0, y0, x1, y1), floor)


def scene(*things: Thing, places: tuple[Place, ...] = (), elevation: float = 0.0) -> Scene:
    return Scene("ground", elevation, things, places)


def part(
    name: str, low: float, high: float, corners: NDArray[np.float64] | list[list[float]]
) -> Part:
    """A part of a footprint and an interval; inflated as `semmap.robot` does by default."""
    footprint = np.array(corners, float)
    ring = shapely.Polygon(footprint)
    inside = ring.contains(shapely.Point(0, 0))
    inscribed = ring.exterior.distance(shapely.Point(0, 0)) if inside else 0.0
    around = float(np.hypot(*footprint.T).max())
    by = "inscribed" if inscribed > 0 else "circumscribed"
    return Part(name, (name,), (low, high), footprint, inscribed, around, by)


def square(half: float, x: float = 0.0) -> list[list[float]]:
    return [[x - half, -half], [x + half, -half], [x + half, half], [x - half, half]]


BASE = part("base", 0.0, 0.3, square(0.25))
ARM = part("arm", 0.85, 1.05, square(0.1, 0.35))
POLE = part("pole", 0.3, 1.3, square(0.05, -0.15))
