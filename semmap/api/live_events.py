"""What is followed while a program runs: events in a loop, or given to a function."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, Self, TypeVar

Item = TypeVar("Item")


class LiveEvents(Generic[Item]):
    """Events, in a loop over this; use it in a ``with`` statement, or close it.

    Parameters
    ----------
    count : how much is true already, which is no event
    events : ends when `close` was called
    close : called once
    seconds : close after this time; by default never
    callback : gets the events, in a thread of this; a loop then has nothing
    """

    def __init__(
        self,
        count: int,
        events: Iterable[Item],
        close: Callable[[], Any],
        *,
        seconds: float | None = None,
        callback: Callable[[Item], Any] | None = None,
    ) -> None:
        self.count = count
        self._events: Iterable[Item] = events if callback is None else ()
        self._close = close
        self._closed = threading.Event()
        self._timer = timer(seconds, self.close)
        if callback is not None:

            def call() -> None:
                for event in events:
                    callback(event)

            threading.Thread(target=call, daemon=True).start()

    def __iter__(self) -> Iterator[Item]:
        """Iterate over events as they come, until this is closed."""
        return iter(self._events)

    def close(self) -> None:
        """End it, and loops over it."""
        if not self._closed.is_set():
            self._closed.set()
            self._timer.cancel()
            self._close()

    def __enter__(self) -> Self:
        """Return this; the end of the ``with`` block closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close this."""
        self.close()


def timer(seconds: float | None, then: Callable[[], Any]) -> threading.Timer:
    """A timer that calls a function after some seconds, unless it is cancelled; never for None."""
    found = threading.Timer(seconds or 0, then)
    found.daemon = True
    if seconds is not None:
        found.start()
    return found
