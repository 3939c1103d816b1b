"""Practice in simulation: actions on an object of the map are tried, and outcomes are stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import (
    CORRECTIONS,
    Attempt,
    learn_grasp,
    opening_mismatch,
    rest_mismatch,
)
from semmap.manipulation.handles import part_pieces
from semmap.manipulation.moving_part import Aim, MovingPart
from semmap.manipulation.openings import find_openings, find_turns
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.part_trial import OpeningOutcome, PartTrial
from semmap.manipulation.places import find_places
from semmap.manipulation.pushes import find_pushes
from semmap.manipulation.pushing import Push
from semmap.manipulation.ranking import grasp_of_row
from semmap.manipulation.reader import STORED, actions_on, in_model
from semmap.manipulation.retrieval import (
    find_grasps,
    gripper_name,
    known_masses,
    stored_gripper,
)
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.model_shapes import model_mesh
from semmap.manipulation.store.tasks import record_task, replace_action
from semmap.manipulation.surroundings import entity_pose
from semmap.manipulation.trial import HEIGHT, Rest, Trial, TrialOutcome, body_of
from semmap.query.snapshot import Snapshot

GRASPS = 100
"""The most grasps of an object that are considered."""

NOT_HELD = "not held"
"""The outcome at a place whose grasp fails."""

STRAY = 0.3
"""Share of the way of a push by which the object may be off at its end."""


def practise(
    seen: Snapshot,
    entity: str,
    gripper: str | None = None,
    *,
    tries: int = 12,
    mass: float | None = None,
    friction: float = 0.5,
    rows: Sequence[dict[str, Any]] | None = None,
    robot: str | None = None,
    counted: bool = True,
    attempt: Callable[[Grasp], TrialOutcome] | None = None,
    simulated: bool = True,
) -> list[dict[str, Any]]:
    """Try grasps of an object until one succeeds; store each outcome, and corrected grasps.

    The stored grasps come first, the best before others; where there is none, they are generated. A
    corrected grasp that succeeds is stored and replaces the one that failed (Tosello et al., IV-C).
    `rows` are grasps of `find_grasps`, by default the best. `attempt` executes a grasp, given in
    the frame of the model, such as by a robot; by default in simulation, with `mass` in kg and the
    `friction` of pads and object, which stands on a table as it does in the map. If not `counted`,
    the caller stores the success; `simulated` outcomes count for the contributor ``simulation``.
    Each attempt has `action_id` of the stored grasp, `family`, `moved` (metres from it), `outcome`
    ("completed" or why it failed) and `stored` (the id of a corrected grasp, or None). LookupError
    without the entity or gripper; ManipulationError without a volume or a free grasp.
    """
    if rows is None:
        found = find_grasps(seen, name=entity, gripper=gripper, limit=GRASPS)
        rows = [row for row in found.rows if row["entity"] == entity]
        if not rows:
            raise ManipulationError("; ".join(found.problems) or f"{entity}: has no free grasp")
    name = gripper_name(seen.session, gripper)
    standing = entity_pose(seen, entity).rotation_matrix
    if attempt is None:
        attempt = _trial(seen, entity, name, mass, friction).run
    hand = stored_gripper(seen.session, name)
    made = learn_grasp(
        [grasp_of_row(row, hand.opening) for row in rows],
        attempt,
        lambda grasp: (standing @ grasp.pose[:3, :3]).T @ np.array([0.0, 0.0, -1.0]),
        tries=tries,
        corrections=CORRECTIONS if hand.cup is None else 0,  # beside its spot, no cup is tight
    )
    with seen.session.transaction():
        return _store(
            seen, entity, name, rows, made, counted=counted, robot=robot, simulated=simulated
        )


def practise_places(
    seen: Snapshot,
    entity: str,
    on: str,
    gripper: str | None = None,
    *,
    tries: int = 12,
    mass: float | None = None,
    friction: float = 0.5,
) -> list[dict[str, Any]]:
    """Try places of an object on another one until it rests there; store each outcome.

    Each attempt has `action_id`, `family`, `off` (metres from where the object should be), `tilted`
    (degrees) and `outcome`; a place whose grasp does not hold the object has none. As `practise`.
    """
    name = gripper_name(seen.session, gripper)
    found = find_places(seen, entity, on, gripper=name, limit=tries)
    if not found.rows:
        raise ManipulationError("; ".join(found.problems) or f"{on}: has no place for {entity}")
    trial = _trial(seen, entity, name, mass, friction)
    stored = actions_on(seen, name=entity, gripper=name, limit=STORED)
    known = {row["action_id"]: row for row in stored if row["entity"] == entity}

    def attempts() -> Iterator[_Attempted]:
        tried = set[int]()
        for row in found.rows:  # at another spot of an even surface, the same happens
            if row["action_id"] not in tried:
                tried.add(row["action_id"])
                to_model = np.linalg.inv(row["spot"].matrix)
                yield row, np.zeros(3), *_put(trial, known[row["grasp_id"]], row, to_model)

    return _until_one_succeeds(seen, entity, "place", attempts())


def try_place(
    seen: Snapshot,
    entity: str,
    gripper: str | None,
    grasp: int,
    place: int,
    *,
    stands: Pose,
) -> str | None:
    """How a place fails in simulation after a grasp, None for a success; nothing is stored.

    ``toppled``, ``strayed``, or `NOT_HELD`, which says nothing of the place. The object `stands` so
    in the map before it is taken. LookupError without the actions.
    """
    name = gripper_name(seen.session, gripper)
    found = {}
    for kind, number in (("grasp", grasp), ("place", place)):
        rows = actions_on(seen, name=entity, gripper=name, kind=kind, limit=STORED)
        known = {row["action_id"]: row for row in rows if row["entity"] == entity}
        if number not in known:
            raise LookupError(f"{entity}: there is no {kind} {number} of it by gripper {name}")
        found[kind] = known[number]
    trial = _trial(seen, entity, name, stands=stands)
    row = found["place"]
    to_model = row["model_pose"].matrix @ np.linalg.inv(row["pose"].matrix)
    return _put(trial, found["grasp"], row, to_model)[1]


def _put(
    trial: Trial, grasp: dict[str, Any], place: dict[str, Any], to_model: NDArray[np.float64]
) -> tuple[Rest, str | None]:
    """How an object rests, and differs from its place; `to_model` leads from the place's frame."""
    before, after = (to_model @ place[pose].matrix for pose in ("pre_pose", "post_pose"))
    rest = trial.put(grasp_of_row(grasp, trial.gripper.opening), before, after)
    held = rest.lifted > HEIGHT / 2
    return rest, rest_mismatch(rest) if held else NOT_HELD


