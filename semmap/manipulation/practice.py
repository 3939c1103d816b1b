"""Practice in simulation: grasps of an object of the map are tried, and the outcomes are stored."""

from __future__ import annotations

from typing import Any

import numpy as np

from semmap.belief.store import MapConnection, driver
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.manipulation.action_store import add_actions
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.device_store import gripper_id
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import Lesson, learn_grasp
from semmap.manipulation.retrieval import find_grasps, stored_gripper
from semmap.manipulation.shape_store import model_mesh
from semmap.manipulation.task_store import record_task
from semmap.manipulation.trial import Trial, body_of

__all__ = ["practise"]

GRASPS = 100
"""The most grasps of an object that are considered."""


def practise(
    connection: MapConnection,
    entity: str,
    gripper: str | None = None,
    *,
    tries: int = 12,
    mass: float | None = None,
    friction: float = 0.5,
) -> list[dict[str, Any]]:
    """Try grasps of an object until one succeeds; store each outcome and what worked.

    The stored grasps come first, the best before others; where there is none, they are generated.
    The object stands on a table as it does in the map. A corrected grasp that succeeds is stored
    and replaces the one that failed (Tosello et al., section IV-C).

    Returns
    -------
    list of dict
        For each attempt: `action_id` of the stored grasp, `family`, `moved` (metres from it),
        `outcome` ("completed" or why it failed), `stored` (the id of a corrected grasp, or None).

    Raises
    ------
    LookupError
        There is no such entity or gripper.
    ManipulationError
        The object has no mesh with a volume, or no grasp is free.
    """
    session = driver(connection)
    found = find_grasps(session, name=entity, gripper=gripper, limit=GRASPS)
    rows = [row for row in found.rows if row["entity"] == entity]
    if not rows:
        raise ManipulationError("; ".join(found.problems) or f"{entity}: has no free grasp")
    ((name,),) = session.execute(
        "SELECT name FROM device WHERE id = %s", (gripper_id(session, gripper),)
    ).fetchall()
    hand = stored_gripper(session, name)
    mesh = model_mesh(session, entity)
    ((weight, pose),) = session.execute(
        "SELECT (e.properties->>'mass')::float8, w.pose FROM entity e "
        "JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = (SELECT current_map()) AND e.name = %s",
        (entity,),
    ).fetchall()
    surface = Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32))
    body = body_of(surface, mass=mass if mass is not None else weight or None, friction=friction)
    standing = np.eye(4)
    standing[:3, :3] = Pose(*pose).matrix[:3, :3]
    standing[2, 3] = 5e-4 - (surface.vertices @ standing[:3, :3].T)[:, 2].min()
    trial = Trial(hand, body, standing)
    grasps = [_grasp(row, hand.opening) for row in rows]
    lesson = learn_grasp(
        grasps,
        trial.run,
        lambda grasp: (standing @ grasp.pose)[:3, :3].T @ np.array([0.0, 0.0, -1.0]),
        tries=tries,
    )
    with session.transaction():
        return _store(session, entity, name, rows, lesson)


def _grasp(row: dict[str, Any], opening: float) -> Grasp:
    """A stored grasp in the frame of the model."""
    pose = row["model_pose"].matrix
    before = pose.copy()
    if row["pre_pose"] is not None:
        before = pose @ np.linalg.inv(row["pose"].matrix) @ row["pre_pose"].matrix
    return Grasp(
        pose,
        before,
        opening if row["width"] is None else row["width"],
        row["approach"] or "",
        row["family"] or "",
        row["expected"],
        row["posture"],
        row["pre_posture"],
    )


def _store(
    session: Any, entity: str, gripper: str, rows: list[dict[str, Any]], lesson: Lesson
) -> list[dict[str, Any]]:
    """Store the attempts of a lesson; failures of corrected grasps count for none."""
    told: list[dict[str, Any]] = []
    tried = -1
    for attempt in lesson.attempts:
        moved = float(np.linalg.norm(attempt.correction))
        if moved == 0:
            tried = next(
                i
                for i in range(tried + 1, len(rows))
                if np.allclose(rows[i]["model_pose"].matrix, attempt.grasp.pose)
            )
        action = rows[tried]["action_id"]
        outcome = "completed" if attempt.cause is None else "error"
        stored = None
        if moved == 0:
            record_task(
                session,
                entity,
                action=action,
                outcome=outcome,
                simulated=True,
                message=attempt.cause,
            )
        elif attempt.cause is None:
            stored = add_actions(session, entity, gripper, [attempt.grasp])[0]
            record_task(
                session, entity, action=stored, outcome=outcome, simulated=True, instead_of=action
            )
        told.append(
            {
                "action_id": action,
                "family": attempt.grasp.family,
                "moved": round(moved, 4),
                "outcome": attempt.cause or outcome,
                "stored": stored,
            }
        )
    return told
