"""Requests take turns: slow ones do not stop quick ones, and none waits without an end."""

from __future__ import annotations

import asyncio
import threading
import time

import pytest

from semmap.server import turns
from semmap.server.turns import BusyError, Turns


def test_slow_requests_do_not_stop_quick_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "SLOW_SECONDS", 0.05)
    release, running = threading.Event(), 0

    def slow() -> None:
        nonlocal running
        running += 1
        release.wait(20)
        running -= 1

    async def scene() -> None:
        nonlocal running
        queue = Turns()
        for most in (10, turns.SLOW_AT_ONCE):  # at first, nobody knows that they are slow
            release.clear()
            heavy = [
                asyncio.create_task(queue.run(f"client{n}", f"heavy{n}", slow)) for n in range(10)
            ]
            await asyncio.sleep(0.5)
            assert running == most
            begin = time.monotonic()
            assert await queue.run("light", "ask", lambda: 7) == 7
            assert time.monotonic() - begin < 1
            release.set()
            await asyncio.gather(*heavy)

    asyncio.run(scene())


def test_a_client_waits_behind_its_own_requests() -> None:
    release, order = threading.Event(), []

    async def scene() -> None:
        queue = Turns()
        many = turns.QUICK_AT_ONCE + turns.MOST_OF_CLIENT
        greedy = [
            asyncio.create_task(queue.run("greedy", n, lambda: release.wait(20)))
            for n in range(many)
        ]
        await asyncio.sleep(0)
        modest = asyncio.create_task(queue.run("modest", 0, lambda: order.append("modest")))
        with pytest.raises(BusyError, match="try again"):
            await queue.run("greedy", many, lambda: None)
        greedy[-1].add_done_callback(lambda _: order.append("greedy"))
        release.set()
        await asyncio.gather(*greedy, modest)

    asyncio.run(scene())
    assert order == ["modest", "greedy"]


def test_a_request_waits_for_a_stated_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "PATIENCE", 0.1)
    release = threading.Event()

    async def scene() -> None:
        queue = Turns()
        first = [
            asyncio.create_task(queue.run("a", n, lambda: release.wait(20)))
            for n in range(turns.QUICK_AT_ONCE)
        ]
        await asyncio.sleep(0)
        with pytest.raises(BusyError, match=r"0\.1 s"):
            await queue.run("b", 0, lambda: None)
        release.set()
        await asyncio.gather(*first)
        assert await queue.run("b", 0, lambda: "now") == "now"

    asyncio.run(scene())