def practise_pushes(
    seen: Snapshot,
    entity: str,
    gripper: str | None = None,
    *,
    tries: int = 12,
    mass: float | None = None,
    friction: float = 0.5,
) -> list[dict[str, Any]]:
    """Try pushes of an object until one moves it along its direction, as `practise_places`."""
    name = gripper_name(seen.session, gripper)
    found = find_pushes(seen, entity, gripper=name, limit=tries)
    if not found.rows:
        raise ManipulationError("; ".join(found.problems) or f"{entity}: has no free push")
    trial = _trial(seen, entity, name, mass, friction)

    def attempts() -> Iterator[_Attempted]:
        for row in found.rows:
            push = Push.of_row(row)
            rest = trial.push(push, push.pose @ np.linalg.inv(row["model_pose"].matrix))
            yield row, push.way, rest, rest_mismatch(rest, push.way, STRAY * push.distance)

    return _until_one_succeeds(seen, entity, "push", attempts())


def practise_openings(
    seen: Snapshot,
    entity: str,
    aim: Aim,
    gripper: str | None = None,
    *,
    tries: int = 12,
    mass: float | None = None,
    friction: float = 0.5,
) -> list[dict[str, Any]]:
    """Try to open or turn a part until it gets there; store each outcome.

    Each attempt has `action_id`, `family`, `opened` (the share of the way) and `outcome`. The part
    is on its joint, which resists as that of a cabinet (`Resistance.usual`). As `practise_pushes`.
    """
    name = gripper_name(seen.session, gripper)
    find = find_openings if aim == "open" else find_turns
    found = find(seen, entity, gripper=name, limit=tries)
    if not found.rows:
        raise ManipulationError("; ".join(found.problems))
    part = MovingPart.of(seen, entity)
    motion = PartMotion.of_numbers(found.rows[0]["motion"])
    trial = _part_trial(seen, part, name, motion, mass, friction)
    told: list[dict[str, Any]] = []
    for row in found.rows:
        outcome = _moved(trial, row)
        cause = opening_mismatch(outcome)
        ends = {"action_id": row["action_id"], "family": row["family"]}
        ends |= {"opened": round(outcome.opened, 3), "outcome": cause or "completed"}
        told.append(ends)
        _record_trial(seen, part.entity, aim, row["action_id"], cause)
        if cause is None:
            break
    return told


