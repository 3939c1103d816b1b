"""Connections whose transactions have a known outcome, through lost servers and standbys."""

from __future__ import annotations

import inspect
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any, Self
from uuid import UUID, uuid4
from weakref import ref

import psycopg
from psycopg.conninfo import make_conninfo
from psycopg.errors import Diagnostic
from psycopg.pq import TransactionStatus

from semmap.database.patience import BUSY_SECONDS, PAUSE, Patience, has_several_hosts

COMMIT_SECONDS = 5.0
"""How long a commit is waited for where another server can take over, and an answer about it."""

WAITS_FOR_STANDBYS = "SyncRepWaitForLSN"
"""The function of PostgreSQL that waits until standbys have a commit; its texts have languages."""

_OF_PSYCOPG = {
    *inspect.signature(psycopg.Connection.connect).parameters,
} - {"conninfo", "kwargs"}
"""Arguments of `connect` that are not libpq's."""

_WRITES = """
SELECT pg_current_xact_id_if_assigned() IS NOT NULL,
       has_function_privilege(to_regprocedure('semmap.note_write(uuid)'), 'EXECUTE')
"""


class _Happened(threading.local):
    """What happened to the connections of a thread."""

    commits = 0
    """How many transactions were, or may have been, committed that write."""

    open = 0
    """How many transactions are open now."""

    losses = 0
    """How many connections were lost."""

    def act(self) -> None:
        """Note what no transaction undoes, such as what a robot does: it is not done again."""
        self.commits += 1


HAPPENED = _Happened()


class NotWrittenError(psycopg.OperationalError):
    """The connection was lost, and nothing of the transaction was written, nor will be."""


class UnsettledError(psycopg.OperationalError):
    """Whether a transaction was written is not known: no server could be asked in time."""


class _InDoubtError(psycopg.OperationalError):
    """A server may have committed, but a standby that takes over may lack it."""


