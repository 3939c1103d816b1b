"""The claims of robots on connectors and elevators, in the table `reservation`."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import Connection, text

from semmap.error import Error


class GoneError(Error, LookupError):
    """The map has no such connector or elevator any more."""


def claim_all(
    connection: Connection, robot: int, resources: Iterable[str], seconds: float
) -> str | None:
    """Claim connectors and elevators for a robot: all of them, or else roll back.

    Returns None if the robot has them now; else the name of one that another robot has. Raises
    GoneError.
    """
    wanted = sorted(resources)  # in the same order for all robots, so that they cannot deadlock
    for name in wanted:
        got = connection.execute(
            text(_CLAIM), {"name": name, "robot": robot, "seconds": seconds}
        ).scalar()
        if got is None:
            raise GoneError(f"the map has no {name} any more")
        if not got:
            connection.rollback()
            return name
    return None


def release_claims(connection: Connection, robot: int, resources: Iterable[str]) -> None:
    """Release some claims of a robot."""
    for name in resources:
        connection.execute(text(_RELEASE), {"name": name, "robot": robot})


def release_all_claims(connection: Connection, robot: int) -> None:
    """Release all claims of a robot."""
    connection.execute(text(_RELEASE_ALL), {"robot": robot})


def renew_claims(connection: Connection, robot: int, seconds: float) -> frozenset[str]:
    """Extend the claims of a robot by this many seconds; returns the names of what it claims."""
    claims = connection.execute(text(_RENEW), {"robot": robot, "seconds": seconds})
    return frozenset(claims.scalars())


_CLAIM = """
SELECT claim(id, :robot, :seconds) FROM entity WHERE map_id = current_map() AND name = :name
"""

_RELEASE = """
DELETE FROM reservation r USING entity e
WHERE e.map_id = current_map() AND e.name = :name AND r.resource_id = e.id AND r.robot_id = :robot
"""

_RELEASE_ALL = "DELETE FROM reservation WHERE robot_id = :robot"

_RENEW = """
WITH renewed AS (
    UPDATE reservation SET expires = clock_timestamp() + make_interval(secs => :seconds)
    WHERE robot_id = :robot RETURNING resource_id)
SELECT e.name FROM renewed r JOIN entity e ON e.id = r.resource_id
"""
