"""One state of one map: what the readers of grids, routes, plans and fields take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import TYPE_CHECKING, Any

import psycopg

from semmap.database.maps import driver_of, see_map
from semmap.database.shared_engine import shared_engine

if TYPE_CHECKING:
    from sqlalchemy import Connection


@dataclass(frozen=True)
class Snapshot:
    """A connection that sees the map of a name: while a transaction lasts, one state of it."""

    session: psycopg.Connection[Any]
    name: str

    @classmethod
    def of(cls, connection: Connection, name: str) -> Snapshot:
        """What a transaction of SQLAlchemy sees that has begun, and whose owner ends it."""
        seen = cls(driver_of(connection), name)
        vars(seen)["connection"] = connection
        return seen

    @cached_property
    def moment(self) -> datetime:
        """When the transaction began."""
        row = self.session.execute("SELECT now()").fetchone()
        assert row is not None
        moment: datetime = row[0]
        return moment

    @cached_property
    def connection(self) -> Connection:
        """The same transaction for statements of SQLAlchemy."""
        return shared_engine(self.session).connect()


@contextmanager
def open_snapshot(session: psycopg.Connection[Any], name: str) -> Iterator[Snapshot]:
    """See one state of a map; unless a transaction has begun, what is written is committed here."""
    begun = session.info.transaction_status != psycopg.pq.TransactionStatus.IDLE
    with session.transaction():
        if not begun:
            session.execute("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ")
        see_map(session, name)
        seen = Snapshot(session, name)
        try:
            yield seen
        finally:
            if "connection" in vars(seen):
                seen.connection.close()
