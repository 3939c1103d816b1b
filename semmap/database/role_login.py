"""The logins of roles on an embedded database: a statement leaves a role, but not a login."""

from __future__ import annotations

from typing import TYPE_CHECKING

from psycopg import sql
from psycopg.conninfo import make_conninfo

from semmap.database.configuration import SUPERUSER
from semmap.database.maps import driver_of
from semmap.database.user_map import RELOAD_SECONDS, admit_logins, cluster_of, log_in
from semmap.error import RightsError

if TYPE_CHECKING:
    from sqlalchemy import URL, Engine


def login_url(engine: Engine, role: str) -> URL | None:
    """The URL by which a role logs in on the same embedded database; it may from now on.

    None if the database is not an embedded one. RightsError if there is no such role.
    """
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        session = driver_of(connection)
        if session.info.user != SUPERUSER or session.info.host[:1] != "/":
            return None
        cluster = cluster_of(session)
        if cluster is None:
            return None
        conninfo = make_conninfo(session.info.dsn, user=role)
        login = log_in(conninfo)
        if login is None:
            with session.transaction():
                session.execute("LOCK TABLE pg_catalog.pg_authid IN SHARE ROW EXCLUSIVE MODE")
                known = session.execute(
                    "SELECT rolcanlogin FROM pg_roles WHERE rolname = %s", (role,)
                ).fetchone()
                if known is None:
                    raise RightsError(f"there is no role {role}: give its token another one")
                if not known[0]:
                    session.execute(sql.SQL("ALTER ROLE {} LOGIN").format(sql.Identifier(role)))
            admit_logins(cluster, session)
            login = log_in(conninfo, patience=RELOAD_SECONDS)
        assert login is not None
        login.close()
    return engine.url.set(username=role)
