"""Missions in the database: their steps, who runs them, and what their robots have claimed.

What a robot did is written in the transaction that ends the step, from what the robot observed, and
not from what was expected of it: so the map never claims what did not happen.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError

from planner.mission.behaviours import Observation, Outcome
from planner.mission.findings import (
    ThingRow,
    find_spot,
    read_things,
    write_door,
    write_execution,
    write_observation,
)
from planner.mission.patience import Failure
from planner.mission.stage import Stage
from planner.source.topology import read_topology
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["Held", "Journal", "LostMissionError", "MissionError", "Open"]

LOCK = 0x6D697373
"""Upper half of the keys of advisory locks on robots; who dies lets go of his at once."""


class MissionError(ValueError):
    """A mission that cannot be made or run; the message says why."""


class _BusyError(MissionError):
    """Another process holds the robot."""


class LostMissionError(RuntimeError):
    """Another process runs this mission now: this one must stop."""


@dataclass(frozen=True)
class Open:
    """A mission as it is taken up: goal, robot, the step that was begun, those planned."""

    id: int
    goal: str
    robot: str
    begun: tuple[int, Stage] | None
    planned: tuple[tuple[int, Stage], ...]


@dataclass(frozen=True)
class Held:
    """What the database says of a running mission: its state, and what its robot has claimed."""

    state: str
    claims: frozenset[str]


class Journal:
    """The missions of one map, on one connection of its own.

    Parameters
    ----------
    map_name : the newest map if not given
    runner : name of the process, for the record; its missions are its own as long as it lives
    """

    def __init__(self, engine: Engine, map_name: str | None = None, runner: str = "") -> None:
        self._connection = engine.connect()
        with self._begin() as connection:
            if map_name is None:
                map_name = connection.execute(
                    text("SELECT name FROM map WHERE id = current_map()")
                ).scalar()
            known = connection.execute(
                text("SELECT id FROM map WHERE name = :name"), {"name": map_name}
            ).scalar()
            if known is None:
                self._connection.rollback()
                self._connection.close()
                raise MissionError(
                    f"there is no map {map_name}" if map_name
                    else "there is no map: semmap import FILE makes one"
                )  # fmt: skip
            connection.execute(
                text("SELECT set_config('semmap.map', :name, false)"), {"name": map_name}
            )
        self.map_name = str(map_name)
        self.runner = runner

    def close(self) -> None:
        """Let go of the connection, and of the missions that it holds."""
        if not self._connection.invalidated:
            with suppress(DBAPIError):  # the server may be away; then the locks are, too
                self._connection.rollback()
                self._connection.execute(text("SELECT pg_advisory_unlock_all()"))
                self._connection.commit()
        self._connection.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin(self) -> _Transaction:
        return _Transaction(self._connection)

    def plan(self, planner: Any, robot: str, goal: str, without: frozenset[str]) -> Any:
        """What the planner answers on this map, as it is now."""
        with self._begin() as connection:
            return planner(connection, robot, goal, without=without)

    def topology(self) -> Topology:
        """The places and connectors of the map."""
        with self._begin() as connection:
            return read_topology(connection)

    # -- missions -------------------------------------------------------------------------------

    def add_robot(self, name: str, place: str, pose: Pose, robot_class: str | None = None) -> None:
        """Let an agent of that name stand in a place at a pose of the map's frame; made if missing.

        What its behaviours take is learned for its class, where that is said.

        Raises
        ------
        MissionError
            Another kind of entity has that name, or there is no such place.
        """
        with self._begin() as connection:
            kind = connection.execute(text(_KIND), {"name": name}).scalar()
            if kind not in (None, "agent"):
                raise MissionError(
                    f"{name} is of kind {kind}, no robot: give the robot another name"
                )
            if connection.execute(text(_KIND), {"name": place}).scalar() != "room":
                raise MissionError(f"there is no place named {place} for {name} to stand in")
            if kind is None:
                connection.execute(text(_ADD_AGENT), {"name": name})
            if robot_class is not None:
                connection.execute(text(_CLASS), {"name": name, "class": robot_class})
            connection.execute(
                text(_ADD_PLACEMENT), {"name": name, "place": place, "pose": pose.row}
            )

    def robot(self, name: str) -> tuple[str, Pose] | None:
        """The place and the pose, in the map's frame, of an agent; None where there is none."""
        with self._begin() as connection:
            row = connection.execute(text(_ROBOT), {"name": name}).one_or_none()
        return None if row is None else (row.place, Pose(*row.pose))

    def robot_of(self, mission: int) -> str:
        """The robot of a mission.

        Raises
        ------
        MissionError
        """
        with self._begin() as connection:
            row = connection.execute(text(_MISSION), {"mission": mission}).one_or_none()
        if row is None:
            raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
        return str(row.robot)

    def add(self, robot: str, goal: str) -> int:
        """A waiting mission; its number.

        Raises
        ------
        MissionError
            The map has no such robot.
        """
        with self._begin() as connection:
            number = connection.execute(text(_ADD), {"robot": robot, "goal": goal}).scalar()
            if number is None:
                raise MissionError(
                    f"there is no robot named {robot} in {self.map_name}: place an agent of that "
                    "name, or say where it starts (--from)"
                )
        return int(number)

    def take(self, mission: int, wait: float = 5.0) -> Open:
        """Take up a mission: begin it, or go on with it where another runner died.

        Of a runner that has just died the database learns within seconds: `wait` for so many.

        Raises
        ------
        MissionError
            There is none, it has ended, another runner is at it, or its robot pursues another one.
        """
        until = time.monotonic() + wait
        while True:
            try:
                with self._begin() as connection:
                    row, steps = self._taken(connection, mission)
                break
            except _BusyError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.05)
        read = [(s.number, s.state, Stage.of_json(s.stage)) for s in steps]
        begun = next(((n, stage) for n, state, stage in read if state == "started"), None)
        planned = tuple((n, stage) for n, state, stage in read if state == "planned")
        return Open(mission, row.goal, row.robot, begun, planned)

    def _taken(self, connection: Connection, mission: int) -> tuple[Any, Any]:
        row = connection.execute(text(_MISSION), {"mission": mission}).one_or_none()
        if row is None:
            raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
        if row.state not in ("waiting", "running"):
            why = f": {row.reason}" if row.reason else ""
            raise MissionError(f"mission {mission} is {row.state}{why}; begin a new one")
        if not connection.execute(text(_LOCK), {"key": LOCK, "robot": row.robot_id}).scalar():
            raise _BusyError(
                f"{row.robot} is at work for another process ({row.runner or 'unknown'}); "
                "wait, or cancel its mission"
            )
        other = connection.execute(
            text(_OTHER), {"mission": mission, "robot": row.robot_id}
        ).scalar()
        if other is not None:
            connection.execute(text(_UNLOCK), {"key": LOCK, "robot": row.robot_id})
            raise MissionError(
                f"{row.robot} has begun mission {other}: resume or cancel that first"
            )
        connection.execute(text(_TAKE), {"mission": mission, "runner": self.runner})
        steps = connection.execute(text(_STEPS), {"mission": mission}).all()
        return row, steps

    def unfinished(self) -> list[int]:
        """The missions that were begun and have not ended, and those that wait; oldest first."""
        with self._begin() as connection:
            return [int(n) for n in connection.execute(text(_UNFINISHED)).scalars()]

    def missions(self) -> list[dict[str, Any]]:
        """All missions of the map, newest first, each with how many steps ended and are planned."""
        with self._begin() as connection:
            return [dict(row) for row in connection.execute(text(_MISSIONS)).mappings()]

    def steps(self, mission: int) -> list[dict[str, Any]]:
        """The steps of a mission in order: action, arguments, state, times, cause, said."""
        with self._begin() as connection:
            rows = connection.execute(text(_STEPS_SHOWN), {"mission": mission}).mappings()
            return [dict(row) for row in rows]

    def failures(self, mission: int) -> list[Failure]:
        """The steps of a mission that failed, in order."""
        with self._begin() as connection:
            rows = connection.execute(text(_FAILURES), {"mission": mission})
            return [
                Failure(row.action, Stage.of_json(row.stage).subject, row.cause, row.said)
                for row in rows
            ]

    def cancel(self, mission: int) -> bool:
        """Cancel a mission; its runner stops the robot. False where it has ended.

        Raises
        ------
        MissionError
            It is another robot's, and this login is not that robot.
        """
        with self._begin() as connection:
            if connection.execute(text(_CANCEL), {"mission": mission}).rowcount:
                return True
            row = connection.execute(text(_MISSION), {"mission": mission}).one_or_none()
            if row is not None and row.state in ("waiting", "running"):
                raise MissionError(
                    f"mission {mission} is {row.robot}'s: cancel it as that robot or as an admin"
                )
            return False

    # -- steps ----------------------------------------------------------------------------------

    def replan(self, mission: int, stages: Sequence[Stage]) -> list[int]:
        """Put these stages in place of those that are planned yet; their numbers."""
        with self._begin() as connection:
            self._own(connection, mission)
            return self._lay(connection, mission, stages)

    def _lay(self, connection: Connection, mission: int, stages: Sequence[Stage]) -> list[int]:
        connection.execute(text(_FORGET), {"mission": mission})
        last = connection.execute(text(_LAST), {"mission": mission}).scalar() or 0
        numbers = list(range(last + 1, last + 1 + len(stages)))
        if stages:
            connection.execute(
                text(_PLAN),
                [
                    {
                        "mission": mission, "number": number, "action": stage.behaviour,
                        "arguments": list(stage.arguments),
                        "stage": json.dumps(stage.as_json()),
                    }
                    for number, stage in zip(numbers, stages, strict=True)
                ],
            )  # fmt: skip
        return numbers

    def start(self, mission: int, number: int, stage: Stage) -> None:
        """A step begins: committed before the robot acts."""
        with self._begin() as connection:
            self._own(connection, mission, running=True)
            connection.execute(
                text(_START),
                {"mission": mission, "number": number, "stage": json.dumps(stage.as_json())},
            )

    def end(
        self,
        mission: int,
        number: int,
        stage: Stage,
        outcome: Outcome,
        seen: Observation,
        release: Iterable[str] = (),
        then: Sequence[Stage] = (),
    ) -> list[int]:
        """A step has ended, and this is what the robot observes now; all of it or nothing.

        Where it failed, what was planned after it is so no more; `then` is planned instead.

        Returns
        -------
        The numbers of `then`.
        """
        with self._begin() as connection:
            robot = self._own(connection, mission)
            connection.execute(
                text(_END),
                {
                    "mission": mission, "number": number, "cause": outcome.cause,
                    "said": outcome.said or None,
                    "state": "done" if outcome.succeeded else "failed",
                },
            )  # fmt: skip
            write_observation(connection, robot, seen)
            if outcome.cause == "locked" and stage.step is not None and stage.step.connector:
                write_door(connection, stage.step.connector.name, "locked")
            write_execution(connection, robot, stage, outcome)
            self._release(connection, robot, release)
            return [] if outcome.succeeded else self._lay(connection, mission, then)

    def observe(self, mission: int, seen: Observation) -> None:
        """Write what the robot observes."""
        with self._begin() as connection:
            write_observation(connection, self._own(connection, mission), seen)

    def finish(self, mission: int, state: str, reason: str | None = None) -> None:
        """The mission has ended: done, failed or cancelled. What its robot has claimed is free."""
        with self._begin() as connection:
            robot = self._own(connection, mission)
            connection.execute(text(_FORGET), {"mission": mission})
            connection.execute(
                text(_FINISH), {"mission": mission, "state": state, "reason": reason}
            )
            connection.execute(text(_RELEASE_ALL), {"robot": robot})
            connection.execute(text(_UNLOCK), {"key": LOCK, "robot": robot})

    def _own(self, connection: Connection, mission: int, *, running: bool = False) -> int:
        """The robot of a mission that is this runner's; else nothing of it may be written."""
        row = connection.execute(
            text(_OWN), {"mission": mission, "runner": self.runner}
        ).one_or_none()
        if row is None:
            raise LostMissionError(f"mission {mission} is run by another process now")
        if running and row.state != "running":
            raise LostMissionError(f"mission {mission} is {row.state}")
        return int(row.robot_id)

    # -- the map --------------------------------------------------------------------------------

    def spot(self, thing: str, target: str, towards: Pose) -> Pose | None:
        """Where a thing can lie on a target, the nearest to a pose; None where nothing is free."""
        with self._begin() as connection:
            return find_spot(connection, thing, target, towards)

    def things(self) -> list[ThingRow]:
        """The things of the map that lie in or on something: what a simulated world begins with."""
        with self._begin() as connection:
            return read_things(connection)

    # -- claims ---------------------------------------------------------------------------------

    def claim(self, mission: int, resources: Iterable[str], seconds: float) -> str | None:
        """Claim connectors and elevators for a mission's robot: all of them or none.

        Returns
        -------
        None where they are its own now; else one that another robot has.
        """
        wanted = sorted(resources)  # in one order, so that two robots do not wait for each other
        with _Transaction(self._connection) as connection:
            robot = self._own(connection, mission, running=True)
            for name in wanted:
                got = connection.execute(
                    text(_CLAIM), {"name": name, "robot": robot, "seconds": seconds}
                ).scalar()
                if not got:
                    connection.rollback()
                    return name
        return None

    def release(self, mission: int, resources: Iterable[str]) -> None:
        """Give back what the mission's robot has claimed."""
        with self._begin() as connection:
            self._release(connection, self._own(connection, mission), resources)

    def _release(self, connection: Connection, robot: int, resources: Iterable[str]) -> None:
        for name in resources:
            connection.execute(text(_RELEASE), {"name": name, "robot": robot})

    def beat(self, mission: int, seconds: float) -> Held:
        """Say that the runner lives, and keep its claims for so many seconds more."""
        with self._begin() as connection:
            robot = self._own(connection, mission)
            state = connection.execute(text(_BEAT), {"mission": mission}).scalar()
            claims = connection.execute(text(_RENEW), {"robot": robot, "seconds": seconds})
            return Held(str(state), frozenset(claims.scalars()))


