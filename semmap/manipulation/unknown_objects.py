"""Grasps of what the map does not have: a shape alone, or what stands at a point of a cloud.

Nothing is stored: there is no model that the grasps belong to.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from semmap.arrays import Floats
from semmap.belief.store.beliefs import Session
from semmap.finite_number import finite_numbers
from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasps, grasp_candidates
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.found_actions import FoundActions
from semmap.manipulation.generation import shape_grasps
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.reader import actions_by_shape
from semmap.manipulation.retrieval import (
    gripper_or_urdf,
    is_urdf,
    misfit,
    slanting,
    stored_gripper,
    usual_gripper,
)
from semmap.manipulation.steadiness import steady_rows, unsteady
from semmap.manipulation.store.model_shapes import StoredShape
from semmap.manipulation.suction_grasps import suction_grasps
from semmap.manipulation.surface_grasps import SampledSurface, surface_grasps

SPLAT = 0.004
"""Metres of the triangle that stands for a point which the gripper must not touch."""

CLOSED = 6.0
"""Spacings of points across triangles that stand for a surface without a hole."""

TABLE = 1.0
"""Metres of the table around an object: a camera does not see it below and behind."""

FEWEST = 40
"""Points of a cluster."""


def grasps_of_shape(
    session: Session,
    shape: str,
    size: Sequence[float],
    *,
    gripper: str | Path | None = None,
    kind: str = "grasp",
    limit: int = 10,
    stored: bool = False,
    **options: Any,
) -> FoundActions:
    """The stored actions of `actions_by_shape`; where there are none, candidates of the shape.

    The gripper of a URDF is stored first. Only stored ones, if `stored`.
    """
    with session.transaction():
        hand = gripper_or_urdf(session, gripper)
        rows = actions_by_shape(
            session, shape, size, gripper=hand, kind=kind, limit=limit, **options
        )
        if rows or stored or kind != "grasp":
            return FoundActions(rows, [] if rows else [f"no {kind} of a similar {shape} is stored"])
        name, held = _gripper(session, hand)
    solid = StoredShape(shape, tuple(float(side) for side in size), np.eye(4))
    text = f"{shape} of {' x '.join(f'{side:g}' for side in size)} m"
    found = shape_grasps(solid, held)
    if not len(found):
        return FoundActions([], [misfit(text, solid, name, held.opening, held.kind)])
    return FoundActions(_rows(text, found, limit), generated=[text])


def grasps_in_cloud(
    session: Session,
    points: ArrayLike,
    at: Sequence[float],
    *,
    gripper: str | Path | None = None,
    tolerance: float = 0.05,
    limit: int = 10,
) -> FoundActions:
    """The free grasps of the object at a point of a cloud of a table, in the cloud's frame.

    Parameters
    ----------
    points : (n, 3) or (height, width, 3) metres, z up; NaN where the camera saw nothing
    at : (x, y, z) on the object, or within `tolerance` of it, metres

    Raises
    ------
    LookupError
        No object is at the point: the message names the nearest one.
    ValueError
        A cloud without a table, see `segment_tabletop`.
    """
    from semmap.perception.plane import Plane
    from semmap.perception.point_cloud import surfels
    from semmap.perception.primitives import fit_primitive
    from semmap.perception.tabletop import segment_tabletop

    place = finite_numbers(at, 3)
    if place is None:
        raise ManipulationError(f"a point is x, y, z in metres, not {list(at)}")
    if is_urdf(gripper or ""):
        held = read_gripper(Path(gripper or ""))
        name = held.name
    else:
        name, held = _gripper(session, None if gripper is None else str(gripper))
    seen = segment_tabletop(points, fewest=FEWEST)
    apart = [float(cKDTree(cluster).query(place)[0]) for cluster in seen.clusters]
    if not apart or min(apart) > tolerance:
        near = f"; the nearest is {min(apart):.2g} m away" if apart else ""
        where = ", ".join(f"{value:g}" for value in place)
        raise LookupError(f"no object stands at {where} in the cloud{near}")
    number = int(np.argmin(apart))
    cluster, plane = seen.clusters[number], seen.plane
    assert isinstance(plane, Plane)
    shape = fit_primitive(cluster, table=plane)
    known = surfels(cluster)
    centre = shape.pose[:3, 3]
    item = _splats(known.points, known.normals)
    rest = [seen.surface, *(c for k, c in enumerate(seen.clusters) if k != number)]
    others = np.concatenate(rest)
    table = _splats(others, np.tile(plane.normal, (len(others), 1)))
    below = _sheet(plane, centre)
    if held.cup is None:
        surface = SampledSurface(known.points, known.normals, centre)
        every = [
            grasp_candidates(shape, held),
            surface_grasps(surface, held, item, frame=shape.pose),
        ]
        found = Grasps.joined(every)
    else:
        found = _cup_grasps(known.points, known.normals, centre, held, shape.pose)
    if not len(found):
        return FoundActions([], [misfit("the object", shape, name, held.opening, held.kind)])
    level = found[np.flatnonzero([held.can_tilt_to(pose) for pose in found.poses])]
    if not len(level):
        return FoundActions([], [slanting("the object", len(found), name)])
    around = Obstacles(np.concatenate([table, below]))
    free = level[np.flatnonzero(free_grasps(level, np.eye(4), around, item=Obstacles(item)))]
    if not len(free):
        why = f"the object: at all {len(level)} grasps, the gripper touches what is beside it"
        return FoundActions([], [why])
    rows = [row | {"model_pose": row["pose"]} for row in _rows("the object", free)]
    steady = sorted(steady_rows(rows, shape, held), key=lambda row: -row["expected"])
    if not steady:
        return FoundActions([], [unsteady("the object", len(rows), held)])
    return FoundActions(steady[:limit], generated=[f"{shape.kind} at {_text(centre)}"])


def _cup_grasps(
    points: Floats, normals: Floats, centre: Floats, gripper: Gripper, frame: Floats
) -> Grasps:
    """Grasps by a suction cup of the seen side of an object, whose normals lead either way."""
    out = np.einsum("ni,ni->n", points - centre, normals)
    outward = normals * np.where(out < 0, -1, 1)[:, None]
    apart = float(np.median(cKDTree(points).query(points, 2)[0][:, 1]))
    closed = _splats(points, outward, CLOSED * apart)
    surface = SampledSurface(points, outward, centre)
    return suction_grasps(surface, gripper, closed, frame=frame)


def _gripper(session: Session, name: str | None) -> tuple[str, Gripper]:
    """A stored gripper and its name; by default that of robots that state none."""
    if name is not None:
        return name, stored_gripper(session, name)
    return usual_gripper(session)[:2]


def _rows(entity: str, grasps: Grasps, limit: int | None = None) -> list[dict[str, Any]]:
    """Rows with the keys of stored grasps, of grasps that are not stored and that nobody tried."""
    return [
        {
            "entity": entity,
            "action_id": None,
            "object_id": None,
            "approach": grasp.approach,
            "family": grasp.family,
            "expected": grasp.quality,
            "pose": Pose.from_matrix(grasp.pose),
            "pre_pose": Pose.from_matrix(grasp.pre_grasp),
            "post_pose": None,
            "attempts": 0,
            "successes": 0,
            "contributor": None,
            "shift": None,
            "width": grasp.width,
            "posture": grasp.posture,
            "pre_posture": grasp.pre_posture,
            "difference": 0.0,
        }
        for grasp in grasps[: len(grasps) if limit is None else limit]
    ]


def _splats(points: Floats, normals: Floats, size: float = SPLAT) -> Floats:
    """(N, 3, 3) a small triangle across the normal at each point; its circle is `size` wide."""
    aside = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    other = np.cross(normals, aside)
    turns = np.array([0, 2, 4]) * np.pi / 3
    spokes = np.cos(turns)[:, None, None] * aside + np.sin(turns)[:, None, None] * other
    triangles: Floats = (points + size / 2 * spokes).transpose(1, 0, 2)
    return triangles


def _sheet(plane: Any, middle: Floats) -> Floats:
    """(2, 3, 3) a square of a plane below a point."""
    foot = middle - float(plane.height(middle[None])[0]) * plane.normal
    x, y = np.linalg.svd(plane.normal[None])[2][1:] * TABLE / 2
    corners = np.array([foot - x - y, foot + x - y, foot + x + y, foot - x + y])
    return corners[[[0, 1, 2], [0, 2, 3]]]


def _text(place: Floats) -> str:
    return ", ".join(f"{value:.3g}" for value in place)
