"""The missions of a map: add, list and cancel them. No runner is needed for that."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, Self

from sqlalchemy import Connection, text
from sqlalchemy.exc import DBAPIError

from planner.mission.command import Command
from planner.mission.retry_policy import Failure
from semmap.database.maps import pick_map, see_map
from semmap.error import Error
from semmap.query.map_handle import MapSource
from semmap.query.snapshot import Snapshot


class MissionError(Error, ValueError):
    """A mission cannot be made or run; the message says why."""


class MissionList:
    """The missions of one map and of its simulations, for a ``with`` statement.

    They are on a connection that stays open, so that its session holds locks. Raises MissionError:
    there is no such map, none at all, or several and none is chosen.
    """

    def __init__(self, source: MapSource) -> None:
        self._connection = source.engine.connect()
        try:
            with self._begin() as connection:
                name = pick_map(connection, source.name)
                self.map_name = see_map(connection, name, lasting=True)
        except LookupError as error:
            self._connection.close()
            raise MissionError(str(error.args[0])) from None

    def close(self) -> None:
        """Close the connection and release its locks."""
        if not self._connection.invalidated:
            with suppress(DBAPIError):  # without the server, the locks are released anyway
                self._connection.rollback()
                self._connection.execute(text("SELECT pg_advisory_unlock_all()"))
                self._connection.commit()
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _begin(self) -> Iterator[Connection]:
        """A transaction on the connection, which stays open."""
        try:
            yield self._connection
        except BaseException:
            if not self._connection.invalidated:
                self._connection.rollback()
            raise
        self._connection.commit()

    @contextmanager
    def _snapshot(self) -> Iterator[Snapshot]:
        """What a transaction on this connection sees."""
        with self._begin() as connection:
            yield Snapshot.of(connection, self.map_name)

    def add(self, robot: str, goal: str) -> int:
        """Add a waiting mission; returns its number. MissionError: the map has no such robot."""
        with self._begin() as connection:
            number = connection.execute(text(_ADD), {"robot": robot, "goal": goal}).scalar()
            if number is None:
                raise MissionError(
                    f"there is no robot named {robot} in {self.map_name}: place an agent of that "
                    "name, or give its start by start="
                )
        return int(number)

    def mission(self, mission: int) -> Any:
        """The goal, state, reason, runner, robot and map of a mission; MissionError without it."""
        with self._begin() as connection:
            return read_mission(connection, mission)

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
            rows = connection.execute(text(_STEPS), {"mission": mission}).mappings()
            return [dict(row) for row in rows]

    def failures(self, mission: int) -> list[Failure]:
        """The steps of a mission that failed, in order."""
        found = []
        with self._begin() as connection:
            for row in connection.execute(text(_FAILURES), {"mission": mission}):
                command = Command.of_json(row.command)
                subject = command.subject
                failure = Failure(row.action, subject, row.cause, row.message, command.at)
                refused = failure.is_of_base or failure.is_final
                if row.action == "place" and refused:  # what it holds is not the reason
                    failure = replace(failure, subject=command.arguments[-1])
                found.append(failure)
        return found

    def cancel(self, mission: int) -> bool:
        """Cancel a mission; its runner stops the robot. Returns False if it has ended.

        Raises MissionError: it is another robot's, and this login has no right to cancel it.
        """
        with self._begin() as connection:
            values = {"mission": mission}
            if connection.execute(text(_CANCEL), values).rowcount:
                return True
            row = connection.execute(text(_MISSION), values).one_or_none()
            if row is not None and row.state in ("waiting", "running"):
                raise MissionError(
                    f"mission {mission} is {row.robot}'s: cancel it as that robot or as an admin"
                )
            return False


def read_mission(connection: Connection, mission: int) -> Any:
    """The row of a mission, with its robot and map; MissionError without it."""
    row = connection.execute(text(_MISSION), {"mission": mission}).one_or_none()
    if row is None:
        raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
    return row


_ADD = """
INSERT INTO mission (map_id, robot_id, goal)
SELECT map_id, id, :goal FROM entity
WHERE map_id = current_map() AND name = :robot AND kind = 'agent' RETURNING id
"""

_MISSION = """
SELECT m.goal, m.state, m.reason, m.runner, m.robot_id, e.name AS robot, k.name AS map
FROM mission m JOIN entity e ON e.id = m.robot_id JOIN map k ON k.id = m.map_id
WHERE m.id = :mission AND current_map() IN (k.id, k.copy_of)
"""

_UNFINISHED = """
SELECT m.id FROM mission m JOIN map k ON k.id = m.map_id AND current_map() IN (k.id, k.copy_of)
WHERE m.state IN ('running', 'waiting') ORDER BY m.state, m.id
"""

_MISSIONS = """
SELECT m.id, e.name AS robot, m.goal, m.state, m.reason, m.created_at, m.heartbeat, m.ended_at,
       count(*) FILTER (WHERE s.state = 'done') AS done,
       count(*) FILTER (WHERE s.state = 'failed') AS failed,
       count(*) FILTER (WHERE s.state IN ('planned', 'started')) AS planned,
       k.copy_of IS NOT NULL AS simulated
FROM mission m JOIN entity e ON e.id = m.robot_id LEFT JOIN mission_step s ON s.mission_id = m.id
     JOIN map k ON k.id = m.map_id AND current_map() IN (k.id, k.copy_of)
GROUP BY m.id, e.name, k.copy_of ORDER BY m.id DESC
"""

_CANCEL = """
UPDATE mission m SET state = 'cancelled', reason = 'on request', ended_at = clock_timestamp()
FROM map k WHERE m.id = :mission AND k.id = m.map_id AND current_map() IN (k.id, k.copy_of)
AND m.state IN ('waiting', 'running')
"""

_STEPS = """
SELECT number, action, arguments, state, started_at, ended_at, cause, message FROM mission_step
WHERE mission_id = :mission ORDER BY number
"""

_FAILURES = """
SELECT action, command, cause, coalesce(message, '') AS message FROM mission_step
WHERE mission_id = :mission AND state = 'failed' ORDER BY number
"""
