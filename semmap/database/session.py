"""Sessions of psycopg with the map's database: without SQLAlchemy, which takes long to import."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, Any

import psycopg
from psycopg.pq import TransactionStatus

from semmap.database import revisions
from semmap.database.reach import reach
from semmap.database.shared_engine import SharedConnection

if TYPE_CHECKING:
    from sqlalchemy import URL

    from semmap.database.embedded import Cluster


def open_session(
    url: str | URL | Cluster | None = None, *, migrate: bool = False
) -> SharedConnection:
    """A session in autocommit mode with the map's database, whose schema is of this semmap.

    A server that starts, recovers from a crash or stops is waited for, a minute at most; one that
    does not answer, five seconds. The session has the search path ``semmap, public``, the time zone
    UTC and the application name ``semmap`` (unless the URL gives others).

    Parameters
    ----------
    url : the database, or an embedded cluster; by default ``$SEMMAP_DB``, else the user's cluster
    migrate : make the embedded cluster and the schema, or bring it to the newest revision; without
        it, a database that lacks them is refused and stays as it is

    Raises
    ------
    DatabaseError
        The database cannot be reached or used; the message names the command that helps.
    """
    session = reach(url, create=migrate)
    try:
        revisions.check_revision(revisions.installed(session))
    except revisions.OldSchema:
        session.close()
        if not migrate:
            raise
        from semmap.database.engine import open_engine  # with Alembic and SQLAlchemy

        open_engine(url).dispose()
        return open_session(url)
    except BaseException:
        session.close()
        raise
    return session


def is_idle(session: psycopg.Connection[Any]) -> bool:
    """Whether a session is between transactions, and its server has not left it."""
    if session.closed or session.info.transaction_status != TransactionStatus.IDLE:
        return False
    poll = select.poll()
    poll.register(session.fileno(), select.POLLIN)
    return not poll.poll(0)  # a server has nothing to say to an idle session but that it ends
