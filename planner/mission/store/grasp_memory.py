"""Which grasps and places a mission uses, and what outcomes teach (Tosello et al., section IV).

A pickup and a place are rows of the table ``task`` from their begin to their end, so a restart does
not lose them. When an object was put down, the whole is stored as a put: the grasp, then the place.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import Connection, text

from planner.mission.behaviours import Outcome
from planner.mission.command import Command
from planner.mission.grasp_choice import Choice, GraspChooser, Hand, hand_of
from planner.readers.robot_class import read_robot_class
from planner.robot_class import RobotClass
from planner.tasks.goal import GoalError, parse_goal
from semmap.database.maps import driver_of
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import Levels
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.places import find_places
from semmap.manipulation.store.actions import add_put
from semmap.manipulation.store.tasks import add_task
from semmap.query.snapshot import Snapshot

KINDS = {"pickup": "grasp", "place": "place"}  # behaviours, and the kinds of their actions

TRIED = ("missed", "dropped", "unfit")
"""Causes of failures that say something of the action; the object was not reached in others."""


@dataclass(frozen=True)
class GraspMemory:
    """Chooses grasps and places, stored ones before generated ones, and counts their outcomes.

    `gripper` names a stored one; by default it is that of the automaton with the name of the robot
    or of its class, whose arm must then reach the grasps; else the preferred one, the only one, or
    an assumed default. `simulated` outcomes count for the contributor ``simulation`` if trials
    decided, and for none else. `trial` tries each grasp and place in MuJoCo before the robot acts.
    Motions of a stored arm are sought for `motion_seconds`, and the action fails without one; None
    plans none.
    """

    gripper: str | None = None
    simulated: bool = False
    trial: bool = False
    motion_seconds: float | None = 30.0

    def check(self, connection: Connection, robot: str, robot_class: str | None = None) -> None:
        """Raise LookupError if it is not clear which gripper a robot has.

        Of an agent of the map, the class is known.
        """
        known = connection.execute(text(_CLASS), {"name": robot}).scalar()
        stored = connection.execute(text("SELECT EXISTS (SELECT FROM gripper)")).scalar()
        if self.gripper is not None or stored:  # else the first pickup stores the default one
            hand_of(driver_of(connection), robot, robot_class or known, self.gripper)

    def begin(
        self, seen: Snapshot, robot: int, command: Command, put: Command | None = None
    ) -> Choice:
        """Choose how a robot does a pickup or a place, and store that it begins.

        A grasp with which it can then do the place `put` is preferred; those that have failed since
        the last success come last. Raises LookupError as `check` does.
        """
        connection = seen.connection
        item, kind = command.arguments[0], KINDS[command.behaviour]
        with seen.session.transaction():
            ends = put if kind == "grasp" else command
            target = None if ends is None else ends.arguments[-1]
            chooser = self._chooser(seen, robot, item, target)
            if kind == "grasp":
                values = {"robot": robot, "item": item}
                failed = connection.execute(text(_FAILED), values).scalars()
                chooser = replace(chooser, failed=frozenset(failed))
                goes_on = target if _is_object(connection, target) else None
                choice = chooser.grasp(item, goes_on, None if put is None else put.at)
            else:
                choice = _place(connection, chooser, robot, command)
            add_task(
                seen.session,
                item,
                kind,
                action=choice.action,
                robot=chooser.robot,
                goal=choice.spot or command.spot,
                outcome="running",
                simulated=self.simulated,
                assumed=self.simulated and not choice.tried,
            )
        return choice

    def spots(
        self, seen: Snapshot, robot: int, item: str, target: str, towards: Pose
    ) -> list[Pose] | None:
        """Where the gripper of a robot can put down what it holds; None if not known.

        The object and the gripper are free of what is around, and within reach of the robot's arm
        where it has a stored one. It is not known for floors, for objects without a mesh, and for
        what the robot took without a known grasp.
        """
        held = _held_by(seen.connection, robot, item)
        if held is None or held.action_id is None or not _is_object(seen.connection, target):
            return None
        chooser = self._chooser(seen, robot, item, target)
        near = None if chooser.arm is not None else (towards.x, towards.y)
        try:
            with seen.session.transaction():
                found = find_places(
                    seen,
                    item,
                    target,
                    gripper=chooser.hand.gripper,
                    grasps=[held.action_id],
                    towards=near,
                    arm=chooser.arm,
                    base=chooser.base,
                    limit=1,
                    levels=chooser.levels,
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

    def _chooser(self, seen: Snapshot, robot: int, item: str, target: str | None) -> GraspChooser:
        name, robot_class, pose = seen.connection.execute(text(_ROBOT), {"id": robot}).one()
        hand: Hand = hand_of(seen.session, name, robot_class, self.gripper)
        base = Pose() if pose is None else Pose(*pose)
        options = (self.trial, self.motion_seconds)
        levels = levels_of(seen, robot, item, target)
        return GraspChooser(seen, name, hand, base, *options, levels=levels)

    def _end_put(self, connection: Connection, place: int) -> None:
        """Store the put that a place has ended, from the begin of its grasp."""
        steps = connection.execute(text(_STEPS), {"place": place}).one_or_none()
        if steps is not None:
            action = add_put(driver_of(connection), steps.grasp_action, steps.place_action)
            made = (", contributor_id", _WEAKER) if self.simulated else ("", "")
            put = text(_PUT.format(*made))
            connection.execute(put, {"grasp": steps.grasp, "place": place, "action": action})


def levels_of(seen: Snapshot, robot: int, item: str, target: str | None) -> Levels:
    """The levels of a target that a robot reaches, and that the goal of its mission means."""
    _, robot_class, pose = seen.connection.execute(text(_ROBOT), {"id": robot}).one()
    low, high = RobotClass.heights
    if robot_class is not None:
        with suppress(LookupError):  # an automaton may have the name of no class
            low, high = read_robot_class(seen, robot_class).robot.heights
    floor = seen.connection.execute(text(_FLOOR), {"name": target}).scalar()
    if floor is None:
        floor = 0.0 if pose is None else pose[2]
    goals = seen.connection.execute(text(_GOALS), {"robot": robot}).scalars()
    inside = any(_goes_inside(seen.connection, goal, item, target) for goal in goals)
    return Levels((floor + low, floor + high), inside)


def _goes_inside(connection: Connection, goal: str, item: str, target: str | None) -> bool:
    """Whether a goal wants an object in another one."""
    relations = [(name, words.count(",") + 1) for name, words in _RELATION.findall(goal)]
    try:
        atoms = parse_goal(goal, relations).atoms
    except GoalError:
        return False
    pairs = [[word.text for word in atom.words] for atom in atoms if atom.relation == "in"]

    def means(word: str, name: str | None) -> bool:
        return bool(connection.execute(text(_MEANS), {"name": name, "words": [word]}).scalar())

    return any(means(first, item) and means(second, target) for first, second in pairs)


def _place(connection: Connection, chooser: GraspChooser, robot: int, command: Command) -> Choice:
    """The place that ends the grasp with which a robot holds an object."""
    item = command.arguments[0]
    held = _held_by(connection, robot, item)
    if held is None or held.action_id is None:
        return Choice()
    stands = None if held.start is None else Pose(*held.start)
    target = command.arguments[-1] if _is_object(connection, command.arguments[-1]) else None
    return chooser.place(item, held.action_id, target, command.spot, stands=stands)


def _held_by(connection: Connection, robot: int, item: str) -> Any:
    """The grasp with which a robot took an object, and where that stood; None if not known."""
    return connection.execute(text(_HELD), {"robot": robot, "item": item}).one_or_none()


def _is_object(connection: Connection, name: str | None) -> bool:
    """Whether a name is that of an object, not of a room: floors have passages to keep free."""
    found = connection.execute(text(_KIND), {"name": name}).scalar()
    return bool(found == "object")


_ROBOT = """
SELECT e.name, e.properties->>'robot_class', w.pose
FROM entity e LEFT JOIN world w ON w.entity_id = e.id WHERE e.id = :id
"""

_RELATION = re.compile(r"([\w-]+)\s*\(([^()]*)\)")

_GOALS = "SELECT goal FROM mission WHERE robot_id = :robot AND state = 'running'"

_MEANS = """
SELECT e.kind = 'object' AND (e.name = ANY (:words) OR e.label = ANY (:words) OR EXISTS (
       SELECT FROM unnest(CAST(:words AS text[])) word WHERE e.type = ANY (subtypes(word))))
