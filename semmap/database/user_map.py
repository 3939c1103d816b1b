"""Who logs in on the embedded database: all of its logins, each by its owner alone."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import psycopg
from psycopg.conninfo import conninfo_to_dict

from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.shared_engine import SharedConnection

RELOAD_SECONDS = 10.0
"""How long the server may take to read its user map again."""


def cluster_of(session: psycopg.Connection[Any]) -> Cluster | None:
    """The cluster of this user that a session is connected with, if it is one."""
    row = session.execute(
        "SELECT setting FROM pg_settings WHERE name = 'data_directory'"
    ).fetchone()
    if row is None:  # only a superuser is told
        return None
    cluster = Cluster(Path(row[0]).parent)
    running = cluster.running()
    return cluster if running is not None and running.samefile(session.info.host) else None


def admit_logins(cluster: Cluster, session: psycopg.Connection[Any]) -> None:
    """Let the owner of a cluster log in as each role that has the right to."""
    logins = session.execute("SELECT rolname FROM pg_roles WHERE rolcanlogin ORDER BY 1")
    cluster.write_user_map([row[0] for row in logins])
    session.execute("SELECT pg_reload_conf()")


def log_in(conninfo: str, patience: float = 0.0) -> psycopg.Connection[Any] | None:
    """Log in; None if that is not possible. With `patience`, seconds, a DatabaseError instead."""
    deadline = time.monotonic() + patience
    while True:
        try:
            return SharedConnection.connect(conninfo, autocommit=True)
        except psycopg.OperationalError as error:
            if not patience:
                return None
            if time.monotonic() > deadline:
                user = conninfo_to_dict(conninfo)["user"]
                raise DatabaseError(f"the login {user} does not work: {error}") from error
        time.sleep(0.05)
