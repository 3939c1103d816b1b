"""Sources at work: each in its own thread and at its own rate, switched on and off at run time.

Source: reMap, section 5.1, whose manager activates plugins by the situation.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from time import monotonic
from typing import Any

from semmap.fields.maps.map_buffer import Maps
from semmap.fields.sources.source import Source

__all__ = ["Manager", "Status"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Status:
    """How a source does.

    Attributes
    ----------
    rate : updates a second that were asked for
    updates : how many it has made
    seconds : how long the last one took
    error : what went wrong in the last one, if something did
    """

    rate: float
    updates: int
    seconds: float
    error: str | None


class Manager:
    """Keeps `maps` filled by the active sources.

    Readers take `maps` at any time; what a source put in is taken out again when it stops. Leaving
    ``with Manager(maps) as manager`` stops all.
    """

    def __init__(self, maps: Maps) -> None:
        self.maps = maps
        self._workers: dict[str, _Worker] = {}
        self._lock = threading.Lock()

    def activate(
        self,
        name: str,
        source: Source,
        percepts: Callable[[], Any],
        *,
        rate: float = 10.0,
        span: timedelta | None = None,
    ) -> None:
        """Start a source.

        Parameters
        ----------
        percepts : gives the newest percept, with its `time`, or None if there is none; the same
            one again makes no new maps
        rate : looks a second
        span : how long its maps are remembered

        Raises
        ------
        ValueError
            A source of that name is active, or the rate is not above 0.
        """
        if not rate > 0:
            raise ValueError(f"rate is {rate!r}: give looks a second above 0")
        with self._lock:
            if name in self._workers:
                raise ValueError(f"a source {name} is active: deactivate it first")
            worker = _Worker(name, source, percepts, self.maps, rate, span)
            self._workers[name] = worker
        worker.start()

    def deactivate(self, name: str) -> None:
        """Stop a source, wait for its end, and take its maps out.

        Raises
        ------
        LookupError
            No such source is active.
        """
        with self._lock:
            worker = self._workers.pop(name, None)
            active = ", ".join(sorted(self._workers)) or "none"
        if worker is None:
            raise LookupError(f"no source {name} is active; active: {active}")
        worker.stop()

    def status(self) -> dict[str, Status]:
        """The active sources."""
        with self._lock:
            return {name: worker.status for name, worker in self._workers.items()}

    def close(self) -> None:
        """Stop all sources."""
        for name in self.status():
            self.deactivate(name)

    def __enter__(self) -> Manager:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Worker:
    def __init__(
        self,
        name: str,
        source: Source,
        percepts: Callable[[], Any],
        maps: Maps,
        rate: float,
        span: timedelta | None,
    ) -> None:
        self._name = name
        self._source = source
        self._percepts = percepts
        self._maps = maps
        self._span = span
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"source {name}", daemon=True)
        self._last: Any = None
        self.status = Status(rate, 0, 0.0, None)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()
        self._maps.withdraw(self._name)

    def _work(self) -> None:
        due = monotonic()
        while not self._stop.is_set():
            self._look()
            due = max(due + 1 / self.status.rate, monotonic())  # what was missed is not made up for
            self._stop.wait(due - monotonic())

    def _look(self) -> None:
        begin = monotonic()
        count, error = self.status.updates, None
        try:
            percept = self._percepts()
            if percept is None or percept is self._last:
                return
            self._last = percept
            self._maps.put(self._name, self._source(percept), percept.time, span=self._span)
            count += 1
        except Exception as caught:  # a source that fails must not end; its last maps stay
            error = f"{type(caught).__name__}: {caught}"
            if error != self.status.error:
                _log.exception("source %s failed", self._name)
        self.status = Status(self.status.rate, count, monotonic() - begin, error)
