"""How an object of the map is pushed: stored pushes before generated ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from semmap.arrays import Floats
from semmap.finite_number import is_finite_number
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import support_surfaces
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.arm import Arm
from semmap.manipulation.automata import reachable_rows
from semmap.manipulation.collision import Obstacles
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.found_actions import FoundActions
from semmap.manipulation.pushing import Push, free_pushes, push_candidates
from semmap.manipulation.ranking import ranked
from semmap.manipulation.reader import STORED, actions_on
from semmap.manipulation.retrieval import gripper_name, stored_gripper
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.model_shapes import model_mesh, shape_of
from semmap.manipulation.suitability import reasons_against
from semmap.manipulation.surroundings import entity_pose, obstacles_around
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot

LEVEL = 0.02
"""The largest rise of a push that counts as level, a share of its length."""

TOUCH = 0.02
"""Metres between the lowest point of an object and the surface that it stands on."""

STEP = 22.5
"""Degrees by which families of pushes differ."""


def find_pushes(
    seen: Snapshot,
    entity: str,
    *,
    gripper: str | None = None,
    distance: float = 0.1,
    arm: Arm | None = None,
    base: Pose | None = None,
    limit: int = 10,
) -> FoundActions:
    """The best level pushes of an object by `distance` metres; generated where none is stored.

    The object stays on its support, and neither it nor the closed gripper meets anything. With an
    arm of this gripper whose robot stands at `base`, map's frame, only those that it reaches. Rows
    are those of `actions_on`, with `end` (the pose of the gripper where the push ends), and
    `direction`, degrees in the map's frame; with an arm, `position` of its joints where the
    approach begins. LookupError without the entity or gripper; ManipulationError where it has no
    mesh, or stands on nothing level, or the distance is not above 0.
    """
    number = entity_id(seen.session, entity)
    if not (is_finite_number(distance) and distance > 0):
        raise ManipulationError(f"{entity}: distance is {distance}: give metres above 0")
    chosen = gripper_name(seen.session, gripper)
    hand = stored_gripper(seen.session, chosen)
    if hand.cup is not None:
        why = f"{entity}: gripper {chosen} is a suction cup, whose soft lip pushes nothing along"
        return FoundActions([], [why])
    vertices = np.asarray(model_mesh(seen, entity).vertices)
    shape = shape_of(seen, entity)
    excluded = reasons_against(seen, "push", hand.kind, [number])
    if excluded:
        return FoundActions([], [*excluded.values()])
    model = entity_pose(seen, entity).matrix
    obstacles = obstacles_around(seen, entity)
    surface = _surface(entity, vertices, model, obstacles)
    rows, generated = _stored(seen, entity, chosen, distance), []
    if not rows:
        pushes = push_candidates(vertices, model, hand, distance=distance)
        turned = (model[:3, :3] @ shape.pose[:3, :3]).T
        records = [_record(push, shape.kind, turned) for push in pushes]
        add_actions(seen.session, entity, chosen, records, frame="map")
        rows, generated = _stored(seen, entity, chosen, distance), [entity]
    pushes = [Push.of_row(row) for row in rows]
    free = free_pushes(pushes, vertices, model, hand, surface, obstacles)
    found = [rows[i] for i in np.flatnonzero(free)]
    if not found:
        problem = f"{entity}: at all {len(rows)} pushes, it or the gripper meets what is around"
        return FoundActions([], [problem], generated)
    if arm is None or base is None:
        return FoundActions(found[:limit], [], generated)
    where = f"the arm at ({base.x:g}, {base.y:g})"
    problem = f"{entity}: {where} reaches none of {len(found)} free pushes"
    reached = reachable_rows(found, arm, base, limit)
    return FoundActions(reached, [] if reached else [problem], generated)


def _surface(entity: str, vertices: Floats, model: Floats, obstacles: Obstacles) -> Polygon:
    """The outline of what an object stands on."""
    placed = vertices @ model[:3, :3].T + model[:3, 3]
    lowest = placed[:, 2].min()
    near = obstacles.within(
        np.array([-np.inf, -np.inf, lowest - 0.1]), np.array([np.inf, np.inf, lowest + 0.1])
    ).triangles
    hull = shapely.convex_hull(shapely.multipoints(placed[:, :2]))
    for patch in support_surfaces(Mesh.of_triangles(near)):
        if abs(patch.height - lowest) < TOUCH and patch.outline.intersects(hull.centroid):
            return patch.outline
    raise ManipulationError(f"{entity}: stands on nothing level, so it cannot be pushed along it")


def _stored(seen: Snapshot, entity: str, gripper: str, distance: float) -> list[dict[str, Any]]:
    """The stored pushes that are level for the object as it stands, with their ends."""
    rows = actions_on(seen, name=entity, gripper=gripper, kind="push", limit=STORED)
    found = []
    for row in ranked(seen.session, rows, gripper, "push"):
        turn = row["pose"].rotation_matrix @ row["model_pose"].rotation_matrix.T
        x, y, z = way = turn @ np.array(row["motion"])
        length = float(np.linalg.norm(way))
        if abs(length - distance) <= 1e-3 and abs(z) <= LEVEL * length:
            end = row["pose"].matrix.copy()
            end[:3, 3] += way
            degrees = round(float(np.degrees(np.arctan2(y, x))) % 360, 1) % 360
            found.append(row | {"end": Pose.from_matrix(end), "direction": degrees})
    return found


def _record(push: Push, shape: str, turned: Floats) -> ActionRecord:
    """A push to store; `turned` (3, 3) leads from the map's frame to that of the shape."""
    along = np.append(push.direction, 0)
    return ActionRecord(
        "push",
        Pose.from_matrix(push.pose),
        pre_pose=Pose.from_matrix(push.pre_push),
        motion=tuple((push.distance * along).tolist()),
        approach="level",
        family=_family(shape, turned @ along, turned[:, 2]),
        posture=push.posture,
        pre_posture=push.posture,
        quality=push.quality,
    )


def _family(kind: str, along: Floats, up: Floats) -> str:
    """The direction of a push in the frame of its shape, such as ``x 45, z up``."""
    if kind == "sphere":
        return "any"
    axis = int(np.argmax(np.abs(up).round(6)))
    side = "r" if kind != "cuboid" and axis < 2 else "xyz"[axis]
    if side == "z" and kind != "cuboid":
        return "r, z up"
    first, second = ((1, 2), (2, 0), (0, 1))[axis]
    angle = np.degrees(np.arctan2(abs(along[second]), abs(along[first])))
    return f"{'xyz'[first]} {STEP * round(angle / STEP):g}, {side} up"
