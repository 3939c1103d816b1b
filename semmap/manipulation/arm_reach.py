"""Whether a robot's arm could act on objects of the map from where its base might stand.

Plans ask before missions try; so nothing is stored, and whether the arm's links touch anything on
the way is left to the mission.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import LevelPatch, support_surfaces
from semmap.manipulation.arm import Arm
from semmap.manipulation.automata import STARTS, Reach, facing_first
from semmap.manipulation.placing import spots_on
from semmap.manipulation.surroundings import Surroundings, entity_triangles
from semmap.query.snapshot import Snapshot

ABOVE = (0.05, 0.2)
"""Metres above a surface at which the gripper lets go of what it puts down: of low or high grasps.
"""

FEW = 4
"""Grasps within reach of which one is often free; else it is asked which ones are."""

SPACING = 0.1
"""Metres between the spots of a surface that are tried."""

SPOTS = 3
"""Spots of each level of a surface that are tried, the nearest to the base."""

DOWN, TURN = (180.0, 135.0, 90.0), (0.0, 90.0)
"""Degrees of the ways in which the gripper puts something down: it points down, slanting or ahead,
and is turned about its own axis."""


def grasp_reach(
    seen: Snapshot, rows: Sequence[dict[str, Any]], arm: Arm, *, beneath: bool = False
) -> Callable[[Pose], bool]:
    """Whether the arm takes an object from a base pose by one of its grasps (`known_grasps`).

    Only those count at which the gripper is free of what is around, unless all touch something, or
    the object is `beneath` others, which are taken off before.
    """
    around, reach = Surroundings(seen, arm.gripper), Reach(arm)

    @cache
    def free() -> list[dict[str, Any]]:
        return list(rows) if beneath else around.free_rows(rows) or list(rows)

    def reached(some: Sequence[dict[str, Any]], base: Pose) -> Iterator[dict[str, Any]]:
        turns = _by_turns(facing_first(some, base))
        return (row for row in turns if reach.along(row, base) is not None)

    def takes(base: Pose) -> bool:
        first = list(islice(reached(rows, base), FEW))
        if not first:
            return False
        return bool(around.free(first).any()) or any(True for _ in reached(free(), base))

    return takes


def _by_turns(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first grasp of each family, then the second ones, and so on: those alike fail alike."""
    count: Counter[str | None] = Counter()
    turns = []
    for row in rows:
        turns.append(count[row["family"]])
        count[row["family"]] += 1
    return [rows[i] for i in np.argsort(turns, kind="stable")]


def surface_reach(seen: Snapshot, on: str, arm: Arm) -> Callable[[Pose], bool] | None:
    """Whether the arm brings its gripper over an object's surfaces from a base pose.

    None without a surface.
    """
    surfaces = support_surfaces(Mesh.of_triangles(entity_triangles(seen, on)))
    levels = [_spots(surface) for surface in surfaces]

    def puts(base: Pose) -> bool:
        for level in levels:
            spots = base.inverse().apply(level)
            nearest = np.argsort(np.linalg.norm(spots[:, :2], axis=1), kind="stable")[:SPOTS]
            if any(_reaches_over(arm, spot) for spot in spots[nearest]):
                return True
        return False

    return puts if levels else None


def _spots(surface: LevelPatch) -> Floats:
    """(N, 3) points of a surface."""
    spots = spots_on(surface.outline, SPACING)
    if not len(spots):
        spots = shapely.get_coordinates(surface.outline.representative_point())
    return np.column_stack([spots, np.full(len(spots), surface.height)])


def _reaches_over(arm: Arm, spot: Floats) -> bool:
    """Whether the grasp frame gets above a spot (3,), robot's frame, in a usual direction."""
    heading = math.degrees(math.atan2(spot[1], spot[0]))
    angles = [(heading, down, turn) for down in DOWN for turn in TURN]
    ways = Rotation.from_euler("ZYZ", angles, degrees=True).as_matrix()
    for up in ABOVE:
        pose = np.eye(4)
        pose[:3, 3] = spot[0], spot[1], spot[2] + up
        if arm.is_far(pose[:3, 3]) or not arm.reaches_point(pose[:3, 3], starts=STARTS):
            continue
        for pose[:3, :3] in ways:
            if arm.reach(pose, starts=STARTS) is not None:
                return True
    return False
