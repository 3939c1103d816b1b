"""One state of one map: what the readers of grids, routes, plans and fields take."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import TYPE_CHECKING, Any

import psycopg

from semmap.database.maps import see_map
from semmap.database.shared_engine import shared_engine

if TYPE_CHECKING:
    from sqlalchemy import Connection

__all__ = ["Snapshot", "open_snapshot"]


@dataclass(frozen=True)
class Snapshot:
    """A transaction that sees one state of one map.

    Attributes
    ----------
    session : psycopg's connection
    name : of the map
    moment : when the transaction began
    """

    session: psycopg.Connection[Any]
    name: str
    moment: datetime

    @cached_property
    def connection(self) -> Connection:
        """The same transaction for statements of SQLAlchemy."""
        return shared_engine(self.session).connect()


@contextmanager
def open_snapshot(session: psycopg.Connection[Any], name: str) -> Iterator[Snapshot]:
    """See one state of a map; what is written in the block is committed at its end.

    In a transaction that `session` has begun, it is the state that this transaction sees.
    """
    begun = session.info.transaction_status != psycopg.pq.TransactionStatus.IDLE
    with session.transaction():
        if not begun:
            session.execute("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ")
        see_map(session, name)
        row = session.execute("SELECT now()").fetchone()
        assert row is not None
        seen = Snapshot(session, name, row[0])
        try:
            yield seen
        finally:
            if "connection" in vars(seen):
                seen.connection.close()
