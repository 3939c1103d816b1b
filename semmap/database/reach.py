"""The first session with a database: its server is waited for while it starts or recovers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import psycopg
from psycopg.conninfo import make_conninfo

from semmap.database.error import DatabaseError
from semmap.database.parameters import (
    CONNECT_TIMEOUT,
    SETTINGS,
    connection_parameters,
    describe,
    lost_folder,
    unreachable,
)
from semmap.database.patience import Patience
from semmap.database.shared_engine import SharedConnection

if TYPE_CHECKING:
    from sqlalchemy import URL

    from semmap.database.embedded import Cluster


def reach(url: str | URL | Cluster | None, *, create: bool) -> SharedConnection:
    """A session with the database as `open_session` opens it, whatever its schema is."""
    patience = Patience()
    while True:
        parameters = connection_parameters(url, create=create)  # starts one that died meanwhile
        given = parameters.pop("options", "") or ""
        settings = " ".join(f"-c {name}={value}" for name, value in SETTINGS.items())
        conninfo = make_conninfo(
            **{"application_name": "semmap", "connect_timeout": CONNECT_TIMEOUT} | parameters,
            options=f"{given} {settings}".strip(),
        )
        try:
            return SharedConnection.connect(conninfo, autocommit=True)
        except psycopg.OperationalError as error:
            host = parameters.get("host")
            hopeless = isinstance(error, psycopg.errors.ConnectionTimeout) or lost_folder(host)
            if hopeless or not patience.allows_another(conninfo):
                message = unreachable(describe(parameters), host, error, patience.busy)
                raise DatabaseError(message) from error
