"""Grasps of what sticks out of a part that opens: the handle or knob of a door or drawer.

A part begins to move towards its front. What sticks out before the front's outermost large face is
held best, and of a door far from its hinge. A part from which nothing sticks out is held anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.candidates import FRICTION, Grasps
from semmap.manipulation.convex_pieces import convex_pieces
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.surface_grasps import surface_grasps, surface_of

if TYPE_CHECKING:
    import trimesh

STICKS_OUT = 0.006
"""Metres beyond the face of a part from which on a surface is a handle."""

FACE = 0.15
"""The share of what faces the front that handles have, at most."""

FACING = 0.9
"""The cosine to the front from which on a triangle faces it."""

SMALLEST = 2e-4
"""Square metres of a surface that is held, at least."""

BODIES = 50
"""The most bodies of a mesh that are simulated one by one."""

OUTER = 0.5
"""The share of the longest lever beyond which a door without a handle is held."""


def handle_surfaces(mesh: trimesh.Trimesh, motion: PartMotion) -> list[trimesh.Trimesh]:
    """The parts of a mesh that a gripper holds to open it, all in the frame of the model.

    What sticks out of the front, towards which the part begins to move; of a hinge, then what
    sticks out of the back. Where neither does, all that is far enough from the axis.
    """
    found = [handle for handle, _, _ in _handles(mesh, motion)]
    if found:
        return found
    levers = motion.levers(np.asarray(mesh.triangles_center))
    outer: Any = mesh.submesh([np.flatnonzero(levers >= OUTER * levers.max())], append=True)
    return [outer]


def part_pieces(mesh: trimesh.Trimesh, motion: PartMotion) -> tuple[Mesh, ...]:
    """Convex pieces of a part for simulation: handles are cut off first, to be cut more finely.

    The bodies of a mesh are cut on their own, so that those of a drawer stay as they are.
    """
    parts, left = [], mesh
    for handle, normal, height in _handles(mesh, motion):
        parts.append(handle)
        left = left.slice_plane(height * normal, -normal)
    found: list[Mesh] = []
    for part in (*parts, left):
        bodies = part.split(only_watertight=False)
        for body in bodies if 1 < len(bodies) <= BODIES else [part]:
            with suppress(ManipulationError):  # a flat one
                solid = Mesh(np.asarray(body.vertices), np.asarray(body.faces, np.int32))
                found += convex_pieces(solid)
    return tuple(found)


def _handles(
    mesh: trimesh.Trimesh, motion: PartMotion
) -> Iterator[tuple[trimesh.Trimesh, Floats, float]]:
    """What sticks out of a part, with the normal and the height of the plane that cuts it off."""
    for side in (1, -1) if motion.is_hinge else (1,):
        front = front_of(mesh, side * _heading(mesh, motion))
        if front is None:
            continue
        normal, height = front[0], front[1] + STICKS_OUT
        if (np.asarray(mesh.vertices) @ normal).max() <= height:
            continue
        handle = mesh.slice_plane(height * normal, normal)
        if handle is not None and handle.area > SMALLEST:
            yield handle, normal, height


def front_of(mesh: trimesh.Trimesh, heading: Floats) -> tuple[Floats, float] | None:
    """The normal (3,) of the face of a part that looks to a heading, and its place along it.

    It is the outermost plane before which less than `FACE` of all that looks there lies, by area;
    None where nothing looks there.
    """
    normals, areas = np.asarray(mesh.face_normals), np.asarray(mesh.area_faces)
    facing = np.flatnonzero(normals @ heading > 0.7)
    if not len(facing):
        return None
    rounded = normals[facing].round(2)
    kinds, kind = np.unique(rounded, axis=0, return_inverse=True)
    largest = np.bincount(kind.ravel(), areas[facing]).argmax()
    normal = kinds[largest] / np.linalg.norm(kinds[largest])
    facing = np.flatnonzero(normals @ normal > FACING)
    heights = np.asarray(mesh.triangles_center)[facing] @ normal
    order = np.argsort(-heights)
    before = np.cumsum(areas[facing][order])
    at = int(np.searchsorted(before, FACE * before[-1]))
    return normal, float(heights[order][min(at, len(order) - 1)])


def opening_grasps(
    mesh: trimesh.Trimesh,
    motion: PartMotion,
    gripper: Gripper,
    friction: float = FRICTION,
    upright: ArrayLike = (0, 0, 1),
) -> Grasps:
    """Grasps of the handle of a part, the best first, in the frame of the model.

    The quality is that of `surface_grasps` on the handle, by the share of the longest lever.
    `upright` (3,) is the unit vector that is up in the map; families of slides are by it.
    """
    longest = float(motion.levers(np.asarray(mesh.vertices)).max())
    every = []
    for handle in handle_surfaces(mesh, motion):
        middle = np.average(handle.triangles_center, axis=0, weights=handle.area_faces)
        surface = surface_of(handle, np.asarray(middle))
        found = surface_grasps(surface, gripper, mesh.triangles, friction=friction)
        pads = np.einsum("nij,nj->ni", found.poses[:, :3, :3], gripper.pads_at(found.widths))
        levers = motion.levers(found.poses[:, :3, 3] + pads)
        every.append(replace(found, qualities=found.qualities * levers / longest))
    axis = motion.direction if motion.is_hinge else np.asarray(upright)
    return _named(Grasps.joined(every), _heading(mesh, motion), axis, motion.is_hinge)


def opening_records(grasps: Grasps, motion: PartMotion) -> list[ActionRecord]:
    """Openings to store, of grasps of a handle: all in the frame of the model."""
    return [
        ActionRecord(
            "open",
            Pose.from_matrix(grasp.pose),
            pre_pose=Pose.from_matrix(grasp.pre_grasp),
            post_pose=Pose.from_matrix(motion.at(1) @ grasp.pre_grasp),
            motion=motion.numbers,
            approach=grasp.approach,
            family=grasp.family,
            width=grasp.width,
            posture=grasp.posture,
            pre_posture=grasp.pre_posture,
            quality=grasp.quality,
        )
        for grasp in grasps
    ]


def _heading(mesh: trimesh.Trimesh, motion: PartMotion) -> Floats:
    """Where a part begins to move, by its outer half, a unit vector (3,)."""
    centres, areas = np.asarray(mesh.triangles_center), np.asarray(mesh.area_faces)
    levers = motion.levers(centres)
    outer = levers >= OUTER * levers.max()
    mean = np.average(motion.headings(centres[outer]), axis=0, weights=areas[outer])
    heading: Floats = mean / max(float(np.linalg.norm(mean)), 1e-12)
    return heading


def _named(grasps: Grasps, heading: Floats, axis: Floats, is_hinge: bool) -> Grasps:
    """Grasps with the side from which they come, and how they close: along the axis, out, across.

    The axis is that of the hinge, or the upright of a slide; the family tells which.
    """
    forward = -grasps.poses[:, :3, 2] @ heading
    approaches = np.select([forward > 0.7, forward < -0.7], ["front", "back"], "side")
    closing = grasps.poses[:, :3, 0]
    out = np.abs(closing @ heading)
    along = np.abs(closing @ axis)
    ways: NDArray[np.str_] = np.select([out > 0.7, along > 0.7], ["out", "along"], "across")
    kind = "hinge" if is_hinge else "slide"
    families = [f"{kind} {a} {w}" for a, w in zip(approaches, ways, strict=True)]
    return replace(grasps, approaches=approaches, families=np.array(families, np.str_))
