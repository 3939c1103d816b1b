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

GRASPS, REACHED = 400, 24
"""Free grasps of which an arm must reach one, and the most that it reaches that are considered."""

TRIED = ("missed", "dropped")
"""Causes of failures that say something of the action; the object was not reached in others."""


def has_gripper(engine: Engine, *names: str | None) -> bool:
    """Whether a gripper is stored that is meant where none is named.

    Parameters
    ----------
    names : of a robot and of its class, which may be stored with a gripper
    """
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT preferred FROM gripper")).scalars().all()
        mounted = connection.execute(
            text("SELECT 1 FROM automaton WHERE name = ANY (:names) AND gripper_id IS NOT NULL"),
            {"names": [name for name in names if name is not None]},
        ).scalar()
    return len(rows) == 1 or any(rows) or mounted is not None


@dataclass(frozen=True)
class GraspMemory:
    """Chooses grasps and places, stored ones before generated ones, and counts their outcomes.

    Attributes
    ----------
    gripper : name of a stored gripper. By default that of the automaton with the name of the robot
        or of its class, whose arm must then reach the grasps; else the preferred gripper.
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
        gripper, automaton = self._hand(connection, robot)
        gripper_id(session, gripper)
        item, kind = command.arguments[0], KINDS[command.behaviour]
        with session.transaction():
            action = (
                _grasp(
                    session,
                    item,
                    target if _is_object(connection, target) else None,
                    gripper,
                    None if automaton is None else (automaton, _base(connection, robot)),
                )
                if kind == "grasp"
                else _place(connection, session, robot, item, gripper)
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
                    gripper=self._hand(connection, robot)[0],
                    grasps=[grasp],
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

    def refusal(self, connection: Connection, robot: str, item: str) -> str | None:
        """Return why an arm cannot take an object: all known grasps are out of its reach; or None.

        To be called when its pickup has begun.
        """
        from semmap.belief.store import driver
        from semmap.manipulation.reader import actions_on

        values = {"robot": robot, "item": item}
        row = connection.execute(text(_RUNNING), values).one()
        gripper, automaton = self._hand(connection, row.robot)
        if automaton is None or row.running:
            return None
        if not actions_on(driver(connection), name=item, gripper=gripper, limit=1):
            return None  # nothing is known of it
        return f"no free grasp of it is within reach of {automaton} here"

    def _hand(self, connection: Connection, robot: int) -> tuple[str | None, str | None]:
        """The gripper that is used, and the automaton whose arm moves it."""
        from semmap.belief.store import driver
        from semmap.manipulation.automata import automaton_of

        if self.gripper is not None:
            return self.gripper, None
        names = connection.execute(text(_NAMES), {"id": robot}).one()
        found = automaton_of(driver(connection), *names)
        return (None, None) if found is None else (found[1], found[0])

    def _end_put(self, connection: Connection, place: int) -> None:
        """Store the put that a place has ended, from the begin of its grasp."""
        from semmap.belief.store import driver
        from semmap.manipulation.action_store import add_put

        steps = connection.execute(text(_STEPS), {"place": place}).one_or_none()
        if steps is not None:
            action = add_put(driver(connection), steps.grasp_action, steps.place_action)
            connection.execute(text(_PUT), {"grasp": steps.grasp, "place": place, "action": action})


def _grasp(
    session: Any,
    item: str,
    target: str | None,
    gripper: str | None,
    arm: tuple[str, Pose] | None,
) -> int | None:
    """The grasp of a pickup: one that a free place on the target ends, else the best one.

    `arm` is an automaton and where it stands: only grasps that it reaches are taken.
    """
    from semmap.manipulation.automata import reachable_rows, stored_arm
    from semmap.manipulation.error import ManipulationError
    from semmap.manipulation.places import find_places
    from semmap.manipulation.retrieval import find_grasps

    found = find_grasps(session, name=item, gripper=gripper, limit=1 if arm is None else GRASPS)
    rows = found.rows
    if arm is not None:
        rows = reachable_rows(rows, stored_arm(session, arm[0])[1], arm[1], REACHED)
    if not rows:
        return None
    if target is not None:
        reached = None if arm is None else [int(row["action_id"]) for row in rows]
        try:
            with session.transaction():
                places = find_places(
                    session, item, target, gripper=gripper, grasps=reached, limit=1
                )
            if places.rows:
                return int(places.rows[0]["grasp_id"])
        except (LookupError, ManipulationError):
            pass  # something without a mesh, or without a level surface
    return int(rows[0]["action_id"])


def _place(
    connection: Connection, session: Any, robot: int, item: str, gripper: str | None
) -> int | None:
    """The place that ends the grasp with which a robot holds an object."""
    from semmap.manipulation.places import place_of

    grasp = _held_by(connection, robot, item)
    return None if grasp is None else place_of(session, item, grasp, gripper)


def _base(connection: Connection, robot: int) -> Pose:
    """Where a robot stands, in the map's frame."""
    values = {"id": robot}
    return Pose(*connection.execute(text(_BASE), values).scalar_one())


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


_NAMES = "SELECT name, properties->>'robot_class' FROM entity WHERE id = :id"

_BASE = "SELECT pose FROM world WHERE entity_id = :id"

_KIND = "SELECT kind FROM entity WHERE map_id = current_map() AND name = :name"

_END = """
UPDATE task SET outcome = :outcome, message = :message,
       action_id = CASE WHEN :counts THEN action_id END
WHERE robot_id = :robot AND kind = :kind AND outcome = 'running'
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
RETURNING id, action_id
"""

_RUNNING = """
SELECT r.id AS robot,
       EXISTS (SELECT FROM task t WHERE t.robot_id = r.id AND t.entity_id = entity_id(:item)
               AND t.kind = 'grasp' AND t.outcome = 'running') AS running
FROM (SELECT entity_id(:robot) AS id) r
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
