"""The login that only reads, on an embedded database."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psycopg
from psycopg.conninfo import make_conninfo

from semmap.database.configuration import READER, SUPERUSER
from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.rights import LIMIT_RIGHTS, excess_rights
from semmap.database.shared_engine import SharedConnection

if TYPE_CHECKING:
    from sqlalchemy import Engine

RELOAD_SECONDS = 10.0
"""How long the server may take to read its user map again."""


def reading_session(session: psycopg.Connection[Any]) -> psycopg.Connection[Any] | None:
    """Open a session with the same embedded database whose login, ``semmap_read``, can only read.

    A cluster or database that was made without that login, or gave everybody more, is changed now.
    None if the database is not an embedded one. DatabaseError where the login cannot be made, or
    has rights beyond reading that have to be taken by hand.
    """
    if session.info.user != SUPERUSER or session.info.host[:1] != "/":
        return None
    conninfo = make_conninfo(session.info.dsn, user=READER)
    reader = _login(conninfo)
    excess = None if reader is None else excess_rights(reader)
    if excess != []:
        if reader is not None:
            reader.close()
        cluster = _cluster(session)
        if cluster is None:
            return None
        _prepare(cluster, session)
        reader = _login(conninfo, patience=RELOAD_SECONDS)
        assert reader is not None
        excess = excess_rights(reader)
    if excess:
        assert reader is not None
        reader.close()
        raise DatabaseError(
            f"the login {READER} can do more than read: {', '.join(excess)}. Take it away "
            "(semmap db psql), or call with --write"
        )
    return reader


def as_reader(engine: Engine) -> Engine | None:
    """An engine on the same database with the login of `reading_session`; None as of that."""
    from semmap.database.engine import make_engine
    from semmap.database.maps import driver_of

    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        reader = reading_session(driver_of(connection))
    if reader is None:
        return None
    reader.close()
    return make_engine(engine.url.set(username=READER))


def _login(conninfo: str, patience: float = 0.0) -> psycopg.Connection[Any] | None:
    """Log in as the reader; None if that is not possible, without `patience`, seconds."""
    deadline = time.monotonic() + patience
    while True:
        try:
            return SharedConnection.connect(conninfo, autocommit=True)
        except psycopg.OperationalError as error:
            if not patience:
                return None
            if time.monotonic() > deadline:
                raise DatabaseError(f"the login {READER} does not work: {error}") from error
        time.sleep(0.05)


def _cluster(session: psycopg.Connection[Any]) -> Cluster | None:
    """The cluster of this user that a session is connected with, if it is one."""
    row = session.execute(
        "SELECT setting FROM pg_settings WHERE name = 'data_directory'"
    ).fetchone()
    if row is None:  # only a superuser is told
        return None
    cluster = Cluster(Path(row[0]).parent)
    running = cluster.running()
    return cluster if running is not None and running.samefile(session.info.host) else None


def _prepare(cluster: Cluster, session: psycopg.Connection[Any]) -> None:
    """Make the login, take from everybody what it must not have, and let it in."""
    with session.transaction():
        session.execute(LIMIT_RIGHTS)  # as it stands: its percent signs are its own
    cluster.write_user_map()
    session.execute("SELECT pg_reload_conf()")
