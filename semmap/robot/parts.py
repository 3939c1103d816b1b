"""A robot's parts in a joint state, their heights and footprints (Deeken et al., section 4.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.robot.error import RobotError
from semmap.robot.grouping import LinkGroup, find_groups, read_groups
from semmap.robot.urdf import Robot


@dataclass(frozen=True, eq=False)
class Part:
    """A functional unit of a robot: base, arm, pole.

    `interval` is the lowest and the highest z above the ground, `footprint` (N, 2) the convex hull
    of its projection, counter-clockwise, in the robot's frame; `inscribed_radius` is that from the
    robot's origin to the hull's border, 0 where it lies outside of it, `circumscribed_radius` that
    to the farthest corner; all metres.
    """

    name: str
    links: tuple[str, ...]
    interval: tuple[float, float]
    footprint: NDArray[np.float64]
    inscribed_radius: float
    circumscribed_radius: float


def robot_parts(
    robot: Robot,
    state: Mapping[str, float],
    grouping: Path | str | Sequence[LinkGroup] | None = None,
) -> list[Part]:
    """Return the parts of a robot in a joint state; other joints, radians or metres, are at 0.

    The grouping is a YAML file (`read_groups`), or groups; by default they are found
    (`find_groups`). RobotError where the robot cannot take the state, or the grouping does not fit
    it.
    """
    if grouping is None:
        groups: Sequence[LinkGroup] = find_groups(robot)
    elif isinstance(grouping, str | Path):
        groups = read_groups(grouping, robot)
    else:
        groups = grouping
    hulls = robot.hulls(state)
    parts = []
    for group in groups:
        corners = [hulls[link] for link in group.links if link in hulls]
        if not corners:
            raise RobotError(f"{robot.name}: no link of part {group.name} has geometry")
        parts.append(_part(group, np.concatenate(corners)))
    return parts


def _part(group: LinkGroup, points: NDArray[np.float64]) -> Part:
    hull = shapely.MultiPoint(points[:, :2]).convex_hull
    if hull.geom_type != "Polygon":  # a vertical sheet
        hull = hull.buffer(1e-3)
    hull = shapely.geometry.polygon.orient(hull)
    corners = np.array(hull.exterior.coords)[:-1]
    origin = shapely.Point(0, 0)
    inscribed = hull.exterior.distance(origin) if hull.contains(origin) else 0.0
    return Part(
        group.name,
        group.links,
        (float(points[:, 2].min()), float(points[:, 2].max())),
        corners,
        float(inscribed),
        float(np.linalg.norm(corners, axis=1).max()),
    )


def footprint_string(part: Part, tolerance: float = 0.005) -> str:
    """Return a footprint as the value of Nav2's parameter ``footprint``.

    It has few corners, contains the real footprint, and is larger by at most about twice the
    tolerance, metres.

    >>> square = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    >>> footprint_string(Part("base", (), (0.0, 0.3), square, 0.2, 0.283))
    '[[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]'
    """
    hull = shapely.Polygon(part.footprint)
    if len(part.footprint) > 8:
        hull = hull.buffer(tolerance, join_style="mitre").simplify(tolerance).convex_hull
    corners = np.array(shapely.geometry.polygon.orient(hull).exterior.coords)[:-1]
    return "[" + ", ".join(f"[{x:.4g}, {y:.4g}]" for x, y in corners) + "]"