class _Transaction:
    """A transaction on a connection that stays open."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def __enter__(self) -> Connection:
        return self._connection

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._connection.commit()
        elif not self._connection.invalidated:
            self._connection.rollback()


_KIND = "SELECT kind FROM entity WHERE map_id = current_map() AND name = :name"

_ADD_AGENT = "INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'agent', :name)"

_CLASS = """
UPDATE entity SET properties = properties || jsonb_build_object('robot_class', CAST(:class AS text))
WHERE id = entity_id(:name) AND properties->>'robot_class' IS DISTINCT FROM :class
"""

_ADD_PLACEMENT = """
INSERT INTO placement AS p (entity_id, holder_id, pose)
SELECT entity_id(:name), r.entity_id, pose_compose(pose_inverse(r.pose), CAST(:pose AS float8[]))
FROM world r WHERE r.entity_id = entity_id(:place)
ON CONFLICT (entity_id) DO UPDATE SET holder_id = excluded.holder_id, pose = excluded.pose
"""

_ROBOT = """
SELECT r.name AS place, w.pose
FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
     JOIN entity r ON r.id = p.holder_id AND r.kind = 'room'
WHERE e.map_id = current_map() AND e.name = :name AND e.kind = 'agent'
"""

_ADD = """
INSERT INTO mission (map_id, robot_id, goal)
SELECT map_id, id, :goal FROM entity
WHERE map_id = current_map() AND name = :robot AND kind = 'agent' RETURNING id
"""

_MISSION = """
SELECT m.goal, m.state, m.reason, m.runner, m.robot_id, e.name AS robot
FROM mission m JOIN entity e ON e.id = m.robot_id
WHERE m.id = :mission AND m.map_id = current_map()
"""

_LOCK = "SELECT pg_try_advisory_lock((CAST(:key AS bigint) << 32) # CAST(:robot AS bigint))"

_UNLOCK = "SELECT pg_advisory_unlock((CAST(:key AS bigint) << 32) # CAST(:robot AS bigint))"

_OTHER = "SELECT id FROM mission WHERE robot_id = :robot AND state = 'running' AND id <> :mission"

_TAKE = """
UPDATE mission SET state = 'running', runner = :runner, heartbeat = clock_timestamp()
WHERE id = :mission
"""

_STEPS = """
SELECT number, state, stage FROM mission_step
WHERE mission_id = :mission AND state IN ('started', 'planned') ORDER BY number
"""

_UNFINISHED = """
SELECT id FROM mission WHERE map_id = current_map() AND state IN ('running', 'waiting')
ORDER BY state, id
"""

_MISSIONS = """
SELECT m.id, e.name AS robot, m.goal, m.state, m.reason, m.created_at, m.heartbeat, m.ended_at,
       count(*) FILTER (WHERE s.state = 'done') AS done,
       count(*) FILTER (WHERE s.state = 'failed') AS failed,
       count(*) FILTER (WHERE s.state IN ('planned', 'started')) AS planned
