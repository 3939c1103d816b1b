"""Figures 5, 6, 7 and 9 of Deeken et al., of the user's robot and building."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from navgrid.costmap import Costmap
from navgrid.inflation import INSCRIBED
from planner.grid_path import grid_path
from semmap.draw.costmap import costmap_picture
from semmap.draw.palette import PAPER, PART_COLOURS
from semmap.draw.robot import footprints_picture, parts_picture, robot_views
from semmap.draw.scene3d import scene3d
from semmap.draw.view import ObjectView, RoomView, StoreyView
from semmap.geometry.mesh import Mesh
from semmap.geometry.overlay import united
from semmap.geometry.pose import Pose
from semmap.robot.parts import Part

Point = tuple[float, float]
_WAY = "#e4007c"


def robot_figures(parts: Sequence[Part], meshes: Mapping[str, Mesh], folder: Path) -> list[Path]:
    """Figures 6 and 7: the robot's parts, and the footprints that they have in this state."""
    return [
        parts_picture(parts, meshes, folder / "figure6_parts.png", "Figure 6: the robot's parts"),
        footprints_picture(
            parts, folder / "figure7_footprints.png", "Figure 7: their heights and footprints"
        ),
    ]


def blocked_region(costmap: Costmap, view: StoreyView, folder: Path) -> Path | None:
    """Figure 5: a staircase region, and the grid around it without what it means, and with it."""
    layer = "blocked_regions"
    cells = costmap.occupied.get(layer)
    if cells is None or not cells.any():
        return None
    rows, columns = np.nonzero(cells[0])
    margin = int(2.0 / costmap.grid.resolution)
    window = (
        slice(max(0, rows.min() - margin), rows.max() + margin),
        slice(max(0, columns.min() - margin), columns.max() + margin),
    )
    geometry = np.zeros(costmap.grid.shape, np.bool_)
    for name, others in costmap.occupied.items():
        if name != layer:
            geometry |= others[0]
    pictures = [
        np.where(occupied, 254, np.where(costmap.unknown, 255, 0)).astype(np.uint8)[window]
        for occupied in (geometry, geometry | cells[0])
    ]
    between = np.full((pictures[0].shape[0], 6), 255, np.uint8)
    origin = costmap.grid.origin
    path = costmap_picture(
        np.concatenate([pictures[0], between, pictures[1]], axis=1),
        origin,
        costmap.grid.resolution,
        folder / "figure5_staircase.png",
        title="Figure 5: a staircase, without and with what the region says",
    )
    return _before(_region_picture(view, folder), path)


def _region_picture(view: StoreyView, folder: Path) -> Path | None:
    """Figure 5a: the blocked regions of a storey as boxes, in their rooms."""
    boxes = [
        RoomView(r.name, r.outline, r.low, r.high, r.types)
        for r in view.regions
        if r.blocked and r.low is not None and r.high is not None
    ]
    rooms = [m for m in view.rooms if any(m.outline.intersects(b.outline) for b in boxes)]
    if not rooms:
        return None
    inside = united(m.outline for m in rooms).buffer(0.2)  # no walls
    near = [o for o in view.objects if o.footprint and inside.contains(o.footprint)]
    shown = replace(view, rooms=rooms, objects=near, doors=[], path=[])
    return scene3d([shown], folder / "figure5_region.png", marked=boxes, boxes=False, width=1100)


def _before(left: Path | None, right: Path) -> Path:
    """Put a picture to the left of another one, and remove its file."""
    if left is None:
        return right
    with Image.open(left) as a, Image.open(right) as b:
        pictures = [each.convert("RGB") for each in (a, b)]
    left.unlink()
    height = max(each.height for each in pictures)
    sheet = Image.new("RGB", (sum(each.width for each in pictures), height), PAPER)
    at = 0
    for each in pictures:
        sheet.paste(each, (at, (height - each.height) // 2))
        at += each.width
    sheet.save(right)
    return right


def passage(
    layered: Costmap,
    single: Costmap,
    start: Point,
    goal: Point,
    view: StoreyView,
    meshes: Mapping[str, Mesh],
    folder: Path,
    pixels: int = 1800,
) -> list[Path]:
    """Figure 9: the robot where its parts pass below and above what is in the way of the whole.

    `single` is of the robot as one part of all its height. No picture where the layered costmap
    knows no way from start to goal, or that one knows it as well. The robot is drawn in the middle
    of the part of the way that the other costmap blocks.
    """
    way = _way(layered, start, goal)
    if way is None or _way(single, start, goal) is not None:
        return []
    points = _dense(way)
    costs = np.array([single.master[single.grid.cell(*point)] for point in points])
    blocked = np.flatnonzero(costs >= INSCRIBED)
    near = int(blocked[len(blocked) // 2])
    ahead = points[min(near + 1, len(points) - 1)] - points[max(near - 1, 0)]
    pose = Pose.planar(
        float(points[near][0]),
        float(points[near][1]),
        float(np.arctan2(ahead[1], ahead[0])),
        layered.scene.elevation,
    )
    footprints = [
        (_turned(part.footprint, pose), PART_COLOURS[k % len(PART_COLOURS)])
        for k, part in enumerate(layered.parts)
    ]
    pictures = [
        costmap_picture(
            made.master,
            made.grid.origin,
            made.grid.resolution,
            folder / name,
            title=title,
            lines=[(way, _WAY)] if made is layered else (),
            footprints=footprints if made is layered else (),
        )
        for made, name, title in (
            (layered, "figure9_layered.png", "Figure 9: a path on the layered costmap"),
            (single, "figure9_single.png", "The same by a costmap of all the robot's height: none"),
        )
    ]
    robot = robot_views(layered.parts, meshes, pose)
    shown = replace(
        view, objects=[*_without_hidden(view.objects), *robot], doors=[], regions=[], path=[]
    )
    pictures.append(
        scene3d(
            [shown],
            folder / "figure9_robot.png",
            boxes=False,
            cut=1.0,
            azimuth=-68,
            elevation=24,
            title="Figure 9: the robot where only the layered costmap has a way",
            width=pixels,
        )
    )
    return pictures


def _way(costmap: Costmap, start: Point, goal: Point) -> NDArray[np.float64] | None:
    cells = np.where(costmap.master >= INSCRIBED, 100, 0).astype(np.int8)
    for point in (start, goal):
        if cells[costmap.grid.cell(*point)]:
            return None
    return grid_path(costmap.grid, cells, start, goal, clearance=0.2)


def _dense(way: NDArray[np.float64], step: float = 0.05) -> NDArray[np.float64]:
    """Points along a way, at most a step apart."""
    parts = []
    for a, b in pairwise(way):
        n = max(2, int(np.ceil(np.linalg.norm(b - a) / step)))
        parts.append(a + (b - a) * np.linspace(0, 1, n, endpoint=False)[:, None])
    return np.concatenate([*parts, way[-1:]])


def _turned(footprint: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    return pose.apply(np.pad(footprint, ((0, 0), (0, 1))))[:, :2]


def _without_hidden(objects: Sequence[ObjectView]) -> list[ObjectView]:
    return [o for o in objects if o.mesh is not None and "robot" not in o.types]
