"""Transactions that run beside each other, in every order of their steps.

As PostgreSQL's isolation tester does it: each session sends its steps in turn; a step that waits
for a lock of another session stays open while the others go on, and the session's own next steps
come when it is done.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import psycopg

Session = Sequence[str]
"""The statements of one transaction, without its BEGIN and COMMIT."""


def orders(lengths: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """All orders in which sessions with so many steps can take turns, as numbers of sessions.

    >>> list(orders([1, 2]))
    [(0, 1, 1), (1, 0, 1), (1, 1, 0)]
    """
    if not any(lengths):
        yield ()
    for session, left in enumerate(lengths):
        if left:
            rest = [n - (i == session) for i, n in enumerate(lengths)]
            for tail in orders(rest):
                yield (session, *tail)


def interleave(
    connections: Sequence[psycopg.Connection[Any]],
    watch: psycopg.Connection[Any],
    sessions: Sequence[Session],
    order: Sequence[int],
) -> list[psycopg.Error | None]:
    """Run sessions in an order of steps; the last step of each is its COMMIT.

    Parameters
    ----------
    connections : one for each session, without an open transaction
    watch : another connection, in autocommit mode: it sees who waits
    order : numbers of sessions, each as often as it has statements, and once more

    Returns
    -------
    The error that ended each session, None for one that was committed.
    """
    steps = [iter([*session, "COMMIT"]) for session in sessions]
    failed: list[psycopg.Error | None] = [None] * len(sessions)
    running: dict[int, Future[None]] = {}
    due = list(order)

    with ThreadPoolExecutor(len(sessions)) as pool:
        deadline = time.monotonic() + 30
        while due or running:
            assert time.monotonic() < deadline, f"{order}: {sorted(running)} wait for ever"
            for session in [n for n, future in running.items() if future.done()]:
                error = running.pop(session).exception()
                if isinstance(error, psycopg.Error):
                    failed[session] = error
                    connections[session].rollback()
                    due = [n for n in due if n != session]
                elif error is not None:
                    raise error
            if not all(_waits(watch, connections[n]) or f.done() for n, f in running.items()):
                time.sleep(0.001)
                continue
            session = next((n for n in due if n not in running), None)
            if session is None:
                time.sleep(0.001)
                continue
            due.remove(session)
            running[session] = pool.submit(_run, connections[session], next(steps[session]))
    return failed


def _run(connection: psycopg.Connection[Any], statement: str) -> None:
    if statement == "COMMIT":
        connection.commit()
    else:
        connection.execute(statement)


def _waits(watch: psycopg.Connection[Any], connection: psycopg.Connection[Any]) -> bool:
    found = watch.execute("SELECT pg_blocking_pids(%s)", [connection.info.backend_pid]).fetchone()
    return found is not None and bool(found[0])