FROM entity e WHERE e.map_id = current_map() AND e.name = :name
"""

_CLASS = """
SELECT properties->>'robot_class' FROM entity WHERE map_id = current_map() AND name = :name
"""

_FLOOR = """
SELECT w.pose[3] + r.floor FROM entity e JOIN room r ON r.entity_id = room_of(e.id)
JOIN world w ON w.entity_id = r.entity_id WHERE e.map_id = current_map() AND e.name = :name
"""

_KIND = "SELECT kind FROM entity WHERE map_id = current_map() AND name = :name"

_END = """
UPDATE task SET outcome = :outcome, message = :message,
       action_id = CASE WHEN :counts THEN action_id END
WHERE robot_id = :robot AND kind = :kind AND outcome = 'running'
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
RETURNING id, action_id
"""

_FAILED = """
SELECT action_id FROM task
WHERE robot_id = :robot AND kind = 'grasp' AND outcome = 'error' AND action_id IS NOT NULL
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
  AND id > (SELECT coalesce(max(t.id), 0) FROM task t WHERE t.robot_id = :robot AND t.kind = 'grasp'
            AND t.entity_id = task.entity_id AND t.outcome = 'completed')
"""

_HELD = """
SELECT action_id, start FROM task
WHERE robot_id = :robot AND kind = 'grasp' AND outcome = 'completed'
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
ORDER BY id DESC LIMIT 1
"""

_STEPS = """
SELECT s.* FROM (
    SELECT g.id AS grasp, g.action_id AS grasp_action, p.action_id AS place_action
    FROM task p JOIN task g ON g.robot_id = p.robot_id AND g.entity_id = p.entity_id AND g.id < p.id
         AND g.kind = 'grasp' AND g.outcome = 'completed' AND g.action_id IS NOT NULL
    WHERE p.id = :place ORDER BY g.id DESC LIMIT 1) s
JOIN action g ON g.id = s.grasp_action JOIN action p ON p.id = s.place_action
WHERE (g.object_id, g.gripper_id) = (p.object_id, p.gripper_id)
"""
"""The steps of a put; none where the grasp is that of a linked model."""

_PUT = """
INSERT INTO task (map_id, robot_id, kind, entity_id, action_id, start, goal, outcome, message,
                  created_at{0})
SELECT p.map_id, p.robot_id, 'put', p.entity_id, :action, g.start, p.goal, p.outcome, p.message,
       g.created_at{1}
FROM task g, task p WHERE g.id = :grasp AND p.id = :place
"""

_WEAKER = ", greatest(g.contributor_id, p.contributor_id)"
"""Of own, simulation and assumed, in this order: a put is what the weaker one of its steps is."""
