"""What a database has, table by table: equal before and after what must change nothing."""

from __future__ import annotations

import psycopg
from psycopg import sql
from sqlalchemy import make_url

TABLES = """
SELECT c.relname FROM pg_class c JOIN pg_namespace n ON n.oid = c.relnamespace
WHERE n.nspname = 'semmap' AND c.relkind = 'r' AND c.relname <> 'written' ORDER BY 1
"""

CONTENT = """
SELECT count(*), coalesce(sum(hashtextextended(t::text, 0)::numeric), 0) FROM semmap.{} t
"""


def stored(url: str) -> dict[str, tuple[int, int]]:
    """The number of rows and a hash of the content of each table but the keys of transactions."""
    plain = make_url(url).set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(plain) as connection:
        names = [row[0] for row in connection.execute(TABLES).fetchall()]
        found = {}
        for name in names:
            row = connection.execute(sql.SQL(CONTENT).format(sql.Identifier(name))).fetchone()
            assert row is not None
            found[name] = int(row[0]), int(row[1])
    return found
