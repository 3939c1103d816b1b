"""Stores missions in the database: their steps, their runners, and the claims of their robots.

The effects of a step are written in the transaction that ends it, from what the robot observed and
not from what was expected. So the map never contains what did not happen.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Engine, text

from planner.mission.behaviours import Observation, Outcome
from planner.mission.command import Command
from planner.mission.map_connection import MapConnection, MissionError
from planner.mission.observations import (
    ObjectRow,
    find_placement,
    read_objects,
    write_door,
    write_execution,
    write_observation,
)
from planner.mission.retry_policy import Failure
from planner.readers.topology import read_topology
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["LostMissionError", "MissionError", "MissionStatus", "MissionStore", "TakenMission"]

LOCK = 0x6D697373
"""Upper half of the keys of locks on robots. A lock is released when its process dies."""


class _BusyError(MissionError):
    """Another process has locked the robot."""


class LostMissionError(RuntimeError):
    """Another process runs the mission now: this process must stop."""


@dataclass(frozen=True)
class TakenMission:
    """A mission that a runner takes over, with the step that was begun and those planned."""

    id: int
    goal: str
    robot: str
    begun: tuple[int, Command] | None
    planned: tuple[tuple[int, Command], ...]


@dataclass(frozen=True)
class MissionStatus:
    """The state of a mission in the database, and the claims of its robot."""

    state: str
    claims: frozenset[str]


class MissionStore(MapConnection):
    """The missions of one map, on a connection that stays open.

    Parameters
    ----------
    map_name
        By default the newest map.
    runner
        Name of the process. It keeps its missions as long as it lives.
    """

    def __init__(self, engine: Engine, map_name: str | None = None, runner: str = "") -> None:
        super().__init__(engine, map_name)
        self.runner = runner

    def plan(self, planner: Any, robot: str, goal: str, without: frozenset[str]) -> Any:
        """The plan that a planner makes on the present state of the map."""
        with self._begin() as connection:
            return planner(connection, robot, goal, without=without)

    def topology(self) -> Topology:
        """The places and connectors of the map."""
        with self._begin() as connection:
            return read_topology(connection)

    # -- missions -------------------------------------------------------------------------------

    def add_robot(self, name: str, place: str, pose: Pose, robot_class: str | None = None) -> None:
        """Put an agent at a pose in a place; add it if the map does not have it.

        Parameters
        ----------
        pose
            In the map's frame.
        robot_class
            Name of the class for which the durations of its behaviours are stored.

        Raises
        ------
        MissionError
            An entity of another kind has this name, or there is no such place.
        """
        with self._begin() as connection:
            kind = connection.execute(text(_KIND), {"name": name}).scalar()
            if kind not in (None, "agent"):
                raise MissionError(
                    f"{name} is of kind {kind}, not agent; give the robot another name"
                )
            if connection.execute(text(_KIND), {"name": place}).scalar() != "room":
                raise MissionError(f"there is no place named {place} for {name}")
            if kind is None:
                connection.execute(text(_ADD_AGENT), {"name": name})
            if robot_class is not None:
                connection.execute(text(_CLASS), {"name": name, "class": robot_class})
            connection.execute(
                text(_ADD_PLACEMENT), {"name": name, "place": place, "pose": pose.row}
            )

    def robot(self, name: str) -> tuple[str, Pose] | None:
        """The place and the pose, in the map's frame, of an agent; None if there is none."""
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
        """Add a waiting mission; returns its number.

        Raises
        ------
        MissionError
            The map has no robot of this name.
        """
        with self._begin() as connection:
            number = connection.execute(text(_ADD), {"robot": robot, "goal": goal}).scalar()
            if number is None:
                raise MissionError(
                    f"there is no robot named {robot} in {self.map_name}: place an agent of that "
                    "name, or give its start (--from)"
                )
        return int(number)

    def take(self, mission: int, wait: float = 5.0) -> TakenMission:
        """Begin a mission, or continue it if its runner has died.

        Parameters
        ----------
        wait
            Seconds to wait for the database to notice that a runner has died.

        Raises
        ------
        MissionError
            There is no such mission, it has ended, another runner runs it, or its robot has
            another one.
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
        read = [(s.number, s.state, Command.of_json(s.command)) for s in steps]
        begun = next(((n, command) for n, state, command in read if state == "started"), None)
        planned = tuple((n, command) for n, state, command in read if state == "planned")
        return TakenMission(mission, row.goal, row.robot, begun, planned)

    def _taken(self, connection: Connection, mission: int) -> tuple[Any, Any]:
        row = connection.execute(text(_MISSION), {"mission": mission}).one_or_none()
        if row is None:
            raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
        if row.state not in ("waiting", "running"):
            why = f": {row.reason}" if row.reason else ""
            raise MissionError(f"mission {mission} is {row.state}{why}; begin a new one")
        if not connection.execute(text(_LOCK), {"key": LOCK, "robot": row.robot_id}).scalar():
            raise _BusyError(
                f"{row.robot} is used by another process ({row.runner or 'unknown'}); "
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
        """The numbers of the missions that run or wait, the oldest first."""
        with self._begin() as connection:
            return [int(n) for n in connection.execute(text(_UNFINISHED)).scalars()]

    def missions(self) -> list[dict[str, Any]]:
        """All missions of the map, the newest first, with the counts of their steps."""
        with self._begin() as connection:
            return [dict(row) for row in connection.execute(text(_MISSIONS)).mappings()]

    def steps(self, mission: int) -> list[dict[str, Any]]:
        """The steps of a mission in order: action, arguments, state, times, cause and message."""
        with self._begin() as connection:
            rows = connection.execute(text(_STEPS_SHOWN), {"mission": mission}).mappings()
            return [dict(row) for row in rows]

    def failures(self, mission: int) -> list[Failure]:
        """The steps of a mission that failed, in order."""
        with self._begin() as connection:
            rows = connection.execute(text(_FAILURES), {"mission": mission})
            return [
                Failure(row.action, Command.of_json(row.command).subject, row.cause, row.message)
                for row in rows
            ]

    def cancel(self, mission: int) -> bool:
        """Cancel a mission; its runner stops the robot. Returns False if it has ended.

        Raises
        ------
        MissionError
            It belongs to another robot, and this login has no right to cancel it.
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

    def replan(self, mission: int, commands: Sequence[Command]) -> list[int]:
        """Replace the planned steps by these commands; returns their numbers."""
        with self._begin() as connection:
            self._own(connection, mission)
            return self._lay(connection, mission, commands)

    def _lay(self, connection: Connection, mission: int, commands: Sequence[Command]) -> list[int]:
        connection.execute(text(_FORGET), {"mission": mission})
        last = connection.execute(text(_LAST), {"mission": mission}).scalar() or 0
        numbers = list(range(last + 1, last + 1 + len(commands)))
        if commands:
            connection.execute(
                text(_PLAN),
                [
                    {
                        "mission": mission,
                        "number": number,
                        "action": command.behaviour,
                        "arguments": list(command.arguments),
                        "command": json.dumps(command.as_json()),
                    }
                    for number, command in zip(numbers, commands, strict=True)
                ],
            )
        return numbers

    def start(self, mission: int, number: int, command: Command) -> None:
        """Store that a step begins; to be called before the robot acts."""
        with self._begin() as connection:
            self._own(connection, mission, running=True)
            connection.execute(
                text(_START),
                {"mission": mission, "number": number, "command": json.dumps(command.as_json())},
            )

    def end(
        self,
        mission: int,
        number: int,
        command: Command,
        outcome: Outcome,
        seen: Observation,
        release: Iterable[str] = (),
        then: Sequence[Command] = (),
    ) -> list[int]:
        """Store the end of a step with the observation after it, in one transaction.

        Parameters
        ----------
        release
            Names of connectors and elevators that the robot no longer needs.
        then
            If the step failed, the commands that replace the planned ones.

        Returns
        -------
        The numbers of `then`.
        """
        with self._begin() as connection:
            robot = self._own(connection, mission)
            connection.execute(
                text(_END),
                {
                    "mission": mission,
                    "number": number,
                    "cause": outcome.cause,
                    "message": outcome.message or None,
                    "state": "done" if outcome.succeeded else "failed",
                },
            )
            write_observation(connection, robot, seen)
            if outcome.cause == "locked" and command.step is not None and command.step.connector:
                write_door(connection, command.step.connector.name, "locked")
            write_execution(connection, robot, command, outcome)
            self._release(connection, robot, release)
            return [] if outcome.succeeded else self._lay(connection, mission, then)

    def observe(self, mission: int, seen: Observation) -> None:
        """Store an observation."""
        with self._begin() as connection:
            write_observation(connection, self._own(connection, mission), seen)

    def finish(self, mission: int, state: str, reason: str | None = None) -> None:
        """Store the end of a mission (done, failed, cancelled); releases its claims."""
        with self._begin() as connection:
            robot = self._own(connection, mission)
            connection.execute(text(_FORGET), {"mission": mission})
            connection.execute(
                text(_FINISH), {"mission": mission, "state": state, "reason": reason}
            )
            connection.execute(text(_RELEASE_ALL), {"robot": robot})
            connection.execute(text(_UNLOCK), {"key": LOCK, "robot": robot})

    def _own(self, connection: Connection, mission: int, *, running: bool = False) -> int:
        """The id of the robot of a mission, if this runner still runs it."""
        row = connection.execute(
            text(_OWN), {"mission": mission, "runner": self.runner}
        ).one_or_none()
        if row is None:
            raise LostMissionError(f"mission {mission} is run by another process now")
        if running and row.state != "running":
            raise LostMissionError(f"mission {mission} is {row.state}")
        return int(row.robot_id)

    # -- the map --------------------------------------------------------------------------------

    def spot(self, item: str, target: str, towards: Pose) -> Pose | None:
        """The free pose on a target that is nearest to another pose; None if there is none."""
        with self._begin() as connection:
            return find_placement(connection, item, target, towards)

    def objects(self) -> list[ObjectRow]:
        """The objects of the map that lie in or on something."""
        with self._begin() as connection:
            return read_objects(connection)

    # -- claims ---------------------------------------------------------------------------------

    def claim(self, mission: int, resources: Iterable[str], seconds: float) -> str | None:
        """Claim connectors and elevators for the robot of a mission: all of them or none.

        Returns
        -------
        None if the robot has them now; else the name of one that another robot has.
        """
        wanted = sorted(resources)  # in the same order for all robots, so that they cannot deadlock
        with self._begin() as connection:
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
        """Release claims of the robot of a mission."""
        with self._begin() as connection:
            self._release(connection, self._own(connection, mission), resources)

    def _release(self, connection: Connection, robot: int, resources: Iterable[str]) -> None:
        for name in resources:
            connection.execute(text(_RELEASE), {"name": name, "robot": robot})

    def beat(self, mission: int, seconds: float) -> MissionStatus:
        """Store a sign of life, and extend the claims by this many seconds."""
        with self._begin() as connection:
            robot = self._own(connection, mission)
            state = connection.execute(text(_BEAT), {"mission": mission}).scalar()
            claims = connection.execute(text(_RENEW), {"robot": robot, "seconds": seconds})
            return MissionStatus(str(state), frozenset(claims.scalars()))


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
SELECT number, state, command FROM mission_step
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
SELECT number, action, arguments, state, started_at, ended_at, cause, message FROM mission_step
WHERE mission_id = :mission ORDER BY number
"""

_FAILURES = """
SELECT action, command, cause, coalesce(message, '') AS message FROM mission_step
WHERE mission_id = :mission AND state = 'failed' ORDER BY number
"""

_CANCEL = """
UPDATE mission SET state = 'cancelled', reason = 'on request', ended_at = clock_timestamp()
WHERE id = :mission AND map_id = current_map() AND state IN ('waiting', 'running')
"""

_FORGET = "DELETE FROM mission_step WHERE mission_id = :mission AND state = 'planned'"

_LAST = "SELECT max(number) FROM mission_step WHERE mission_id = :mission"

_PLAN = """
INSERT INTO mission_step (mission_id, number, action, arguments, command)
VALUES (:mission, :number, :action, :arguments, CAST(:command AS jsonb))
"""

_START = """
UPDATE mission_step
SET state = 'started', started_at = clock_timestamp(), command = CAST(:command AS jsonb)
WHERE mission_id = :mission AND number = :number AND state = 'planned'
"""

_END = """
UPDATE mission_step
SET state = :state, ended_at = clock_timestamp(), cause = :cause, message = :message
WHERE mission_id = :mission AND number = :number AND state = 'started'
"""

_FINISH = """
UPDATE mission SET state = :state, reason = :reason, ended_at = clock_timestamp()
WHERE id = :mission AND state = 'running'
"""

# Locks the row, so that no other process cancels or takes over the mission meanwhile.
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