def _moved(trial: PartTrial, row: dict[str, Any]) -> OpeningOutcome:
    """The outcome of a stored opening or turn."""
    pose, before = row["model_pose"].matrix, in_model(row, "pre_pose")
    if row["kind"] == "open":
        return trial.open(pose, before, row["pre_posture"])
    return trial.turn(pose, before, row["posture"])


def _part_trial(
    seen: Snapshot,
    part: MovingPart,
    gripper: str,
    motion: PartMotion,
    mass: float | None,
    friction: float,
) -> PartTrial:
    """A trial of a part as it is turned in the map."""
    surface = Mesh(np.asarray(part.mesh.vertices), np.asarray(part.mesh.faces, np.int32))
    weight = known_masses(seen, [part.entity])[part.entity] if mass is None else mass
    pieces = part_pieces(part.mesh, motion)
    body = body_of(surface, mass=weight, friction=friction, pieces=pieces)
    standing = np.eye(4)
    standing[:3, :3] = part.pose.rotation_matrix
    return PartTrial(stored_gripper(seen.session, gripper), body, standing, motion)


_Attempted = tuple[dict[str, Any], NDArray[np.float64], Rest, str | None]
"""An action, the way of the object (3,) that it should lead to, and how it rests, and differs."""


def _until_one_succeeds(
    seen: Snapshot, entity: str, kind: str, attempts: Iterator[_Attempted]
) -> list[dict[str, Any]]:
    """Store the outcomes of simulated attempts; return them as rows of the answer."""
    told = []
    for row, way, rest, cause in attempts:
        told.append(
            {
                "action_id": row["action_id"],
                "family": row["family"],
                "off": round(float(np.linalg.norm(np.subtract(rest.moved, way))), 4),
                "tilted": round(float(np.degrees(rest.tilted)), 1),
                "outcome": cause or "completed",
            }
        )
        if cause != NOT_HELD:
            _record_trial(seen, entity, kind, row["action_id"], cause)
        if cause is None:
            break
    return told


def _record_trial(seen: Snapshot, entity: str, kind: str, action: int, cause: str | None) -> None:
    """Store how a simulated attempt ended."""
    outcome = "completed" if cause is None else "error"
    values: dict[str, Any] = {"outcome": outcome, "simulated": True, "message": cause}
    record_task(seen.session, entity, kind, action=action, **values)


def _trial(
    seen: Snapshot,
    entity: str,
    gripper: str,
    mass: float | None = None,
    friction: float = 0.5,
    stands: Pose | None = None,
) -> Trial:
    """A trial of an object as it stands in the map, or at a pose."""
    mesh = model_mesh(seen, entity)
    surface = Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32))
    weight = known_masses(seen, [entity])[entity] if mass is None else mass
    body = body_of(surface, mass=weight, friction=friction)
    standing = np.eye(4)
    standing[:3, :3] = (stands or entity_pose(seen, entity)).rotation_matrix
    standing[2, 3] = 5e-4 - (surface.vertices @ standing[:3, :3].T)[:, 2].min()
    return Trial(stored_gripper(seen.session, gripper), body, standing)


def _store(
    seen: Snapshot,
    entity: str,
    gripper: str,
    rows: Sequence[dict[str, Any]],
    made: Sequence[Attempt],
    *,
    counted: bool,
    **values: Any,
) -> list[dict[str, Any]]:
    """Store attempts; failures of corrected grasps count for none."""
    told: list[dict[str, Any]] = []
    tried = -1
    for attempt in made:
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
        counts = counted or attempt.cause is not None
        if moved > 0 and attempt.cause is None:
            stored = add_actions(seen.session, entity, gripper, [attempt.grasp])[0]
            if rows[tried].get("link") is None:  # a linked model keeps its own grasps
                replace_action(seen.session, action, stored)
        if counts and (moved == 0 or stored is not None):
            record_task(
                seen.session,
                entity,
                action=stored or action,
                outcome=outcome,
                message=attempt.cause,
                **values,
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
