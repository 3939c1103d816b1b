"""Which grasps and places a mission uses, and what outcomes teach (Tosello et al., section IV).

A pickup and a place are rows of the table ``task`` from their begin to their end, so a restart does
not lose them. When an object was put down, the whole is stored as a put: the grasp, then the place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, text

from planner.mission.behaviours import Outcome
from planner.mission.command import Command
from semmap.geometry.pose import Pose

if TYPE_CHECKING:
    from sqlalchemy import Engine

__all__ = ["KINDS", "GraspMemory", "has_gripper"]

KINDS = {"pickup": "grasp", "place": "place"}
"""Behaviours, and the kinds of their actions."""

TRIED = ("missed", "dropped")
"""Causes of failures that say something of the action; the object was not reached in others."""


def has_gripper(engine: Engine) -> bool:
    """Whether a gripper is stored that is meant where none is named."""
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT preferred FROM gripper")).scalars().all()
    return len(rows) == 1 or any(rows)


@dataclass(frozen=True)
class GraspMemory:
    """Chooses grasps and places, stored ones before generated ones, and counts their outcomes.

    Attributes
    ----------
    gripper : name of a stored gripper; the preferred one where None
    simulated : outcomes count for the contributor ``simulation``
    """

    gripper: str | None = None
    simulated: bool = False

    def begin(
        self, connection: Connection, robot: int, command: Command, target: str | None = None
    ) -> int | None:
        """Store that a robot begins a pickup or a place; return the id of the action that it uses.

        None where no action is known and none can be generated: it begins without.

        Parameters
        ----------
        target : of a pickup: what the object is then put on. A grasp with which the gripper can
            put it there is preferred.

        Raises
        ------
        LookupError
            There is no such gripper.
        """
        from semmap.belief.store import driver
        from semmap.manipulation.device_store import gripper_id
        from semmap.manipulation.task_store import add_task

        session = driver(connection)
        gripper_id(session, self.gripper)
        item, kind = command.arguments[0], KINDS[command.behaviour]
        with session.transaction():
            action = (
                self._grasp(session, item, target if _is_object(connection, target) else None)
                if kind == "grasp"
                else self._place(connection, session, robot, item)
            )
            if action is not None:
                add_task(
                    session,
                    item,
                    kind,
                    action=action,
                    robot=_name(connection, robot),
                    goal=command.spot,
                    outcome="running",
                    simulated=self.simulated,
                )
        return action

    def spots(
        self, connection: Connection, robot: int, item: str, target: str, towards: Pose
    ) -> list[Pose] | None:
        """Return where the gripper of a robot can put down what it holds; None if not known.

        The object and the gripper are free of what is around; empty where they are nowhere. It is
        not known for floors, for objects without a mesh, and for what the robot took without a
        known grasp.
        """
        from semmap.belief.store import driver
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.places import find_places

        grasp = _held_by(connection, robot, item)
        if grasp is None or not _is_object(connection, target):
            return None
        session = driver(connection)
        near = (towards.x, towards.y)
        try:
            with session.transaction():
                found = find_places(
                    session,
                    item,
                    target,
                    gripper=self.gripper,
                    grasp=grasp,
                    towards=near,
                    limit=1,
                )
        except (LookupError, ManipulationError):
            return None
        return [row["spot"] for row in found.rows]

    def end(self, connection: Connection, robot: int, command: Command, outcome: Outcome) -> None:
        """Store how the pickup or the place that a robot began has ended."""
        kind = KINDS[command.behaviour]
        counts = outcome.succeeded or outcome.cause in TRIED
        values = {
            "robot": robot,
            "kind": kind,
            "item": command.arguments[0],
            "outcome": "completed" if outcome.succeeded else "error",
            "message": outcome.message or None,
            "counts": counts,
        }
        ended = connection.execute(text(_END), values).one_or_none()
        if kind == "place" and counts and ended is not None and ended.action_id is not None:
            self._end_put(connection, ended.id)

    def _grasp(self, session: Any, item: str, target: str | None) -> int | None:
        """The grasp of a pickup: one that a free place on the target ends, else the best one."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.places import find_places
        from semmap.manipulation.retrieval import find_grasps

        if target is not None:
            try:
                with session.transaction():
                    found = find_places(session, item, target, gripper=self.gripper, limit=1)
                if found.rows:
                    return int(found.rows[0]["grasp_id"])
            except (LookupError, ManipulationError):
                pass  # something without a mesh, or without a level surface
        rows = find_grasps(session, name=item, gripper=self.gripper, limit=1).rows
        return int(rows[0]["action_id"]) if rows else None

    def _place(self, connection: Connection, session: Any, robot: int, item: str) -> int | None:
        """The place that ends the grasp with which a robot holds an object."""
        from semmap.manipulation.places import place_of

        grasp = _held_by(connection, robot, item)
        return None if grasp is None else place_of(session, item, grasp, self.gripper)

    def _end_put(self, connection: Connection, place: int) -> None:
        """Store the put that a place has ended, from the begin of its grasp."""
        from semmap.belief.store import driver
        from semmap.manipulation.action_store import add_put

        steps = connection.execute(text(_STEPS), {"place": place}).one_or_none()
        if steps is not None:
            action = add_put(driver(connection), steps.grasp_action, steps.place_action)
            connection.execute(text(_PUT), {"grasp": steps.grasp, "place": place, "action": action})


def _held_by(connection: Connection, robot: int, item: str) -> int | None:
    """The grasp with which a robot took what it holds; None if not known."""
    values = {"robot": robot, "item": item}
    found = connection.execute(text(_HELD), values).scalar()
    return None if found is None else int(found)


def _is_object(connection: Connection, name: str | None) -> bool:
    """Whether a name is that of an object, not of a room: floors have passages to keep free."""
    found = connection.execute(text(_KIND), {"name": name}).scalar()
    return bool(found == "object")


def _name(connection: Connection, robot: int) -> Any:
    return connection.execute(
        text("SELECT name FROM entity WHERE id = :id"), {"id": robot}
    ).scalar()


_KIND = "SELECT kind FROM entity WHERE map_id = current_map() AND name = :name"

_END = """
UPDATE task SET outcome = :outcome, message = :message,
       action_id = CASE WHEN :counts THEN action_id END
WHERE robot_id = :robot AND kind = :kind AND outcome = 'running'
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
RETURNING id, action_id
"""

_HELD = """
SELECT action_id FROM task
WHERE robot_id = :robot AND kind = 'grasp' AND outcome = 'completed'
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
ORDER BY id DESC LIMIT 1
"""

_STEPS = """
SELECT g.id AS grasp, g.action_id AS grasp_action, p.action_id AS place_action
FROM task p JOIN task g ON g.robot_id = p.robot_id AND g.entity_id = p.entity_id AND g.id < p.id
     AND g.kind = 'grasp' AND g.outcome = 'completed' AND g.action_id IS NOT NULL
WHERE p.id = :place ORDER BY g.id DESC LIMIT 1
"""

_PUT = """
INSERT INTO task (map_id, robot_id, kind, entity_id, action_id, start, goal, outcome, message,
                  contributor_id, created_at)
SELECT p.map_id, p.robot_id, 'put', p.entity_id, :action, g.start, p.goal, p.outcome, p.message,
       p.contributor_id, g.created_at
FROM task g, task p WHERE g.id = :grasp AND p.id = :place
"""
