"""The login that only reads, on an embedded database."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from psycopg.conninfo import make_conninfo

from semmap.database.configuration import READER, SUPERUSER
from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.rights import LIMIT_RIGHTS, excess_rights
from semmap.database.user_map import RELOAD_SECONDS, admit_logins, cluster_of, log_in

if TYPE_CHECKING:
    import psycopg
    from sqlalchemy import Engine


def reading_session(session: psycopg.Connection[Any]) -> psycopg.Connection[Any] | None:
    """Open a session with the same embedded database whose login, ``semmap_read``, can only read.

    A cluster or database that was made without that login, or gave everybody more, is changed now.
    None if the database is not an embedded one. DatabaseError where the login cannot be made, or
    has rights beyond reading that have to be taken by hand.
    """
    if session.info.user != SUPERUSER or session.info.host[:1] != "/":
        return None
    conninfo = make_conninfo(session.info.dsn, user=READER)
    reader = log_in(conninfo)
    excess = None if reader is None else excess_rights(reader)
    if excess != []:
        if reader is not None:
            reader.close()
        cluster = cluster_of(session)
        if cluster is None:
            return None
        _prepare(cluster, session)
        reader = log_in(conninfo, patience=RELOAD_SECONDS)
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


def _prepare(cluster: Cluster, session: psycopg.Connection[Any]) -> None:
    """Make the login, take from everybody what it must not have, and let it in."""
    with session.transaction():
        session.execute(LIMIT_RIGHTS)  # as it stands: its percent signs are its own
    admit_logins(cluster, session)
