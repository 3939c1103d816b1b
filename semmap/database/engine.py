"""Engines: which database, and what every connection to it has in common."""

from __future__ import annotations

from contextlib import closing
from typing import Any

from sqlalchemy import URL, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError, OperationalError

from semmap.database import revisions
from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.parameters import (
    CONNECT_TIMEOUT,
    FORM,
    SETTINGS,
    connection_parameters,
    meant,
    unreachable,
)
from semmap.database.reach import reach
from semmap.database.sure_connection import SureConnection
from semmap.terminal import print_waiting


def database_url(url: str | URL | Cluster | None = None) -> URL:
    """Which database is meant: `url`, else ``$SEMMAP_DB``, else the embedded cluster, started.

    The URL has the form ``postgresql://user:password@host:port/name``, as psql takes it.
    DatabaseError where it is not one of PostgreSQL, or the embedded cluster cannot be had.
    """
    chosen, source = meant(url)
    if isinstance(chosen, Cluster):
        return chosen.ensure()
    stated = connection_parameters(url)  # refuses what is none of PostgreSQL
    if "," in str(stated.get("host", "")):
        return _url_of_several(stated)
    try:
        return make_url(chosen).set(drivername="postgresql+psycopg")
    except (ArgumentError, ValueError) as error:
        raise DatabaseError(f"{source} cannot be read: {error}. {FORM}") from error


def _url_of_several(parameters: dict[str, Any]) -> URL:
    """SQLAlchemy states several servers, and what their connections have, in the query."""
    login = {"username": "user", "password": "password", "database": "dbname"}
    named = {name: parameters.get(meant) for name, meant in login.items()}
    query = {k: str(v) for k, v in parameters.items() if k not in login.values()}
    return URL.create("postgresql+psycopg", **named, query=query)


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
    with closing(reach(url, create=not check)) as session:
        version = revisions.installed(session)
    if check:
        revisions.check_revision(version)
    address = database_url(url)
    engine = make_engine(address)
    try:
        if migrate and not check:
            _upgrade(engine, version)
    except OperationalError as error:
        engine.dispose()
        where, host = address.render_as_string(), address.query.get("host", address.host)
        raise DatabaseError(unreachable(where, host, error.orig)) from error
    except BaseException:
        engine.dispose()
        raise
    return engine


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
    stated = [given] if isinstance(given, str) else [*given]
    options = " ".join([*stated, *(f"-c {name}={value}" for name, value in SETTINGS.items())])
    query.setdefault("application_name", "semmap")
    query.setdefault("connect_timeout", CONNECT_TIMEOUT)
    engine = create_engine(
        url.set(query=query),
        connect_args={"options": options.strip()},
        pool_pre_ping=True,
        pool_use_lifo=True,
    )
    event.listen(engine, "do_connect", _connect)
    return engine


def _connect(dialect: object, record: object, args: list[Any], given: dict[str, Any]) -> Any:
    return SureConnection.connect(*args, **given)
