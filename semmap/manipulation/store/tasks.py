"""Tasks into the database: attempts of actions, with their outcomes."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from semmap.belief.store.beliefs import Session
from semmap.manipulation.action_record import pose_of
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.database_answers import (
    ASSUMED,
    SIMULATION,
    contributor_id,
    number,
    refusals,
)
from semmap.query.entity_query import entity_id


def add_task(
    session: Session,
    entity: str,
    kind: str = "grasp",
    *,
    action: int | None = None,
    robot: str | None = None,
    start: Any = None,
    goal: Any = None,
    deadline: datetime | None = None,
    outcome: str = "to run",
    message: str | None = None,
    simulated: bool = False,
    assumed: bool = False,
) -> int:
    """Store a task, or an attempt that has ended; return its id.

    The object goes from `start` to `goal`, map's frame, by default from where it is now; the
    deadline has a time zone. The outcome is to run, running, completed or error; the last two count
    for the action: if `simulated` for the contributor ``simulation``, which is trusted less; if
    `assumed`, where a robot was simulated and nothing was tried, for ``assumed``, which counts for
    nothing. LookupError without the entity or action, ManipulationError where a value is not
    allowed.
    """
    if deadline is not None and deadline.tzinfo is None:
        raise ManipulationError(f"the deadline {deadline.isoformat()} has no time zone: add one")
    of_entity = entity_id(session, entity)
    if action is not None:
        _check_action(session, action)
    begins = None if start is None else pose_of(start, "start").row
    ends = None if goal is None else pose_of(goal, "goal").row
    made_by = ASSUMED if assumed else SIMULATION if simulated else None
    source = None if made_by is None else contributor_id(session, made_by)
    with refusals():
        return number(
            session.execute(
                "INSERT INTO task (map_id, robot_id, kind, entity_id, action_id, start, goal, "
                f"deadline, outcome, message{', contributor_id' if source else ''}) "
                "VALUES (current_map(), %s, %s, %s, %s, coalesce(%s::float8[], "
                "(SELECT pose FROM world WHERE entity_id = %s)), %s, %s, %s, %s"
                f"{', %s' if source else ''}) RETURNING id",
                (
                    None if robot is None else entity_id(session, robot),
                    kind,
                    of_entity,
                    action,
                    begins,
                    of_entity,
                    ends,
                    deadline,
                    outcome,
                    message,
                    *((source,) if source else ()),
                ),
            )
        )


def _check_action(session: Any, action: int) -> None:
    with refusals():
        known = session.execute("SELECT 1 FROM action WHERE id = %s", (action,)).fetchone()
    if known is None:
        raise LookupError(
            f"there is no action {action}: semmap grasp NAME --json prints each action_id"
        )


def record_task(
    session: Session,
    entity: str,
    kind: str = "grasp",
    *,
    action: int | None,
    outcome: str,
    instead_of: int | None = None,
    **values: Any,
) -> int:
    """Store an attempt with its outcome (the paper's Effect Evaluator, section IV); return its id.

    If it was completed, its action replaces `instead_of`, which failed before: that is not proposed
    any more, and its outcomes stay known. `values` are those of `add_task`; raises as it and
    `replace_action`.
    """
    with refusals(), session.transaction():
        task = add_task(session, entity, kind, action=action, outcome=outcome, **values)
        if instead_of is not None and outcome == "completed":
            replace_action(session, instead_of, action)
    return task


def replace_action(session: Session, failed: int, action: int | None) -> None:
    """Store that an action is proposed in place of a failed one of its kind, object and gripper."""
    for known in (failed, action):
        if known is not None:
            _check_action(session, known)
    session.execute("UPDATE action SET replaced_by = NULL WHERE id = %s", (action,))
    found = session.execute(
        "UPDATE action old SET replaced_by = new.id FROM action new "
        "WHERE old.id = %s AND new.id = %s AND (old.kind, old.object_id, old.gripper_id) = "
        "(new.kind, new.object_id, new.gripper_id) RETURNING old.id",
        (failed, action),
    ).fetchone()
    if found is None:
        raise ManipulationError(
            f"action {action} cannot replace {failed}: they are not of the same kind, "
            "object model and gripper"
        )
