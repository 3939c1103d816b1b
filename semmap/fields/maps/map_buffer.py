"""The maps that there are now, and were of late: what sources write and everybody reads.

Writers replace all that a source gave in one step; readers take a state that never changes. So none
waits for another, and nobody sees a half of an update.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise

from semmap.fields.maps.representation_map import RepresentationMap

__all__ = ["Maps", "Update"]


@dataclass(frozen=True)
class Update:
    """What a source gave at a time; it holds until its next one."""

    time: datetime
    maps: tuple[RepresentationMap, ...]


class Maps:
    """Maps by source, with their history (reMap, section 6, has that as future work).

    Parameters
    ----------
    span : timedelta
        How long an update is kept after the next one replaced it, unless a source has its own span.
    """

    def __init__(self, span: timedelta = timedelta(seconds=30)) -> None:
        self._span = span
        self._state: Mapping[str, tuple[Update, ...]] = {}
        self._lock = threading.Lock()  # of writers among each other

    def put(
        self,
        source: str,
        maps: Iterable[RepresentationMap],
        time: datetime | None = None,
        *,
        span: timedelta | None = None,
    ) -> None:
        """Replace what a source gave by what it gives now.

        Raises
        ------
        ValueError
            A time without a zone, or before the source's last.
        """
        now = _aware(time) if time is not None else datetime.now(UTC)
        update = Update(now, tuple(maps))
        with self._lock:
            past = self._state.get(source, ())
            if past and past[-1].time > now:
                raise ValueError(f"{source} gave maps of {past[-1].time} before those of {now}")
            oldest = now - (self._span if span is None else span)
            # An update holds until the next one: keep each whose successor is not too old.
            kept = [
                each for each, following in pairwise((*past, update)) if following.time > oldest
            ]
            self._state = {**self._state, source: (*kept, update)}

    def withdraw(self, source: str, time: datetime | None = None) -> None:
        """Take out what a source put in; what it was stays known for its span."""
        if source in self._state:
            self.put(source, (), time)

    def sources(self) -> list[str]:
        """Those that have maps now."""
        return sorted(name for name, past in self._state.items() if past[-1].maps)

    def now(self) -> tuple[RepresentationMap, ...]:
        """The maps of all sources."""
        return tuple(m for past in self._state.values() for m in past[-1].maps)

    def at(self, moment: datetime) -> tuple[RepresentationMap, ...]:
        """The maps that held at a moment."""
        return self.during(moment, moment)

    def during(self, begin: datetime, end: datetime) -> tuple[RepresentationMap, ...]:
        """The maps that held at any time from `begin` to `end`, both included.

        Raises
        ------
        ValueError
            Times without a zone, or an end before the beginning.
        """
        if _aware(end) < _aware(begin):
            raise ValueError(f"the time ends at {end}, before it begins at {begin}")
        found: list[RepresentationMap] = []
        for past in self._state.values():
            for i, each in enumerate(past):
                over = i + 1 < len(past) and past[i + 1].time <= begin
                if each.time <= end and not over:
                    found += each.maps
        return tuple(found)

    def remembered(self) -> Iterator[RepresentationMap]:
        """All maps of the span that is kept."""
        for past in self._state.values():
            for each in past:
                yield from each.maps

    def since(self) -> datetime | None:
        """The time of the oldest update that is still known."""
        return min((past[0].time for past in self._state.values()), default=None)


def _aware(time: datetime) -> datetime:
    if time.tzinfo is None:
        raise ValueError(f"{time} has no time zone: give an aware datetime")
    return time
