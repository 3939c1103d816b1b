"""Whether tests left a map that disagrees with itself."""

from __future__ import annotations

import psycopg
from sqlalchemy import URL

__all__ = ["Contradiction", "contradictions"]

Contradiction = tuple[str, str, str | None, str, str | None]
"""Map, entity, its holder, the kind of problem, and the holder that the geometry shows."""

FOUND = """
SELECT map, name, holder, origin || ' holder', geometry_says FROM semmap.inventory_contradiction
UNION ALL
SELECT map, name, holder, 'world pose', NULL FROM semmap.world_mismatch
LIMIT 10
"""


def contradictions(database: URL) -> list[Contradiction]:
    """Return where stored holders and poses are not those that would be derived, ten at most.

    A database without the schema, or with that of an earlier revision, has none.
    """
    url = database.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url) as connection:
        installed = "SELECT to_regclass('semmap.inventory_contradiction') IS NOT NULL"
        if connection.execute(installed).fetchone() == (False,):
            return []
        if connection.execute("SELECT FROM semmap.placement LIMIT 1").fetchone() is None:
            return []
        return connection.execute(FOUND).fetchall()
