"""The steps of a mission, in the table `mission_step`: planned, started, and done or failed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sqlalchemy import Connection, text

from planner.mission.behaviours import Outcome
from planner.mission.command import Command
from planner.mission.retry_policy import Failure


def read_steps(connection: Connection, mission: int) -> list[dict[str, Any]]:
    """The steps in order: action, arguments, state, times, cause and message."""
    rows = connection.execute(text(_STEPS), {"mission": mission}).mappings()
    return [dict(row) for row in rows]


def read_failures(connection: Connection, mission: int) -> list[Failure]:
    """The steps that failed, in order."""
    rows = connection.execute(text(_FAILURES), {"mission": mission})
    return [_failure(row, Command.of_json(row.command)) for row in rows]


def _failure(row: Any, command: Command) -> Failure:
    failure = Failure(row.action, command.subject, row.cause, row.message, command.at)
    if row.action == "place" and failure.is_of_base:  # what it holds is not the reason
        return replace(failure, subject=command.arguments[-1])
    return failure


def read_unfinished_steps(connection: Connection, mission: int) -> Sequence[Any]:
    """Number, state and command, as JSON, of each started or planned step, in order."""
    return connection.execute(text(_UNFINISHED), {"mission": mission}).all()


def read_target(connection: Connection, mission: int, item: str) -> str | None:
    """What an object is put on by the first planned step that puts it down; None without one."""
    found = connection.execute(text(_TARGET), {"mission": mission, "item": item}).scalar()
    return None if found is None else str(found)


def forget_planned(connection: Connection, mission: int) -> None:
    """Delete the planned steps."""
    connection.execute(text(_FORGET), {"mission": mission})


def replace_planned(connection: Connection, mission: int, commands: Sequence[Command]) -> list[int]:
    """Replace the planned steps by these commands; returns their numbers."""
    forget_planned(connection, mission)
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


def start_step(connection: Connection, mission: int, number: int, command: Command) -> None:
    """Write that a planned step is started, with this command."""
    connection.execute(
        text(_START),
        {"mission": mission, "number": number, "command": json.dumps(command.as_json())},
    )


def end_step(connection: Connection, mission: int, number: int, outcome: Outcome) -> None:
    """Write that a started step is done or has failed."""
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


_STEPS = """
SELECT number, action, arguments, state, started_at, ended_at, cause, message FROM mission_step
WHERE mission_id = :mission ORDER BY number
"""

_FAILURES = """
SELECT action, command, cause, coalesce(message, '') AS message FROM mission_step
WHERE mission_id = :mission AND state = 'failed' ORDER BY number
"""

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

_TARGET = """
SELECT arguments[2] FROM mission_step
WHERE mission_id = :mission AND state = 'planned' AND action = 'place' AND arguments[1] = :item
ORDER BY number LIMIT 1
"""
