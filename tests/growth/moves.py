"""Moves of one entity, and what the database keeps of them."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import Any

import psycopg

TABLES = ("placement", "world", "placement_history", "change")
"""What a move writes."""

BATCH = 100

RETENTION = """
UPDATE retention SET keep_for = make_interval(secs => %(keep)s),
    keep_every = CASE WHEN kind <> 'change' THEN make_interval(secs => %(every)s) END
"""
"""Sets the retention of all kinds, in seconds."""


def move(
    connection: psycopg.Connection[Any], entity: int, moves: int, seed: int = 0
) -> Iterator[int]:
    """Move an entity by a few centimetres, each time in a transaction; yields after each 100 moves.

    Parameters
    ----------
    connection : in autocommit mode, with the schema in its search path
    """
    draw = Random(seed)
    found = connection.execute(
        "SELECT pose[1], pose[2], pose[3] FROM world WHERE entity_id = %s", [entity]
    ).fetchone()
    assert found is not None
    x, y, z = found
    for done in range(moves):
        to = (x + draw.uniform(-0.02, 0.02), y + draw.uniform(-0.02, 0.02))
        connection.execute("SELECT move_to(%s, %s, %s, %s)", [entity, *to, z])
        if (done + 1) % BATCH == 0:
            yield done + 1


def versions(connection: psycopg.Connection[Any], entity: int) -> int:
    """The number of former placements of an entity."""
    statement = "SELECT count(*) FROM placement_history WHERE entity_id = %s"
    return int(_value(connection, statement, entity))


def expired_changes(connection: psycopg.Connection[Any]) -> int:
    """The number of changes that are stored longer than their retention."""
    return int(
        _value(
            connection,
            "SELECT count(*) FROM change WHERE at < clock_timestamp() - "
            "(SELECT keep_for FROM retention WHERE kind = 'change')",
        )
    )


def gaps(connection: psycopg.Connection[Any]) -> int:
    """The number of former placements that do not end where their successor begins."""
    return int(
        _value(
            connection,
            "SELECT count(*) FROM (SELECT upper(during) AS ends, coalesce(lead(lower(during)) OVER "
            "(PARTITION BY entity_id ORDER BY lower(during)), p.since) AS begins "
            "FROM placement_history h JOIN placement p USING (entity_id)) v WHERE ends <> begins",
        )
    )


def sizes(connection: psycopg.Connection[Any]) -> dict[str, tuple[int, int, int]]:
    """Rows, dead rows and bytes of each table, indexes included."""
    connection.execute("SELECT pg_stat_clear_snapshot()")
    tables = connection.execute(
        "SELECT relname, n_dead_tup, pg_total_relation_size(relid) FROM pg_stat_user_tables "
        "WHERE schemaname = 'semmap'"
    )
    return {
        name: (row(connection, f"SELECT count(*) FROM {name}")[0], dead, size)
        for name, dead, size in tables.fetchall()
    }


def row(connection: psycopg.Connection[Any], statement: str, *values: object) -> Any:
    """The first row of a statement's result."""
    found = connection.execute(statement, values).fetchone()
    assert found is not None
    return found


def _value(connection: psycopg.Connection[Any], statement: str, *values: object) -> Any:
    return row(connection, statement, *values)[0]
