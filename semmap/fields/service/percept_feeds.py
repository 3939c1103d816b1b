"""Where the percepts of sources come from: the socket, a recording, or a plug-in.

A feed is a callable that returns the newest percept, or None. It may have `wait(seconds)`, which
returns early when a percept arrives, and raises `EndOfPercepts` after its last one.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, datetime, timedelta
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from semmap.fields.service.percept_json import Percept, read_percept, read_time
from semmap.fields.sources.manager import EndOfPercepts
from semmap.limits import TEXT_BYTES

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
        """Wait for the next percept; return whether one arrived."""
        return self._arrived.wait(seconds)


class Replay:
    """Recorded percepts, at `speed` times the pace at which they were recorded.

    They are, in order, the seconds after the beginning, and what makes a percept of the time at
    which it comes. `begin` is aware, now if not given.
    """

    def __init__(
        self,
        recorded: Iterable[tuple[float, Callable[[datetime], Percept]]],
        *,
        begin: datetime | None = None,
        speed: float = 1.0,
        loop: bool = False,
    ) -> None:
        if not speed > 0:
            raise ValueError(f"speed is {speed!r}: give a number above 0")
        self._recorded, self._speed, self._loop = recorded, speed, loop
        self._percept: Percept | None = None
        self._next: tuple[float, Callable[[datetime], Percept]] | None
        self._start(begin or datetime.now(UTC))

    def __call__(self) -> Percept | None:
        """Return the newest percept whose time has come, with the time at which it came."""
        now = datetime.now(UTC)
        due = None
        while self._next is not None and self._time <= now:
            due = self._next, self._time
            self._next = next(self._rest, None)
        if due is not None:
            (_, make), time = due
            self._percept = make(time)
        elif self._next is None:
            if not self._loop:
                raise EndOfPercepts
            self._start(now)
        return self._percept

    def _start(self, begin: datetime) -> None:
        self._begin = begin
        self._rest: Iterator[tuple[float, Callable[[datetime], Percept]]] = iter(self._recorded)
        self._next = next(self._rest, None)

    @property
    def _time(self) -> datetime:
        assert self._next is not None
        return self._begin + timedelta(seconds=self._next[0] / self._speed)


class Recording(Replay):
    """Percepts of `NAME.jsonl` in a folder: one with its time in each line, in order of time.

    It begins with the earliest percept of any source. Images lie beside it. Raises ValueError:
    there is no such file, or a percept in it is wrong; with the line.
    """

    def __init__(self, folder: Path, name: str, **pace: Any) -> None:
        path = folder / f"{name}.jsonl"
        if not path.is_file():
            there = ", ".join(sorted(each.name for each in folder.glob("*.jsonl"))) or "none"
            raise ValueError(f"there is no recording {path}; files in that folder: {there}")
        lines = _read_lines(path)
        first = min(_read_lines(each)[0][0] for each in folder.glob("*.jsonl"))
        read_percept(lines[0][1], folder)  # wrong percepts are reported when it starts
        recorded = [
            ((time - first).total_seconds(), partial(read_percept, percept, folder))
            for time, percept in lines
        ]
        super().__init__(recorded, **pace)


def make_feed(
    given: str | Mapping[str, Any],
    name: str,
    begin: datetime | None = None,
    *,
    source: str | None = None,
) -> Callable[[], Any]:
    """Return the feed of a source; raise ValueError or LookupError if there is none.

    `given` is `socket`, `recording:FOLDER`, `mcap:FILE`, `plugin:NAME`, or a mapping of one of the
    last three with the options of the feed. Recordings begin at `begin`, aware. `source` is the
    installed source, by default `name`.
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
    if options.get("mcap"):
        from semmap.fields.service.mcap_recording import KIND_OF_SOURCE, McapPercepts

        path, pace = Path(options.pop("mcap")), dict[str, Any](begin=begin)
        pace |= {key: options.pop(key) for key in ("speed", "loop") if key in options}
        kind = str(options.pop("kind", KIND_OF_SOURCE.get(source or name, "")))
        return Replay(McapPercepts(path, kind, options), **pace)
    if options.get("plugin"):
        wanted = str(options.pop("plugin"))
        for point in entry_points(group=GROUP, name=wanted):
            made: Callable[[], Any] = point.load()(**options)
            return made
        known = ", ".join(sorted(entry_points(group=GROUP).names)) or "none"
        raise LookupError(f"there is no percept plug-in {wanted}; installed: {known}")
    raise ValueError(
        f"{name}: percepts are {given!r}: give socket, recording:FOLDER, mcap:FILE or plugin:NAME"
    )


def _read_lines(path: Path) -> list[tuple[datetime, Any]]:
    lines: list[tuple[datetime, Any]] = []
    TEXT_BYTES.check(
        path.stat().st_size,
        lambda problem, fix: ValueError(f"{path}: {problem}. {fix}"),
        "Split the recording.",
    )
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if line.strip():
            try:
                percept = json.loads(line)
                if "time" not in percept:
                    raise ValueError("the percept has no time")
                lines.append((read_time(percept), percept))
            except (ValueError, TypeError, RecursionError) as error:
                raise ValueError(f"{path}, line {number}: {error}") from None
            if len(lines) > 1 and lines[-1][0] < lines[-2][0]:
                raise ValueError(f"{path}, line {number}: earlier than the line before: sort them")
    if not lines:
        raise ValueError(f"{path} has no percepts: write one to each line")
    return lines
