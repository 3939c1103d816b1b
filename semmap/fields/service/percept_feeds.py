"""Where the percepts of sources come from: the socket, a recording, or a plug-in.

A feed is a callable that returns the newest percept, or None. It may have `wait(seconds)`, which
returns early when a percept arrives, and raises `EndOfPercepts` after its last one.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from semmap.fields.service.percept_json import Percept, read_percept, read_time
from semmap.fields.sources.manager import EndOfPercepts

__all__ = ["GROUP", "Inbox", "Recording", "make_feed"]

GROUP = "semmap.percepts"
"""The group of entry points for feeds in packages: a class or function that makes a feed."""


class Inbox:
    """The newest percept that was sent to a source."""

    def __init__(self) -> None:
        self._newest: Percept | None = None
        self._arrived = threading.Event()

    def put(self, percept: Percept) -> None:
        """Replace the newest percept."""
        self._newest = percept
        self._arrived.set()

    def __call__(self) -> Percept | None:
        """Return the newest percept."""
        self._arrived.clear()
        return self._newest

    def wait(self, seconds: float) -> bool:
        """Wait for the next percept; returns whether one arrived."""
        return self._arrived.wait(seconds)


class Recording:
    """Percepts of a folder, at the pace at which they were recorded.

    Parameters
    ----------
    folder : has a file `NAME.jsonl` for each source: a percept with its time in each line, in order
        of time; images lie beside it
    name : of the source
    begin : when the recording begins now, aware; it begins with the earliest percept of any source
    speed : how many times faster than recorded
    loop : begin again after the last percept

    Raises
    ------
    ValueError
        There is no such file, or a percept in it is wrong; with the line.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        *,
        begin: datetime | None = None,
        speed: float = 1.0,
        loop: bool = False,
    ) -> None:
        if not speed > 0:
            raise ValueError(f"speed is {speed!r}: give a number above 0")
        path = folder / f"{name}.jsonl"
        if not path.is_file():
            there = ", ".join(sorted(each.name for each in folder.glob("*.jsonl"))) or "none"
            raise ValueError(f"there is no recording {path}; files in that folder: {there}")
        self._folder = folder
        self._lines = _read_lines(path)
        first = min(_first_time(each) for each in folder.glob("*.jsonl"))
        self._after = [(time - first) / speed for time, _ in self._lines]
        self._begin = begin or datetime.now(UTC)
        self._loop = loop
        self._next = 0
        self._percept: Percept | None = None
        read_percept(self._lines[0][1], folder)  # wrong percepts are reported when it starts

    def __call__(self) -> Percept | None:
        """Return the newest percept whose time has come, with the time at which it came."""
        now = datetime.now(UTC)
        due = self._next
        while due < len(self._lines) and self._begin + self._after[due] <= now:
            due += 1
        if due > self._next:
            self._percept = read_percept(
                self._lines[due - 1][1], self._folder, self._begin + self._after[due - 1]
            )
            self._next = due
        elif due == len(self._lines):
            if not self._loop:
                raise EndOfPercepts
            self._begin, self._next = now, 0
        return self._percept


def make_feed(
    given: str | Mapping[str, Any], name: str, begin: datetime | None = None
) -> Callable[[], Any]:
    """Return the feed of a source.

    Parameters
    ----------
    given : `socket`, `recording:FOLDER`, `plugin:NAME`, or a mapping with `recording` or `plugin`
        and the options of that feed
    name : of the source
    begin : when recordings begin, aware

    Raises
    ------
    ValueError, LookupError
        There is no such feed.
    """
    options = dict(given) if isinstance(given, Mapping) else {}
    if isinstance(given, str):
        kind, _, rest = given.partition(":")
        options = {kind: rest}
    if "socket" in options:
        return Inbox()
    if options.get("recording"):
        folder = Path(options.pop("recording"))
        return Recording(folder, str(options.pop("name", name)), begin=begin, **options)
    if options.get("plugin"):
        wanted = str(options.pop("plugin"))
        for point in entry_points(group=GROUP, name=wanted):
            made: Callable[[], Any] = point.load()(**options)
            return made
        known = ", ".join(sorted(entry_points(group=GROUP).names)) or "none"
        raise LookupError(f"there is no percept plug-in {wanted}; installed: {known}")
    raise ValueError(
        f"{name}: percepts are {given!r}: give socket, recording:FOLDER or plugin:NAME"
    )


def _read_lines(path: Path) -> list[tuple[datetime, Any]]:
    lines = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if line.strip():
            try:
                percept = json.loads(line)
                if "time" not in percept:
                    raise ValueError("the percept has no time")
                lines.append((read_time(percept), percept))
            except (ValueError, TypeError) as error:
                raise ValueError(f"{path}, line {number}: {error}") from None
            if len(lines) > 1 and lines[-1][0] < lines[-2][0]:
                raise ValueError(f"{path}, line {number}: earlier than the line before: sort them")
    if not lines:
        raise ValueError(f"{path} has no percepts: write one to each line")
    return lines


def _first_time(path: Path) -> datetime:
    return _read_lines(path)[0][0]
