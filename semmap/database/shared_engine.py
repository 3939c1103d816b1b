"""SQLAlchemy on a connection of psycopg that is open already, in its transaction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import psycopg
from psycopg.pq import TransactionStatus

from semmap.database.sure_connection import SureConnection

if TYPE_CHECKING:
    from sqlalchemy import Engine

_ENGINES: WeakKeyDictionary[psycopg.Connection[Any], Engine] = WeakKeyDictionary()


class SharedConnection(SureConnection):
    """A connection in autocommit mode, whose explicit transactions SQLAlchemy does not end."""

    def commit(self) -> None:
        """Commit, unless a ``with connection.transaction()`` block does it at its end."""
        if self.info.transaction_status == TransactionStatus.IDLE or not self._num_transactions:
            super().commit()

    def rollback(self) -> None:
        """Roll back, unless a ``with connection.transaction()`` block decides at its end."""
        if self.info.transaction_status == TransactionStatus.IDLE or not self._num_transactions:
            super().rollback()


def shared_engine(connection: psycopg.Connection[Any]) -> Engine:
    """Return the engine whose only connection is this one; it neither ends nor closes it."""
    from sqlalchemy import create_engine
    from sqlalchemy.pool import StaticPool

    engine = _ENGINES.get(connection)
    if engine is None:
        engine = create_engine(
            "postgresql+psycopg://",
            creator=lambda: connection,
            poolclass=StaticPool,
            pool_reset_on_return=None,
        )
        _ENGINES[connection] = engine
    return engine
