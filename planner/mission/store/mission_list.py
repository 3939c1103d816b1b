"""The missions of a map: add, list and cancel them. No runner is needed for that."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, text

from planner.mission.retry_policy import Failure
from planner.mission.store.map_connection import MapConnection, MissionError
from planner.mission.store.mission_steps import read_failures, read_steps


class MissionList(MapConnection):
    """The missions of one map and of its simulations, on a connection that stays open."""

    def add(self, robot: str, goal: str) -> int:
        """Add a waiting mission; returns its number. MissionError: the map has no such robot."""
        with self._begin() as connection:
            number = connection.execute(text(_ADD), {"robot": robot, "goal": goal}).scalar()
            if number is None:
                raise MissionError(
                    f"there is no robot named {robot} in {self.map_name}: place an agent of that "
                    "name, or give its start (--from)"
                )
        return int(number)

    def robot_of(self, mission: int) -> str:
        """The robot of a mission.

        Raises
        ------
        MissionError
        """
        with self._begin() as connection:
            return str(read_mission(connection, mission).robot)

    def goal_of(self, mission: int) -> str:
        """The goal of a mission.

        Raises
        ------
        MissionError
        """
        with self._begin() as connection:
            return str(read_mission(connection, mission).goal)

    def map_of(self, mission: int) -> str:
        """The name of the map of a mission: this map, or a copy of it for simulated runs.

        Raises
        ------
        MissionError
        """
        with self._begin() as connection:
            return str(read_mission(connection, mission).map)

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
            return read_steps(connection, mission)

    def failures(self, mission: int) -> list[Failure]:
        """The steps of a mission that failed, in order."""
        with self._begin() as connection:
            return read_failures(connection, mission)

    def cancel(self, mission: int) -> bool:
        """Cancel a mission; its runner stops the robot. Returns False if it has ended.

        Raises MissionError: it is another robot's, and this login has no right to cancel it.
        """
        with self._begin() as connection:
            if connection.execute(text(_CANCEL), {"mission": mission}).rowcount:
                return True
            row = _find_mission(connection, mission)
            if row is not None and row.state in ("waiting", "running"):
                raise MissionError(
                    f"mission {mission} is {row.robot}'s: cancel it as that robot or as an admin"
                )
            return False


def read_mission(connection: Connection, mission: int) -> Any:
    """The goal, state, reason and runner of a mission, and the id and name of its robot.

    Raises
    ------
    MissionError
        The map has no such mission.
    """
    row = _find_mission(connection, mission)
    if row is None:
        raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
    return row


def _find_mission(connection: Connection, mission: int) -> Any | None:
    return connection.execute(text(_MISSION), {"mission": mission}).one_or_none()


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
