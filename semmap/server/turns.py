"""Turns of requests: how many are answered at once, how many wait, and for how long."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import TypeVar

from starlette.concurrency import run_in_threadpool

from semmap.error import Error
from semmap.server.handles import MOST_HANDLES

Answer = TypeVar("Answer")

QUICK_AT_ONCE = 4
"""The most requests in progress that are not slow."""

SLOW_AT_ONCE = 2
"""The most slow requests that begin while others are in progress."""

SLOW_SECONDS = 0.5
"""A request that takes longer is slow, now and when it is sent again."""

MOST_WAITING = 256
"""The most requests that wait."""

MOST_OF_CLIENT = 32
"""The most requests of one client that wait."""

PATIENCE = 10.0
"""Seconds that a request waits."""

MOST_REMEMBERED = 1000
"""The most slow requests that are remembered."""


class BusyError(Error):
    """Too many requests wait, or one waited for too long."""


@dataclass(eq=False)
class _Turn:
    client: str
    request: Hashable
    slow: bool = False
    begins: asyncio.Event = field(default_factory=asyncio.Event)


class Turns:
    """The turns of an event loop; clients take turns, and slow requests do not stop quick ones."""

    def __init__(self) -> None:
        self._waiting: list[_Turn] = []
        self._running: set[_Turn] = set()
        self._slow: dict[Hashable, None] = {}  # the oldest first

    async def run(self, client: str, request: Hashable, answer: Callable[[], Answer]) -> Answer:
        """Return an answer, made in a thread; BusyError if its turn does not come in time.

        Equal `request` take equally long.
        """
        turn = _Turn(client, request)
        try:
            await self._wait(turn)
            timer = asyncio.get_running_loop().call_later(SLOW_SECONDS, self._mark_slow, turn)
            self._slow.pop(request, None)
            try:
                return await run_in_threadpool(answer)
            finally:
                timer.cancel()
        finally:
            self._running.discard(turn)
            self._admit()

    async def _wait(self, turn: _Turn) -> None:
        of_client = sum(each.client == turn.client for each in self._waiting)
        if len(self._waiting) >= MOST_WAITING or of_client >= MOST_OF_CLIENT:
            raise BusyError("too many requests wait: try again")
        self._waiting.append(turn)
        self._admit()
        try:
            async with asyncio.timeout(PATIENCE):
                await turn.begins.wait()
        except TimeoutError:
            raise BusyError(f"the request waited for {PATIENCE:g} s: try again") from None
        finally:
            if turn in self._waiting:
                self._waiting.remove(turn)

    def _admit(self) -> None:
        """Begin those that wait, first of clients with the fewest in progress."""
        if not self._waiting:
            return
        of_client = Counter(turn.client for turn in self._running)
        slow = sum(turn.slow for turn in self._running)
        quick = len(self._running) - slow
        for turn in sorted(self._waiting, key=lambda each: of_client[each.client]):
            if len(self._running) >= MOST_HANDLES:
                return
            turn.slow = turn.request in self._slow
            if (slow if turn.slow else quick) >= (SLOW_AT_ONCE if turn.slow else QUICK_AT_ONCE):
                continue
            slow, quick = slow + turn.slow, quick + (not turn.slow)
            self._waiting.remove(turn)
            self._running.add(turn)
            turn.begins.set()

    def _mark_slow(self, turn: _Turn) -> None:
        turn.slow = True
        self._slow[turn.request] = None
        if len(self._slow) > MOST_REMEMBERED:
            del self._slow[next(iter(self._slow))]
        self._admit()
