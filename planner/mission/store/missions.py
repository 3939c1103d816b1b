"""What a runner reads and writes while it runs missions, each in one transaction.

The effects of a step are written in the transaction that ends it, from what the robot observed and
not from what was expected. So the map never contains what did not happen.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, text

from planner.mission.behaviours import Outcome, RobotObservation
from planner.mission.command import Command
from planner.mission.grasp_choice import Choice
from planner.mission.store.grasp_memory import KINDS, GraspMemory, levels_of
from planner.mission.store.mission_list import MissionError, MissionList, read_mission
from planner.mission.store.observations import (
    ObjectRow,
    find_placement,
    read_missing,
    read_objects,
    read_robot,
    write_door,
    write_execution,
    write_observation,
)
from planner.plan import Plan
from planner.readers.topology import read_topology
from planner.topology import Topology
from semmap.error import Error
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import ANY_LEVEL
from semmap.query.map_handle import MapSource

LOCK = 0x6D697373
"""Upper half of the keys of locks on robots. A lock is released when its process dies."""


class _BusyError(MissionError):
    """Another process has locked the robot."""


class GoneError(Error, LookupError):
    """The map has no such connector or elevator any more."""


class LostMissionError(Error):
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


class MissionStore(MissionList):
    """The missions of one map, for the runners of missions, on a connection that stays open.

    Parameters
    ----------
    source
        A `semmap.Map`, or another handle of a map.
    runner
        Name of the process. It keeps its missions as long as it lives.
    grasps
        Chooses grasps for pickups, and stores their outcomes; by default nothing does.
    """

    def __init__(
        self,
        source: MapSource,
        runner: str = "",
        grasps: GraspMemory | None = None,
    ) -> None:
        super().__init__(source)
        self.runner = runner
        self.grasps = grasps
        self._others: dict[str, tuple[datetime, float]] = {}  # claims, and when they expire here

    def plan(
        self,
        planner: Any,
        robot: str,
        goal: str,
        *,
        without: frozenset[str],
        tried: frozenset[tuple[str, Pose]],
    ) -> Plan:
        """The plan that a planner makes on the present state of the map."""
        with self._snapshot() as seen:
            plan: Plan = planner(seen, robot, goal, without=without, tried=tried)
            return plan

    def topology(self) -> Topology:
        """The places and connectors of the map."""
        with self._snapshot() as seen:
            return read_topology(seen)

    def add_robot(self, name: str, place: str, pose: Pose, robot_class: str | None = None) -> None:
        """Put an agent at a pose of the map's frame in a place; add it if it is not there.

        The durations of its behaviours are stored for the class. Raises MissionError: an entity of
        another kind has this name, or there is no such place.
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
            values = {"name": name, "place": place, "pose": pose.row}
            connection.execute(text(_ADD_PLACEMENT), values)

    def state_class(self, name: str, robot_class: str) -> None:
        """State the class of an agent."""
        with self._begin() as connection:
            connection.execute(text(_CLASS), {"name": name, "class": robot_class})

    def robot(self, name: str) -> tuple[str, Pose] | None:
        """The place and the pose, in the map's frame, of an agent; None if there is none."""
        with self._snapshot() as seen:
            return read_robot(seen, name)

    def home(self) -> str | None:
        """The room of the first home region, by name; None without one.

        None, too, where the map has an agent: a name that it does not have may be a typing error.
        """
        with self._begin() as connection:
            found = connection.execute(text(_HOME)).scalar()
            return None if found is None else str(found)

    def take(self, mission: int, wait: float = 5.0) -> TakenMission:
        """Begin a mission, or continue it if its runner has died.

        The database has `wait` seconds to notice that. Raises MissionError: there is no such
        mission, it has ended, another runner runs it, or its robot has another one.
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
        row = read_mission(connection, mission)
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
        return row, connection.execute(text(_UNFINISHED), {"mission": mission}).all()

    def replan(self, mission: int, commands: Sequence[Command]) -> list[int]:
        """Replace the planned steps by these commands; returns their numbers."""
        with self._begin() as connection:
            self._own(connection, mission)
            return self._replace_planned(connection, mission, commands)

    def start(self, mission: int, number: int, command: Command) -> Choice:
        """Store that a step begins; to be called before the robot acts.

        Returns, of a pickup or a place, how the robot does it, or why it cannot, such as a table
        that was removed; else an empty choice.
        """
        with self._snapshot() as seen:
            connection = seen.connection
            robot = self._own(connection, mission, running=True)
            choice = Choice()
            gone = read_missing(connection, command.needs)
            if gone:
                choice = Choice(refusal=Outcome("gone", f"the map has no {gone[0]} any more"))
            elif self.grasps is not None and command.behaviour in KINDS:
                values = {"mission": mission, "item": command.arguments[0]}
                put = connection.execute(text(_PUT), values).scalar()
                ends = None if put is None else Command.of_json(put)
                choice = self.grasps.begin(seen, robot, command, ends)
            values = {"mission": mission, "number": number}
            values |= {"command": json.dumps(choice.of(command).as_json())}
            connection.execute(text(_START), values)
            return choice

    def end(
        self,
        mission: int,
        number: int,
        command: Command,
        outcome: Outcome,
        seen: RobotObservation,
        release: Iterable[str] = (),
        then: Sequence[Command] = (),
    ) -> list[int]:
        """Store the end of a step with the observation after it, in one transaction.

        The robot no longer needs the connectors and elevators `release`. If the step failed, the
        commands `then` replace the planned ones; returns their numbers.
        """
        with self._begin() as connection:
            robot = self._own(connection, mission)
            values: dict[str, Any] = {"mission": mission, "number": number}
            values |= {"state": "done" if outcome.succeeded else "failed", "cause": outcome.cause}
            connection.execute(text(_END), values | {"message": outcome.message or None})
            write_observation(connection, robot, seen)
            if outcome.cause == "locked" and command.step is not None and command.step.connector:
                write_door(connection, command.step.connector.name, "locked")
            write_execution(connection, robot, command, outcome)
            if self.grasps is not None and command.behaviour in KINDS:
                self.grasps.end(connection, robot, command, outcome)
            connection.execute(text(_RELEASE), {"names": [*release], "robot": robot})
            return [] if outcome.succeeded else self._replace_planned(connection, mission, then)

    def _replace_planned(
        self, connection: Connection, mission: int, commands: Sequence[Command]
    ) -> list[int]:
        """Replace the planned steps of a mission by these commands; returns their numbers."""
        connection.execute(text(_FORGET), {"mission": mission})
        last = connection.execute(text(_LAST), {"mission": mission}).scalar() or 0
        numbers = list(range(last + 1, last + 1 + len(commands)))
        rows = [
            {
                "mission": mission,
                "number": number,
                "action": command.behaviour,
                "arguments": list(command.arguments),
                "command": json.dumps(command.as_json()),
            }
            for number, command in zip(numbers, commands, strict=True)
        ]
        if rows:
            connection.execute(text(_PLAN), rows)
        return numbers

    def observe(self, mission: int, seen: RobotObservation) -> None:
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

    def spot(
        self, item: str, target: str, towards: Pose, mission: int | None = None
    ) -> Pose | None:
        """The free pose on a target that is nearest to another pose; None if there is none.

        If the robot of a mission holds the object, its gripper is free there, too, where the store
        chooses grasps.
        """
        with self._snapshot() as seen:
            robot = None if mission is None else self._own(seen.connection, mission)
            levels = ANY_LEVEL if robot is None else levels_of(seen, robot, item, target)
            if self.grasps is not None and robot is not None:
                spots = self.grasps.spots(seen, robot, item, target, towards)
                if spots is not None:
                    return spots[0] if spots else None
            return find_placement(seen, item, target, towards, levels)

    def objects(self) -> list[ObjectRow]:
        """The objects of the map that lie in or on something."""
        with self._snapshot() as seen:
            return read_objects(seen)

    def claim(self, mission: int, resources: Iterable[str], seconds: float) -> str | None:
        """Claim connectors and elevators for the robot of a mission: all of them or none.

        Returns None if the robot has them now; else the name of one that another robot has. Raises
        GoneError for one that the map has no more. While the runner of the other robot is
        connected, its claim expires by the clock of this process: that of the server can jump.
        """
        with self._begin() as connection:
            robot = self._own(connection, mission, running=True)
            for name in sorted(resources):  # in one order for all robots: no deadlock
                values = {"name": name, "robot": robot, "seconds": seconds}
                if self._is_renewed(connection, values):
                    connection.rollback()
                    return name
                got = connection.execute(text(_CLAIM), values).scalar()
                if got is None:
                    raise GoneError(f"the map has no {name} any more")
                if not got:
                    connection.rollback()
                    return name
            return None

    def _is_renewed(self, connection: Connection, values: dict[str, Any]) -> bool:
        """Whether a connected runner of another robot has had the time to renew its claim."""
        row = connection.execute(text(_OTHERS), values | {"key": LOCK}).one_or_none()
        if row is None:
            return False
        expires, until = self._others.get(values["name"], (None, 0.0))
        if expires != row.expires:
            until = time.monotonic() + row.seconds
            self._others[values["name"]] = row.expires, until
        return time.monotonic() < until

    def release(self, mission: int, resources: Iterable[str]) -> None:
        """Release claims of the robot of a mission."""
        with self._begin() as connection:
            robot = self._own(connection, mission)
            connection.execute(text(_RELEASE), {"names": [*resources], "robot": robot})

    def beat(self, mission: int, seconds: float) -> MissionStatus:
        """Store a sign of life, and extend the claims by this many seconds."""
        with self._begin() as connection:
            robot = self._own(connection, mission)
            state = connection.execute(text(_BEAT), {"mission": mission}).scalar()
            claims = connection.execute(text(_RENEW), {"robot": robot, "seconds": seconds})
            return MissionStatus(str(state), frozenset(claims.scalars()))


_LOCK = "SELECT pg_try_advisory_lock((CAST(:key AS bigint) << 32) # CAST(:robot AS bigint))"

_UNLOCK = "SELECT pg_advisory_unlock((CAST(:key AS bigint) << 32) # CAST(:robot AS bigint))"

_OTHER = "SELECT id FROM mission WHERE robot_id = :robot AND state = 'running' AND id <> :mission"

_TAKE = """
UPDATE mission SET state = 'running', runner = :runner, heartbeat = clock_timestamp()
WHERE id = :mission
"""

_FINISH = """
UPDATE mission SET state = :state, reason = :reason, ended_at = clock_timestamp()
WHERE id = :mission AND state = 'running'
"""

# Locks the row, so that no other process cancels or takes over the mission meanwhile.
_OWN = "SELECT robot_id, state FROM mission WHERE id = :mission AND runner = :runner FOR UPDATE"

_BEAT = "UPDATE mission SET heartbeat = clock_timestamp() WHERE id = :mission RETURNING state"

_UNFINISHED = """
SELECT number, state, command FROM mission_step
WHERE mission_id = :mission AND state IN ('started', 'planned') ORDER BY number
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