class SureConnection(psycopg.Connection[Any]):
    """A connection on which a transaction is written at its end, or an error says that it is not.

    A transaction that writes stores a key. Where the connection is lost during the commit, the
    servers of the URL are asked for a minute whether the key is there; then it stays closed, also
    if all was written. PostgreSQL calls a commit done where the wait for standbys was cancelled,
    and adds a warning: that counts as a lost connection. With several servers, a commit that takes
    more than `COMMIT_SECONDS` is left alone, not cancelled.

    The outcome of a single statement in autocommit mode is as with psycopg's own connections.

    Raises
    ------
    NotWrittenError
        By commits and transactions: nothing was written.
    UnsettledError
        No server that takes writes could be asked.
    """

    conninfo: str
    """With what another connection like this one is opened: all servers, and the password."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.conninfo = ""
        self._seconds: float | None = None
        self._is_sure = False
        self._doubt: str | None = None
        me = ref(self)

        def note(notice: Diagnostic) -> None:
            if notice.source_function == WAITS_FOR_STANDBYS and (found := me()) is not None:
                found._doubt = notice.message_primary

        self.add_notice_handler(note)

    @classmethod
    def connect(cls, conninfo: str = "", **kwargs: Any) -> Self:
        """As psycopg's."""
        made = super().connect(conninfo, **kwargs)
        stated = {name: value for name, value in kwargs.items() if name not in _OF_PSYCOPG}
        made.conninfo = make_conninfo(conninfo, **stated)
        return made

    def twin(self) -> Self:
        """Open another connection like this one, in autocommit mode; this one is open, too."""
        if self.closed:
            raise psycopg.OperationalError("the connection is closed")
        return self.reopen(self.conninfo)

    @classmethod
    def reopen(cls, conninfo: str) -> Self:
        """Open a connection in autocommit mode; one that starts or takes over is waited for."""
        patience = Patience()
        while True:
            try:
                return cls.connect(conninfo, autocommit=True)
            except psycopg.OperationalError:
                if not patience.allows_another(conninfo):
                    raise

    def commit(self) -> None:
        """Commit: as the class says."""
        key = self._note()
        try:
            super().commit()
        except psycopg.OperationalError as error:
            self._settle(key, error)
        finally:
            self._seconds = None
        HAPPENED.commits += key is not None

    def rollback(self) -> None:
        """As psycopg's; a connection that is lost has nothing to undo."""
        if not self.closed:
            super().rollback()

    @contextmanager
    def transaction(
        self, savepoint_name: str | None = None, force_rollback: bool = False
    ) -> Iterator[psycopg.Transaction]:
        """As psycopg's; one that is not a part of another ends as the class says.

        Also where a statement in the ``with`` block lost the connection, and what is in the block
        passed over that.
        """
        whole = self.info.transaction_status == TransactionStatus.IDLE
        key: UUID | str | None = None
        HAPPENED.open += whole
        self._is_sure = self._is_sure or whole
        try:
            with super().transaction(savepoint_name, force_rollback) as made:
                yield made
                if self.closed:
                    raise psycopg.OperationalError("the connection was lost before")
                key = self._note() if whole and not force_rollback else None
        except UnsettledError:
            raise
        except psycopg.OperationalError as error:
            if not whole or not self.closed:
                raise
            self._settle(key, error)
        finally:
            HAPPENED.open -= whole
            self._is_sure = self._is_sure and not whole
            self._seconds = None if whole else self._seconds
        HAPPENED.commits += key is not None

    def wait(self, *args: Any, **kwargs: Any) -> Any:
        """As psycopg's, for each statement and commit."""
        if self._seconds is not None:
            kwargs.setdefault("timeout", self._seconds)
        self._doubt = None
        before = self.pgconn.transaction_status
        try:
            found = super().wait(*args, **kwargs)
        except psycopg.OperationalError as error:
            late = not self.closed and self.info.transaction_status == TransactionStatus.ACTIVE
            if not (late or self.closed):
                raise
            self._lose(before)
            if late:
                raise _InDoubtError(f"no answer after {self._seconds or 0:g} s") from error
            raise
        if self._doubt is not None:
            self._lose(before)
            raise _InDoubtError(self._doubt)
        return found

    def _lose(self, before: int) -> None:
        """Close; what was begun by the user's own BEGIN, or SQLAlchemy, is not done again."""
        self.close()
        HAPPENED.losses += 1
        HAPPENED.commits += before != TransactionStatus.IDLE and not self._is_sure

    def _note(self) -> UUID | str | None:
        """Store the key of the open transaction; None where it wrote nothing; else why not."""
        if self.info.transaction_status in (TransactionStatus.IDLE, TransactionStatus.INERROR):
            return None
        if self.info.transaction_status != TransactionStatus.INTRANS:
            return "it was sent with others"
        row = self.execute(_WRITES).fetchone()
        if row is None or not row[0]:
            return None
        if not row[1]:
            return "this login may not store its key, or the schema has none"
        key = uuid4()
        self.execute("SELECT semmap.note_write(%s)", (key,))
        self._seconds = COMMIT_SECONDS if has_several_hosts(self.conninfo) else None
        return key

    def _settle(self, key: UUID | str | None, error: psycopg.OperationalError) -> None:
        """Raise, unless the transaction of a key was committed; without one, nothing was."""
        if not self.closed:
            raise error
        if isinstance(key, str):
            HAPPENED.commits += 1  # perhaps: so nobody does it again
            raise UnsettledError(
                f"the connection was lost during a commit; whether it was done is not known: {key}"
            ) from error
        if key is None or not self._was_written(self.conninfo, key):
            cause = (str(error).strip().splitlines() or [""])[0]
            raise NotWrittenError(f"nothing was written: {cause}") from error

    @classmethod
    def _was_written(cls, conninfo: str, key: UUID) -> bool:
        until = time.monotonic() + BUSY_SECONDS
        chance = {"load_balance_hosts": "random"} if has_several_hosts(conninfo) else {}
        while True:
            try:
                with closing(cls.connect(conninfo, autocommit=True, **chance)) as session:
                    return session._answer(key)
            except psycopg.Error as unanswered:
                if time.monotonic() > until:
                    HAPPENED.commits += 1  # perhaps: so nobody does it again
                    raise UnsettledError(
                        f"the connection was lost while transaction {key} was committed, and no "
                        "server could be asked whether it was. Ask one within an hour: "
                        f"SELECT semmap.was_written('{key}')"
                    ) from unanswered
                time.sleep(PAUSE)

    def _answer(self, key: UUID) -> bool:
        """A server that is cut off from its standbys does not answer: its commit waits for them."""
        self._seconds = COMMIT_SECONDS
        row = self.execute("SELECT semmap.was_written(%s)", (key,)).fetchone()
        assert row is not None
        return bool(row[0])
