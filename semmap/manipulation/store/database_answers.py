"""Shared by the stores of manipulation knowledge: refusals of the database, and small reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import psycopg
from psycopg import errors

from semmap.manipulation.error import ManipulationError
from semmap.query.refusal import refusal_text
from semmap.suggestions import suggestion

OWN, SIMULATION, ASSUMED = "own", "simulation", "assumed"
"""Contributors that each database has: its own robots, trials in simulation, and actions of
simulated robots whose outcome nobody tried, which count for nothing."""


@contextmanager
def refusals() -> Iterator[None]:
    """Raise refusals of the database as errors of this package, or LookupError for a name."""
    try:
        yield
    except errors.CheckViolation as error:
        raise ManipulationError(refusal_text(error)) from error
    except errors.DataError as error:
        reason = error.diag.message_primary or str(error)
        raise ManipulationError(f"a value cannot be stored: {reason}") from error
    except errors.NoDataFound as error:
        raise LookupError(refusal_text(error)) from error
    except errors.InsufficientPrivilege as error:
        raise ManipulationError(
            f"this login may not do that ({error.diag.message_primary}): ask an admin"
        ) from error


def contributor_id(session: psycopg.Connection[Any], name: str) -> int:
    """The id of a contributor; LookupError without one of this name."""
    row = session.execute("SELECT id FROM contributor WHERE name = %s", (name,)).fetchone()
    if row is None:
        known = column(session, "SELECT name FROM contributor")
        raise LookupError(
            f"there is no contributor {name}"
            f"{suggestion(name, known, 'semmap manipulation trust NAME KEY adds one')}"
        )
    return int(row[0])


def column(session: psycopg.Connection[Any], query: str, values: Sequence[Any] = ()) -> list[Any]:
    """The first column of a query."""
    return [row[0] for row in session.execute(query.encode(), values).fetchall()]


def number(cursor: psycopg.Cursor[Any]) -> int:
    """The only number of a result."""
    row = cursor.fetchone()
    assert row is not None
    return int(row[0])