FROM mission m JOIN entity e ON e.id = m.robot_id LEFT JOIN mission_step s ON s.mission_id = m.id
WHERE m.map_id = current_map() GROUP BY m.id, e.name ORDER BY m.id DESC
"""

_STEPS_SHOWN = """
SELECT number, action, arguments, state, started_at, ended_at, cause, said FROM mission_step
WHERE mission_id = :mission ORDER BY number
"""

_FAILURES = """
SELECT action, stage, cause, coalesce(said, '') AS said FROM mission_step
WHERE mission_id = :mission AND state = 'failed' ORDER BY number
"""

_CANCEL = """
UPDATE mission SET state = 'cancelled', reason = 'as it was asked', ended_at = clock_timestamp()
WHERE id = :mission AND map_id = current_map() AND state IN ('waiting', 'running')
"""

_FORGET = "DELETE FROM mission_step WHERE mission_id = :mission AND state = 'planned'"

_LAST = "SELECT max(number) FROM mission_step WHERE mission_id = :mission"

_PLAN = """
INSERT INTO mission_step (mission_id, number, action, arguments, stage)
VALUES (:mission, :number, :action, :arguments, CAST(:stage AS jsonb))
"""

_START = """
UPDATE mission_step
SET state = 'started', started_at = clock_timestamp(), stage = CAST(:stage AS jsonb)
WHERE mission_id = :mission AND number = :number AND state = 'planned'
"""

_END = """
UPDATE mission_step SET state = :state, ended_at = clock_timestamp(), cause = :cause, said = :said
WHERE mission_id = :mission AND number = :number AND state = 'started'
"""

_FINISH = """
UPDATE mission SET state = :state, reason = :reason, ended_at = clock_timestamp()
WHERE id = :mission AND state = 'running'
"""

# Locked, so that nobody cancels it or takes it over meanwhile.
_OWN = "SELECT robot_id, state FROM mission WHERE id = :mission AND runner = :runner FOR UPDATE"

_CLAIM = """
SELECT claim(id, :robot, :seconds) FROM entity WHERE id = entity_id(:name)
"""

_RELEASE = "DELETE FROM reservation WHERE resource_id = entity_id(:name) AND robot_id = :robot"

_RELEASE_ALL = "DELETE FROM reservation WHERE robot_id = :robot"

_BEAT = "UPDATE mission SET heartbeat = clock_timestamp() WHERE id = :mission RETURNING state"

_RENEW = """
WITH renewed AS (
    UPDATE reservation SET expires = clock_timestamp() + make_interval(secs => :seconds)
    WHERE robot_id = :robot RETURNING resource_id)
SELECT e.name FROM renewed r JOIN entity e ON e.id = r.resource_id
"""
