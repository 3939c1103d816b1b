"""Sessions of psycopg with the map's database: without SQLAlchemy, which takes long to import."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psycopg
from psycopg.conninfo import conninfo_to_dict, make_conninfo

from semmap.database import revisions
from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.patience import BUSY_SECONDS, Patience

if TYPE_CHECKING:
    from sqlalchemy import URL

__all__ = ["CONNECT_TIMEOUT", "SETTINGS", "connection_parameters", "open_session"]

SETTINGS = {"search_path": "semmap,public", "timezone": "UTC"}
"""What every session is opened with."""

CONNECT_TIMEOUT = "10"
"""Seconds after which a server that does not answer is given up."""

FORM = "It has the form postgresql://user:password@host:5432/database"


def connection_parameters(
    url: str | URL | Cluster | None = None, *, create: bool = False
) -> dict[str, Any]:
    """libpq's parameters of the database that is meant: `url`, else ``$SEMMAP_DB``, else embedded.

    Parameters
    ----------
    url : ``postgresql://user:password@host:port/name``, as psql takes it, or an embedded cluster
    create : make the embedded cluster if there is none yet; one that is there is started anyway

    Raises
    ------
    DatabaseError
        The URL is not one of a PostgreSQL database, or there is no embedded cluster.
    """
    source = "the database URL"
    if url is None and os.environ.get("SEMMAP_DB"):
        url, source = os.environ["SEMMAP_DB"], "SEMMAP_DB"
    if url is None:
        url = Cluster()
    if isinstance(url, Cluster):
        if not (create or url.exists):
            raise DatabaseError(
                f"there is no map yet: the embedded database, {url.home}, has not been made. "
                "semmap import FILE makes it; or name a database: SEMMAP_DB, --db"
            )
        return dict(url.parameters(url.start()))
    text = url if isinstance(url, str) else url.render_as_string(hide_password=False)
    scheme, colon, rest = text.partition("://")
    if colon and scheme not in ("postgresql", "postgres", "postgresql+psycopg"):
        raise DatabaseError(
            f"{source} names {scheme}, but the map needs PostgreSQL with PostGIS: "
            "postgresql://user:password@host:5432/database"
        )
    if not colon:
        raise DatabaseError(f"{source} cannot be read: {text}. {FORM}")
    try:
        return dict(conninfo_to_dict(f"postgresql://{rest}"))
    except psycopg.ProgrammingError as error:
        cause = str(error).strip().splitlines()[0]
        raise DatabaseError(f"{source} cannot be read: {cause}. {FORM}") from error


def open_session(
    url: str | URL | Cluster | None = None, *, migrate: bool = False
) -> psycopg.Connection[Any]:
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
    patience = Patience()
    while True:
        parameters = connection_parameters(url, create=migrate)
        given = parameters.pop("options", "") or ""
        settings = " ".join(f"-c {name}={value}" for name, value in SETTINGS.items())
        conninfo = make_conninfo(
            **{"application_name": "semmap", "connect_timeout": CONNECT_TIMEOUT} | parameters,
            options=f"{given} {settings}".strip(),
        )
        try:
            session = psycopg.connect(conninfo, autocommit=True)
            break
        except psycopg.OperationalError as error:
            hopeless = isinstance(error, psycopg.errors.ConnectionTimeout)
            if hopeless or lost_folder(parameters) or not patience.allows_another(conninfo):
                message = unreachable(parameters, error, patience.busy)
                raise DatabaseError(message) from error
    try:
        check_revision(revisions.installed(session), migrate)
    except OldSchema as error:
        session.close()
        if not migrate:
            raise
        from semmap.database.engine import connect  # with Alembic and SQLAlchemy

        connect(url).dispose()
        del error
        return open_session(url)
    except BaseException:
        session.close()
        raise
    return session


class OldSchema(DatabaseError):
    """The database lacks the schema, or has it at a former revision."""


def check_revision(version: str | None, migrate: bool = False) -> None:
    """Refuse a revision of the schema that is not this semmap's.

    Raises
    ------
    OldSchema
        There is no schema, or a former one: ``semmap db upgrade`` helps.
    DatabaseError
        A newer semmap made it.
    """
    if version == revisions.newest():
        return
    if version is None:
        raise OldSchema(
            "the database has no semmap schema: semmap db upgrade makes it, semmap import FILE, too"
        )
    if version not in revisions.parents():
        raise DatabaseError(
            f"the database has the revision {version}, which this semmap does not know: "
            "a newer semmap made it, and it takes that one to use it"
        )
    raise OldSchema(
        f"the schema is at revision {version}, this semmap needs {revisions.newest()}: "
        "run semmap db upgrade"
    )


def unreachable(parameters: dict[str, Any], error: BaseException, busy: bool = False) -> str:
    """Why there is no connection, and what to do."""
    where = " ".join(
        f"{k}={parameters[k]}" for k in ("host", "port", "user", "dbname") if parameters.get(k)
    )
    cause = str(error).strip().splitlines()
    if folder := lost_folder(parameters):
        hint = f"There is no socket directory {folder}."
    elif busy:
        hint = (
            f"The server is still starting, recovering or stopping after {BUSY_SECONDS:g} s: "
            "call again later."
        )
    else:
        hint = "Is the server running, and are user, password and database name right?"
    return (
        f"no connection to {where or 'the default server'}: {cause[-1] if cause else error}. {hint}"
    )


def lost_folder(parameters: dict[str, Any]) -> str | None:
    """The folder of the Unix socket, if it does not exist."""
    host = parameters.get("host")
    if isinstance(host, str) and host.startswith("/") and not Path(host).exists():
        return host
    return None
