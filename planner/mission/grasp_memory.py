"""Which grasp a pickup uses, and what its outcome teaches (Tosello et al., section IV).

A task of the table ``task`` begins with the pickup and ends with it, so a restart does not lose it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, text

from planner.mission.behaviours import Outcome
from planner.mission.command import Command

if TYPE_CHECKING:
    from sqlalchemy import Engine

__all__ = ["GraspMemory", "has_gripper"]

TRIED = ("missed", "dropped")
"""Causes of failures that say something of the grasp; the object was not reached in others."""


def has_gripper(engine: Engine) -> bool:
    """Whether a gripper is stored that is meant where none is named."""
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT preferred FROM gripper")).scalars().all()
    return len(rows) == 1 or any(rows)


@dataclass(frozen=True)
class GraspMemory:
    """Chooses grasps for pickups, stored ones before generated ones, and counts their outcomes.

    Attributes
    ----------
    gripper : name of a stored gripper; the preferred one where None
    simulated : outcomes count for the contributor ``simulation``
    """

    gripper: str | None = None
    simulated: bool = False

    def begin(self, connection: Connection, robot: int, command: Command) -> int | None:
        """Store that a robot begins a pickup; return the id of the action that it uses.

        None where no grasp is known and none can be generated: the pickup begins without.

        Raises
        ------
        LookupError
            There is no such gripper.
        """
        from semmap.belief.store import driver
        from semmap.manipulation.device_store import gripper_id
        from semmap.manipulation.retrieval import find_grasps
        from semmap.manipulation.task_store import add_task

        session = driver(connection)
        gripper_id(session, self.gripper)
        with session.transaction():
            found = find_grasps(session, name=command.arguments[0], gripper=self.gripper, limit=1)
            if not found.rows:
                return None
            action = int(found.rows[0]["action_id"])
            add_task(
                session,
                command.arguments[0],
                action=action,
                robot=_name(connection, robot),
                outcome="running",
                simulated=self.simulated,
            )
        return action

    def end(self, connection: Connection, robot: int, command: Command, outcome: Outcome) -> None:
        """Store how the pickup that a robot began has ended."""
        counts = outcome.succeeded or outcome.cause in TRIED
        connection.execute(
            text(_END),
            {
                "robot": robot,
                "item": command.arguments[0],
                "outcome": "completed" if outcome.succeeded else "error",
                "message": outcome.message or None,
                "counts": counts,
            },
        )


def _name(connection: Connection, robot: int) -> Any:
    return connection.execute(
        text("SELECT name FROM entity WHERE id = :id"), {"id": robot}
    ).scalar()


_END = """
UPDATE task SET outcome = :outcome, message = :message,
       action_id = CASE WHEN :counts THEN action_id END
WHERE robot_id = :robot AND kind = 'grasp' AND outcome = 'running'
  AND entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :item)
"""
