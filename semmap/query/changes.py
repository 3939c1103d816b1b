"""What changed in the current map: a cursor, and the entities that changed after it."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import Connection, text

__all__ = ["changed_since", "cursor", "now_at", "reaches_back", "settle"]


def cursor(connection: Connection) -> str:
    """Where the history stands in this transaction's snapshot."""
    return str(connection.execute(text("SELECT change_cursor()")).scalar_one())


def now_at(connection: Connection) -> tuple[str, datetime]:
    """The cursor, and when this transaction began, which is what it means by now."""
    cursor, moment = connection.execute(text("SELECT change_cursor(), now()")).one()
    return cursor, moment


def changed_since(connection: Connection, since: str) -> set[int] | None:
    """The entities of the current map that changed after a cursor, deleted ones included.

    None where the changes after the cursor are not all kept: read the whole map again.
    """
    if not reaches_back(connection, since):
        return None
    rows = connection.execute(
        text("SELECT entities FROM changes_since(:since) WHERE map_id = current_map()"),
        {"since": since},
    )
    return {number for (numbers,) in rows for number in numbers}


def settle(connection: Connection) -> None:
    """See to it that what a cursor of this transaction saw is on disk when it commits.

    A server that crashes gives numbers of transactions again that it had not written yet, such as
    that of one which was undone; a cursor that saw the first would take the second for seen. Needed
    where a cursor is kept outside of the database: one that is kept in it is as safe as it is.
    """
    connection.execute(
        text(
            "SELECT set_config('synchronous_commit', 'local', true), CASE WHEN pg_is_in_recovery() "
            "THEN NULL ELSE pg_logical_emit_message(true, 'semmap', '') END"
        )
    )


def reaches_back(connection: Connection, since: str) -> bool:
    """Whether all changes after a cursor are still kept."""
    return bool(connection.execute(text("SELECT reaches_back(:since)"), {"since": since}).scalar())
