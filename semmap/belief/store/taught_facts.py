"""What teachings change, row by row, and their return to the former values.

Triggers note the changes, and take them back: `schema/functions/485_teaching.sql`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psycopg
from psycopg import errors, sql
from psycopg.rows import dict_row
from psycopg.types.json import Jsonb

from semmap.belief.error import BeliefError

Session = psycopg.Connection[Any]
Row = dict[str, Any]


@contextmanager
def noted(session: Session, name: str) -> Iterator[None]:
    """Note all changes within as a teaching of the map of this name, in an open transaction."""
    session.execute(
        "WITH t AS (INSERT INTO teaching (map_id, name) VALUES (current_map(), %s) RETURNING id) "
        "SELECT set_config('semmap.teaching', id::text, true) FROM t",
        (name,),
    )
    yield
    session.execute("SELECT set_config('semmap.teaching', '', true)")


def restate(session: Session, table: str, key: Row, what: str = "") -> None:
    """Note what is there already and is taught again; it stays when the first is taken back.

    `key` identifies a row. `what` is empty for the row itself, else ``properties.NAME`` or a
    column. Call it before the change: a row or property that is not there is not noted.
    """
    values = sql.SQL("t.properties" if what.startswith("properties.") else "to_jsonb(t)")
    same = [
        sql.SQL("t.{} = {}").format(sql.Identifier(n), sql.Placeholder(f"key {n}")) for n in key
    ]
    statement = sql.SQL(
        "INSERT INTO taught_fact (teaching_id, of_table, key, what, former, taught) "
        "SELECT current_setting('semmap.teaching')::bigint, %(table)s, %(key)s, %(what)s, v, v "
        "FROM (SELECT CASE WHEN %(what)s = '' THEN '{{}}' "
        "ELSE jsonb_build_object(%(name)s::text, {values} -> %(name)s) END AS v "
        "FROM {table} t WHERE {same} AND (%(what)s = '' OR {values} ? %(name)s)) there"
    ).format(values=values, table=sql.Identifier(table), same=sql.SQL(" AND ").join(same))
    given = {"table": table, "key": Jsonb(key), "what": what}
    given |= {"name": what.removeprefix("properties.")}
    session.execute(statement, given | {f"key {name}": value for name, value in key.items()})


def list_teachings(session: Session) -> list[Row]:
    """Return the teachings of the map, the newest first, with how many facts each has."""
    with session.cursor(row_factory=dict_row) as cursor:
        return cursor.execute(
            "SELECT t.id, t.name, (SELECT count(DISTINCT (of_table, key, what)) FROM taught_fact f "
            "WHERE f.teaching_id = t.id) AS facts, t.by, t.at "
            "FROM teaching t WHERE t.map_id = current_map() ORDER BY t.id DESC"
        ).fetchall()


def undo_teaching(session: Session, teaching: int) -> list[str]:
    """Take back a teaching of the map; return what stays, because others use it.

    What another teaching states, too, stays, as does a value that was changed since. LookupError
    if the map has no such teaching; `BeliefError` for a login that may not do this.
    """
    known = "SELECT FROM teaching WHERE id = %s AND map_id = current_map()"
    if not session.execute(known, (teaching,)).rowcount:
        raise LookupError(f"the map has no teaching {teaching}: `semmap belief taught` lists them")
    try:
        with session.transaction():
            row = session.execute("SELECT undo_teaching(%s)", (teaching,)).fetchone()
            session.execute("SELECT refresh_beliefs()")
    except errors.InsufficientPrivilege as error:
        raise BeliefError(
            f"teaching {teaching}: this login may not take it back: ask an admin of the database"
        ) from error
    assert row is not None
    return list(row[0])
