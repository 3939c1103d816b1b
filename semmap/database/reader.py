"""The login that only reads, on an embedded database."""

from __future__ import annotations

import time
from pathlib import Path

from sqlalchemy import Engine
from sqlalchemy.exc import OperationalError

from semmap.database.configuration import READER, SUPERUSER
from semmap.database.embedded import Cluster
from semmap.database.engine import make_engine
from semmap.database.error import DatabaseError
from semmap.database.rights import excess_rights, limit_rights

__all__ = ["as_reader"]

RELOAD_SECONDS = 10.0
"""How long the server may take to read its user map again."""


def as_reader(engine: Engine) -> Engine | None:
    """An engine on the same embedded database whose login, ``semmap_read``, can only read.

    A cluster or database that was made without that login, or gave everybody more, is changed now.

    Parameters
    ----------
    engine : one of `connect`

    Returns
    -------
    None if the database is not an embedded one

    Raises
    ------
    DatabaseError
        The login cannot be made, or has rights beyond reading that have to be taken by hand.
    """
    folder = engine.url.query.get("host")
    if engine.url.username != SUPERUSER or not isinstance(folder, str) or folder[:1] != "/":
        return None
    reader = make_engine(engine.url.set(username=READER))
    try:
        excess = _excess(reader)
        if excess != []:
            cluster = _cluster(engine, Path(folder))
            if cluster is None:
                reader.dispose()
                return None
            _prepare(cluster, engine)
            excess = _excess(reader, patience=RELOAD_SECONDS)
        if excess:
            raise DatabaseError(
                f"the login {READER} can do more than read: {', '.join(excess)}. Take it away "
                "(semmap db psql), or call with --write"
            )
    except BaseException:
        reader.dispose()
        raise
    return reader


def _excess(reader: Engine, patience: float = 0.0) -> list[str] | None:
    """What the login has beyond reading; None if it cannot log in, also not within `patience`."""
    deadline = time.monotonic() + patience
    while True:
        try:
            with reader.connect() as connection:
                return excess_rights(connection)
        except OperationalError as error:
            if not patience:
                return None
            if time.monotonic() > deadline:
                raise DatabaseError(f"the login {READER} does not work: {error.orig}") from error
        time.sleep(0.05)


def _cluster(engine: Engine, socket_folder: Path) -> Cluster | None:
    """The cluster of this user that an engine is connected with, if it is one."""
    with engine.connect() as connection:
        data = connection.exec_driver_sql(
            "SELECT setting FROM pg_settings WHERE name = 'data_directory'"
        ).scalar()
    if data is None:  # only a superuser is told
        return None
    cluster = Cluster(Path(data).parent)
    running = cluster.running()
    return cluster if running is not None and running.samefile(socket_folder) else None


def _prepare(cluster: Cluster, engine: Engine) -> None:
    """Make the login, take from everybody what it must not have, and let it in."""
    with engine.begin() as connection:
        limit_rights(connection)
    cluster.write_user_map()
    with engine.connect() as connection:
        connection.exec_driver_sql("SELECT pg_reload_conf()")
