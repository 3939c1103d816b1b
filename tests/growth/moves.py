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
    """Rows, dead rows and bytes of each table that a move writes, indexes included."""
    connection.execute("SELECT pg_stat_clear_snapshot()")
    found = {}
    for table in TABLES:
        dead = _value(connection, "SELECT pg_stat_get_dead_tuples(%s::regclass)", f"semmap.{table}")
        total = _value(connection, "SELECT pg_total_relation_size(%s)", f"semmap.{table}")
        rows = _value(connection, f"SELECT count(*) FROM {table}")
        found[table] = (int(rows), int(dead), int(total))
    return found


def _value(connection: psycopg.Connection[Any], statement: str, *values: object) -> Any:
    row = connection.execute(statement, values).fetchone()
    assert row is not None
    return row[0]