# What an object is put on by the first planned step that puts it down.
_PUT = """
SELECT command FROM mission_step
WHERE mission_id = :mission AND state = 'planned' AND action = 'place' AND arguments[1] = :item
ORDER BY number LIMIT 1
"""

_CLAIM = """
SELECT claim(id, :robot, :seconds) FROM entity WHERE map_id = current_map() AND name = :name
"""

# A claim of another robot whose runner is connected, and for how long to wait for its renewal.
_OTHERS = """
SELECT r.expires,
       CASE WHEN left_over BETWEEN 0 AND 3600 THEN left_over ELSE :seconds / 2 END AS seconds
FROM reservation r JOIN entity e ON e.id = r.resource_id,
     LATERAL (SELECT CAST(extract(epoch FROM r.expires - clock_timestamp()) AS float8))
         v (left_over)
WHERE e.map_id = current_map() AND e.name = :name AND r.robot_id <> :robot AND EXISTS (
    SELECT FROM pg_locks l WHERE l.locktype = 'advisory' AND l.objsubid = 1 AND l.granted
       AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())
       AND l.classid = :key AND l.objid = r.robot_id)
"""

_RELEASE = """
DELETE FROM reservation r USING entity e
WHERE e.map_id = current_map() AND e.name = ANY (:names) AND r.resource_id = e.id
  AND r.robot_id = :robot
"""

_RELEASE_ALL = "DELETE FROM reservation WHERE robot_id = :robot"

_RENEW = """
WITH renewed AS (
    UPDATE reservation SET expires = clock_timestamp() + make_interval(secs => :seconds)
    WHERE robot_id = :robot RETURNING resource_id)
SELECT e.name FROM renewed r JOIN entity e ON e.id = r.resource_id
"""

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

_HOME = """
SELECT r.name FROM entity e JOIN placement p ON p.entity_id = e.id
JOIN entity r ON r.id = p.holder_id AND r.kind = 'room'
WHERE e.map_id = current_map() AND e.kind = 'region'
  AND (e.type = ANY (subtypes('home_region')) OR e.properties->>'home' = 'true')
  AND NOT EXISTS (SELECT FROM entity a WHERE a.map_id = e.map_id AND a.kind = 'agent')
ORDER BY e.name LIMIT 1
"""
