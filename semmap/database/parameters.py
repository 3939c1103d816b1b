"""Which database is meant, how a session with it is opened, and why it cannot be reached."""

from __future__ import annotations

import os
from pathlib import Path
from shutil import disk_usage
from typing import TYPE_CHECKING, Any

import psycopg
from psycopg.conninfo import conninfo_to_dict

from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.patience import BUSY_SECONDS

if TYPE_CHECKING:
    from sqlalchemy import URL

SETTINGS = {"search_path": "semmap,public", "timezone": "UTC"}
"""What every session is opened with."""

CONNECT_TIMEOUT = "10"
"""Seconds after which a server that does not answer is given up."""

SEVERAL = {"target_session_attrs": "read-write", "connect_timeout": "3"}
"""Of several servers, the one that takes writes is meant; one that does not answer, passed over."""

FORM = "It has the form postgresql://user:password@host:5432/database"


def meant(url: str | URL | Cluster | None) -> tuple[str | URL | Cluster, str]:
    """`url`, else ``$SEMMAP_DB``, else the user's cluster; and what messages call it."""
    if url is not None:
        return url, "the database URL"
    stated = os.environ.get("SEMMAP_DB")
    return (stated, "SEMMAP_DB") if stated else (Cluster(), "the embedded database")


def connection_parameters(
    url: str | URL | Cluster | None = None, *, create: bool = False
) -> dict[str, Any]:
    """libpq's parameters of the database that is meant: `url`, else ``$SEMMAP_DB``, else embedded.

    The URL is ``postgresql://user:password@host:port/name``, as psql takes it. `create` makes the
    embedded cluster if there is none yet; one that is there is started anyway. DatabaseError where
    the URL is none of PostgreSQL, or there is no embedded cluster.
    """
    chosen, source = meant(url)
    if isinstance(chosen, Cluster):
        if not (create or chosen.exists):
            raise DatabaseError(
                f"there is no map yet: the embedded database, {chosen.home}, has not been made. "
                "semmap import FILE makes it; or name a database: SEMMAP_DB, --db"
            )
        return dict(chosen.parameters(chosen.start()))
    text = chosen if isinstance(chosen, str) else chosen.render_as_string(hide_password=False)
    scheme, colon, rest = text.partition("://")
    if colon and scheme not in ("postgresql", "postgres", "postgresql+psycopg"):
        raise DatabaseError(
            f"{source} names {scheme}, but the map needs PostgreSQL with PostGIS: "
            "postgresql://user:password@host:5432/database"
        )
    if not colon:
        raise DatabaseError(f"{source} cannot be read: {text}. {FORM}")
    try:
        stated = dict(conninfo_to_dict(f"postgresql://{rest}"))
        return SEVERAL | stated if "," in str(stated.get("host", "")) else stated
    except psycopg.ProgrammingError as error:
        cause = str(error).strip().splitlines()[0]
        raise DatabaseError(f"{source} cannot be read: {cause}. {FORM}") from error


def describe(parameters: dict[str, Any]) -> str:
    """The database that parameters name, without the password."""
    named = (k for k in ("host", "port", "user", "dbname") if parameters.get(k))
    return " ".join(f"{k}={parameters[k]}" for k in named) or "the default server"


def unreachable(where: str, host: object, error: object, busy: bool = False) -> str:
    """Why there is no connection to `where`, and what to do; `host` may be a socket's folder."""
    cause = str(error).strip().splitlines()
    if folder := lost_folder(host):
        hint = f"There is no socket directory {folder}."
    elif is_full(host):
        hint = f"The disk of {host} is full: make room on it."
    elif busy:
        hint = (
            f"The server is still starting, recovering or stopping after {BUSY_SECONDS:g} s: "
            "call again later."
        )
    else:
        hint = "Is the server running, and are user, password and database name right?"
    return f"no connection to {where}: {cause[-1] if cause else error}. {hint}"


def is_full(host: object) -> bool:
    """Whether the disk of a Unix socket's folder has less than a megabyte left."""
    return isinstance(host, str) and host.startswith("/") and disk_usage(host).free < 1 << 20


def lost_folder(host: object) -> str | None:
    """The folder of a Unix socket, if it does not exist; None for other hosts."""
    if isinstance(host, str) and host.startswith("/") and not Path(host).exists():
        return host
    return None
