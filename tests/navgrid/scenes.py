"""Small scenes by hand: boxes as objects, and parts of a robot that is made of boxes."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import FloorArea, SceneEntity, StoreyScene
from semmap.robot import Part

Corner = tuple[float, float, float]


def solid(
    number: int, low: Corner, high: Corner, *types: str, yaw: float = 0.0, **fields: Any
) -> SceneEntity:
    """A box as an object, turned about its middle."""
    box = box_mesh(low, high).triangles.reshape(-1, 3)
    middle = (np.array(low) + high) / 2
    pose = Pose.planar(float(middle[0]), float(middle[1]), yaw)
    turned = pose.apply(box - (middle[0], middle[1], 0))
    kind = fields.pop("kind", "object")
    triangles = turned.reshape(-1, 3, 3)
    return SceneEntity(number, f"solid{number}", kind, (*types, kind), triangles, **fields)


def sheet(number: int, corners: list[Corner], *types: str, kind: Any = "object") -> SceneEntity:
    """A flat convex polygon as an object."""
    fan = [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
    return SceneEntity(number, f"solid{number}", kind, (*types, kind), np.array(fan, float))


def room(name: str, x0: float, y0: float, x1: float, y1: float, floor: float = 0.0) -> FloorArea:
    return FloorArea(name, shapely.box(x0, y0, x1, y1), floor)


def scene(
    *entities: SceneEntity, floors: tuple[FloorArea, ...] = (), elevation: float = 0.0
) -> StoreyScene:
    return StoreyScene("ground", elevation, entities, floors)


def region(number: int, outline: shapely.Polygon, *types: str, **properties: Any) -> SceneEntity:
    return SceneEntity(
        number,
        f"region{number}",
        "region",
        (*types, "region"),
        footprint=outline,
        properties=properties,
    )


def two_rooms(z: float = 0.0, state: str = "open") -> StoreyScene:
    """A lab and a kitchen of 4 x 3 m with a door of 1 m between them, and what stands there."""
    walls = [
        solid(number, (*low, z), (*high, z + 2.5), "wall", "building_element")
        for number, (low, high) in enumerate(
            [
                ((-0.1, -0.1), (8.3, 0.0)),
                ((-0.1, 3.0), (8.3, 3.1)),
                ((-0.1, 0.0), (0.0, 3.0)),
                ((8.2, 0.0), (8.3, 3.0)),
                ((4.02, 0.0), (4.18, 1.0)),
                ((4.02, 2.0), (4.18, 3.0)),
            ]
        )
    ]
    return scene(
        *walls,
        solid(11, (-0.1, -0.1, z - 0.2), (8.3, 3.1, z), "floor", "building_element"),
        solid(12, (0, 0, z + 2.5), (8.2, 3, z + 2.6), "ceiling", "building_element"),
        solid(13, (1.5, 1.0, z), (2.5, 2.0, z + 0.01), "carpet"),
        solid(14, (6.02, 1.02, z), (7.22, 1.82, z + 0.77), "table", "furniture"),
        solid(15, (1.0, 2.2, z), (1.4, 2.6, z + 1.0), "robot", kind="agent"),
        solid(16, (4.08, 1, z), (4.12, 2, z + 2.01), "door", kind="connector", state=state),
        region(17, shapely.box(0.2, 0.2, 0.8, 1.0), "staircase"),
        region(18, shapely.box(3.0, 2.2, 3.8, 2.8), "home_region"),
        floors=(
            room("lab", 0, 0, 4, 3, z),
            room("kitchen", 4.2, 0, 8.2, 3, z),
            FloorArea("door1", shapely.box(3.4, 1.0, 4.8, 2.0), z),
        ),
        elevation=z,
    )


def part(
    name: str, low: float, high: float, corners: NDArray[np.float64] | list[list[float]]
) -> Part:
    """A part of a footprint and an interval."""
    footprint = np.array(corners, float)
    ring = shapely.Polygon(footprint)
    inside = ring.contains(shapely.Point(0, 0))
    inscribed = ring.exterior.distance(shapely.Point(0, 0)) if inside else 0.0
    around = float(np.hypot(*footprint.T).max())
    return Part(name, (name,), (low, high), footprint, inscribed, around)


def square(half: float, x: float = 0.0) -> list[list[float]]:
    return [[x - half, -half], [x + half, -half], [x + half, half], [x - half, half]]


BASE = part("base", 0.0, 0.3, square(0.25))
ARM = part("arm", 0.85, 1.05, square(0.1, 0.35))
POLE = part("pole", 0.3, 1.3, square(0.05, -0.15))
