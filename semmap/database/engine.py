"""Engines: which database, and what every connection to it has in common."""

from __future__ import annotations

import os

from psycopg.conninfo import make_conninfo
from psycopg.errors import ConnectionTimeout
from sqlalchemy import URL, Engine, create_engine, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, OperationalError

from semmap.database import revisions
from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.parameters import (
    CONNECT_TIMEOUT,
    SETTINGS,
    connection_parameters,
    lost_folder,
    unreachable,
)
from semmap.database.patience import Patience
from semmap.terminal import print_waiting


def database_url(url: str | URL | Cluster | None = None) -> URL:
    """Which database is meant: `url`, else ``$SEMMAP_DB``, else the embedded cluster, started.

    Parameters
    ----------
    url : ``postgresql://user:password@host:port/name``, as psql takes it, or an embedded cluster

    Raises
    ------
    DatabaseError
        The URL is not one of a PostgreSQL database, or the embedded cluster cannot be had.
    """
    source = "the database URL"
    if url is None and os.environ.get("SEMMAP_DB"):
        url, source = os.environ["SEMMAP_DB"], "SEMMAP_DB"
    if url is None:
        url = Cluster()
    if isinstance(url, Cluster):
        return url.ensure()
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError) as error:
        raise DatabaseError(
            f"{source} cannot be read: {error}. "
            "It has the form postgresql://user:password@host:5432/database"
        ) from error
    if parsed.drivername not in ("postgresql", "postgres", "postgresql+psycopg"):
        raise DatabaseError(
            f"{source} names {parsed.drivername}, but the map needs PostgreSQL with PostGIS: "
            "postgresql://user:password@host:5432/database"
        )
    return parsed.set(drivername="postgresql+psycopg")


def open_engine(
    url: str | URL | Cluster | None = None, *, migrate: bool = True, check: bool = False
) -> Engine:
    """An engine for the map's database, which is made, started and brought up to date at need.

    A server that starts, recovers from a crash or stops is waited for, a minute at most; one that
    does not answer, five seconds.

    Every connection has the search path ``semmap, public``, the time zone UTC and the application
    name ``semmap`` (unless the URL gives another).

    Parameters
    ----------
    url : the database, or an embedded cluster; by default ``$SEMMAP_DB``, else the user's cluster
    migrate : bring the schema to the newest revision where it is behind
    check : change nothing, and refuse a database without an embedded cluster or the newest schema

    Raises
    ------
    DatabaseError
        The database cannot be reached or used; the message says what to do.

    Examples
    --------
    >>> engine = open_engine()
    >>> with engine.connect() as connection:
    ...     connection.exec_driver_sql("SELECT count(*) FROM map").scalar()
    0
    >>> engine.dispose()
    """
    if check:
        connection_parameters(url)
    address, engine, version = _reach(url)
    try:
        if check:
            revisions.check_revision(version)
        elif migrate:
            _upgrade(engine, version)
    except OperationalError as error:
        engine.dispose()
        raise DatabaseError(_unreachable(address, error)) from error
    except BaseException:
        engine.dispose()
        raise
    return engine


def _reach(url: str | URL | Cluster | None) -> tuple[URL, Engine, str | None]:
    """The database's URL, an engine on it, and its revision; a server that starts is waited for."""
    patience = Patience()
    while True:
        address = database_url(url)  # an embedded server that died meanwhile is started again
        engine = make_engine(address)
        try:
            return address, engine, revisions.installed_on(engine)
        except OperationalError as error:
            engine.dispose()
            hopeless = isinstance(error.orig, ConnectionTimeout) or lost_folder(_host(address))
            if hopeless or not patience.allows_another(_conninfo(engine)):
                raise DatabaseError(_unreachable(address, error, patience.busy)) from error
        except BaseException:
            engine.dispose()
            raise


def _conninfo(engine: Engine) -> str:
    _, arguments = engine.dialect.create_connect_args(engine.url)
    arguments.pop("context", None)  # of psycopg, not of the protocol
    return make_conninfo(**arguments)


def _upgrade(engine: Engine, version: str | None) -> None:
    try:
        revisions.check_revision(version)
    except revisions.OldSchema:
        new = revisions.newest()
        print_waiting(f"bringing the schema from {version or 'nothing'} to {new} ...")
        from semmap.database.migrate import upgrade  # Alembic takes 0.4 s to import

        upgrade(engine)


def make_engine(url: URL) -> Engine:
    """An engine whose connections have what `open_engine` says; it reaches for no server."""
    query = dict(url.query)
    given = query.pop("options", "")
    options = " ".join([*([given] if isinstance(given, str) else given), *_options()]).strip()
    query.setdefault("application_name", "semmap")
    query.setdefault("connect_timeout", CONNECT_TIMEOUT)
    return create_engine(
        url.set(query=query),
        connect_args={"options": options},
        pool_pre_ping=True,
        pool_use_lifo=True,
    )


def _options() -> list[str]:
    return [f"-c {name}={value}" for name, value in SETTINGS.items()]


def _unreachable(url: URL, error: DBAPIError, busy: bool = False) -> str:
    return unreachable(url.render_as_string(hide_password=True), _host(url), error.orig, busy)


def _host(url: URL) -> object:
    """The host of a URL, or the folder of its socket."""
    return url.query.get("host", url.host)
