"""Runs sources: each in its own thread and at its own rate (reMap, section 5.1)."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import monotonic
from typing import Any

from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.sources.source import Source, check_percept

PATIENCE = 0.2
"""Seconds between checks of whether to stop, while a source waits for a percept."""

_log = logging.getLogger(__name__)


class EndOfPercepts(Exception):
    """There will be no more percepts: raised by a function that returns them."""


@dataclass(frozen=True)
class SourceStatus:
    """The state of a running source: required `rate` and number of `updates`.

    `seconds` is the duration of the last update, `error` its error, or why the source has no maps.
    """

    rate: float
    updates: int
    seconds: float
    error: str | None


class SourceManager:
    """Runs sources, and writes their maps to a buffer, until they stop or a `with` block ends."""

    def __init__(self, maps: MapBuffer) -> None:
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
        timeout: float | None = None,
    ) -> None:
        """Start a source; raise ValueError if one of that name is running, or for a wrong rate.

        If `percepts` has a method `wait(seconds)` that returns when a percept arrives, the source
        runs at once then, at most `rate` times per second.

        Parameters
        ----------
        percepts : returns the newest percept, with its `time`, or None
        rate : calls of `percepts` per second, above 0; the same percept makes no new maps
        timeout : seconds without a percept until what the source provides is unknown; None for ever
        """
        if not rate > 0:
            raise ValueError(f"rate is {rate!r}: give updates per second, above 0")
        with self._lock:
            if name in self._workers:
                raise ValueError(f"the source {name} is running: deactivate it first")
            worker = _Worker(name, source, percepts, self.maps, rate, timeout)
            self._workers[name] = worker
        worker.start()

    def deactivate(self, name: str) -> None:
        """Stop a source, wait for its thread, and remove its maps; LookupError if none runs."""
        with self._lock:
            worker = self._workers.pop(name, None)
            active = ", ".join(sorted(self._workers)) or "none"
        if worker is None:
            raise LookupError(f"the source {name} is not running; running: {active}")
        worker.stop()

    def status(self) -> dict[str, SourceStatus]:
        """Return the state of each running source."""
        with self._lock:
            return {name: worker.status for name, worker in self._workers.items()}

    def close(self) -> None:
        """Stop all sources."""
        for name in self.status():
            self.deactivate(name)

    def __enter__(self) -> SourceManager:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Worker:
    """One source in its thread."""

    def __init__(
        self,
        name: str,
        source: Source,
        percepts: Callable[[], Any],
        maps: MapBuffer,
        rate: float,
        timeout: float | None,
    ) -> None:
        self._timeout = timeout
        self._latest = monotonic()  # when the last percept came
        self._has_maps = False
        self._name = name
        self._source = source
        self._percepts = percepts
        self._maps = maps
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"source {name}", daemon=True)
        self._last: Any = None
        self.status = SourceStatus(rate, 0, 0.0, None)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()
        self._maps.withdraw(self._name)

    def _work(self) -> None:
        due = monotonic()
        wait = getattr(self._percepts, "wait", None)
        while not self._stop.is_set():
            try:
                self._update()
            except EndOfPercepts:
                self._withdraw("the percepts ended")
                return
            due = max(due + 1 / self.status.rate, monotonic())  # skip the updates that were missed
            self._stop.wait(due - monotonic())
            if wait is not None:
                while not self._stop.is_set() and not wait(PATIENCE):
                    self._check_timeout()
            else:
                self._check_timeout()

    def _check_timeout(self) -> None:
        if self._timeout is not None and monotonic() > self._latest + self._timeout:
            self._withdraw(f"no percept for {self._timeout:g} s")

    def _withdraw(self, reason: str) -> None:
        if self._has_maps:
            self._has_maps = False
            self._maps.withdraw(self._name)
            self.status = replace(self.status, error=reason)

    def _update(self) -> None:
        begin = monotonic()
        count, error = self.status.updates, None
        try:
            percept = self._percepts()
            if percept is None or percept is self._last:
                return
            self._last, self._latest = percept, monotonic()
            check_percept(self._name, self._source, percept)
            self._maps.put(
                self._name,
                self._source(percept),
                percept.time,
                provides=getattr(self._source, "provides", ()),
            )
            count += 1
            self._has_maps = True
        except EndOfPercepts:
            raise
        except Exception as caught:  # a source continues after an error; its last maps stay
            error = f"{type(caught).__name__}: {caught}"
            if error != self.status.error:
                _log.exception("source %s failed", self._name)
        self.status = SourceStatus(self.status.rate, count, monotonic() - begin, error)
