"""Turns: the closed fingers push a part about its hinge (Tosello et al., section III-A).

The finger comes straight in the direction in which the part begins to move, and then goes round
with it. It pushes where the lever is long and the surface looks squarely at it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semmap.arrays import Floats
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.pushing import SAFETY, TIP
from semmap.manipulation.surface_grasps import surface_of

if TYPE_CHECKING:
    import trimesh

SQUARELY = 0.9
"""The least cosine between a push and the normal of the surface."""

FINGER = 0.012
"""Metres around a contact that are free behind it, and are on the part."""

APART = 0.03
"""Metres between contacts."""

MOST = 60
"""Contacts of a part."""


def turn_records(mesh: trimesh.Trimesh, motion: PartMotion, gripper: Gripper) -> list[ActionRecord]:
    """Turns of a part about its hinge, the best first, in the frame of the model.

    ManipulationError for a slide. The quality is the share of the longest lever, by the cosine
    between push and normal.
    """
    if not motion.is_hinge:
        raise ManipulationError("a part on a slide cannot be turned: open it, or push it")
    points, headings, quality = turn_contacts(mesh, motion)
    posture = dict(gripper.postures[-1])
    found = []
    for point, heading, good in zip(points, headings, quality, strict=True):
        for pose in _poses(point, heading, motion.direction, gripper):
            is_along = abs(pose[:3, 0] @ motion.direction) > 0.7
            before = pose.copy()
            before[:3, 3] -= SAFETY * heading
            found.append(
                ActionRecord(
                    "turn",
                    Pose.from_matrix(pose),
                    pre_pose=Pose.from_matrix(before),
                    motion=motion.numbers,
                    approach="square",  # to the hinge's axis, whatever is up
                    family="hinge along" if is_along else "hinge across",
                    posture=posture,
                    pre_posture=posture,
                    quality=float(good),
                )
            )
    return found


def turn_contacts(mesh: trimesh.Trimesh, motion: PartMotion) -> tuple[Floats, Floats, Floats]:
    """Where a finger pushes a part: points and headings (N, 3), qualities (N,), the best first."""
    surface = surface_of(mesh, np.zeros(3))
    points, headings = surface.points, motion.headings(surface.points)
    levers = motion.levers(points)
    square = -np.einsum("ni,ni->n", surface.normals, headings)
    if not mesh.is_volume:  # whose normals may look inwards
        square = np.abs(square)
    quality = square * levers / levers.max()
    order = np.argsort(-quality, kind="stable")
    order = order[(square[order] > SQUARELY) & (levers[order] > levers.max() / 2)]
    chosen: list[int] = []
    for i in order:
        if chosen and np.linalg.norm(points[chosen] - points[i], axis=1).min() < APART:
            continue
        if _is_open(surface.points, points[i], headings[i]):
            chosen.append(int(i))
        if len(chosen) == MOST:
            break
    return points[chosen], headings[chosen], quality[chosen]


def _is_open(points: Floats, at: Floats, heading: Floats) -> bool:
    """Whether nothing of the part is behind a contact, and the part is all around it."""
    away = points - at
    along = away @ heading
    across = away - along[:, None] * heading
    near = np.linalg.norm(across, axis=1) < FINGER
    if (along[near] < -FINGER / 2).any():
        return False
    rim = near & (np.abs(along) < FINGER / 2)
    side = np.linalg.svd(heading[None])[2][1:]
    flat = across[rim] @ side.T
    quarters = {(x > 0, y > 0) for x, y in flat[np.linalg.norm(flat, axis=1) > FINGER / 2]}
    return len(quarters) == 4


def _poses(point: Floats, heading: Floats, axis: Floats, gripper: Gripper) -> list[Floats]:
    """Poses (4, 4) of the closed gripper at a contact, turned by quarters about the heading."""
    tip = float(gripper.reaches[-1]) + TIP
    across = np.cross(axis, heading)
    across = across / np.linalg.norm(across)
    other = np.cross(heading, across)
    found = []
    for x in (across, other) if gripper.is_symmetric else (across, other, -across, -other):
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([x, np.cross(heading, x), heading])
        pose[:3, 3] = point - tip * heading - gripper.aside[-1] * x
        found.append(pose)
    return found
