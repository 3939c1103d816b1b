"""The current maps of all sources, and their recent history.

A writer replaces all maps of its source in one step; a reader gets a state that never changes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

from semmap.fields.maps.representation_map import RepresentationMap


@dataclass(frozen=True)
class SourceUpdate:
    """The maps of a source from a time on, until its next update."""

    time: datetime  # aware
    maps: tuple[RepresentationMap, ...]  # all maps of the source
    # names of the properties that the source states, also where it has no map of them now: a source
    # of gazes that sees nobody states that nobody looks
    provides: frozenset[str] = frozenset()
    source: str = ""  # its name


class MapBuffer:
    """Maps by source, with their history (future work in reMap, section 6).

    `span` is how long an update is kept after the next one replaced it.
    """

    def __init__(self, span: timedelta = timedelta(seconds=30)) -> None:
        self._span = span
        self._state: Mapping[str, tuple[SourceUpdate, ...]] = {}
        self._lock = threading.Lock()  # between writers; readers need none
        self._listeners: tuple[Callable[[], object], ...] = ()

    def put(
        self,
        source: str,
        maps: Iterable[RepresentationMap],
        time: datetime | None = None,
        *,
        provides: Iterable[str] = (),
    ) -> None:
        """Replace all maps of a source, at an aware time, by default now.

        It states the properties that it `provides`, and those of its maps since it was withdrawn
        last. Raises ValueError: the time has no zone, or is before the last update of the source.
        """
        now = _aware(time) if time is not None else datetime.now(UTC)
        given = tuple(maps)
        names = frozenset(provides).union(*(_stated_by(each) for each in given))
        self._put(source, SourceUpdate(now, given, names, source), also_former=True)

    def _put(self, source: str, update: SourceUpdate, *, also_former: bool) -> None:
        now = update.time
        with self._lock:
            past = self._state.get(source, ())
            if also_former and past:
                update = replace(update, provides=update.provides | past[-1].provides)
            if past and past[-1].time > now:
                raise ValueError(
                    f"{source}: the maps of {now} are older than those of {past[-1].time}, its "
                    "last update: give a later time"
                )
            oldest = now - self._span
            # An update is valid until the next one: keep each whose successor is not too old.
            kept = [
                each for each, following in pairwise((*past, update)) if following.time > oldest
            ]
            self._state = {**self._state, source: (*kept, update)}
        for wake in self._listeners:
            wake()

    def on_put(self, wake: Callable[[], object]) -> None:
        """Call a function after each update of any source, in the thread of that source."""
        self._listeners = (*self._listeners, wake)

    def withdraw(self, source: str, time: datetime | None = None) -> None:
        """Remove the current maps of a source: its properties are unknown, its history stays."""
        if source in self._state:
            now = _aware(time) if time is not None else datetime.now(UTC)
            self._put(source, SourceUpdate(now, (), source=source), also_former=False)

    def now(self) -> tuple[RepresentationMap, ...]:
        """Return the current maps of all sources."""
        return tuple(m for each in self.current() for m in each.maps)

    def updates(self, begin: datetime, end: datetime) -> Iterator[SourceUpdate]:
        """Yield the updates that were valid at any time from `begin` to `end`, both included.

        Raises ValueError: a time has no time zone, or the end is before the beginning.
        """
        if _aware(end) < _aware(begin):
            raise ValueError(f"the time ends at {end}, before it begins at {begin}")
        for past in self._state.values():
            for i, each in enumerate(past):
                over = i + 1 < len(past) and past[i + 1].time <= begin
                if each.time <= end and not over:
                    yield each

    def newest(self) -> dict[str, SourceUpdate]:
        """Return the newest update of each source, by name."""
        return {source: past[-1] for source, past in self._state.items()}

    def oldest(self) -> dict[str, datetime]:
        """Return for each source the time of its oldest update that is kept."""
        return {source: past[0].time for source, past in self._state.items()}

    def current(self) -> tuple[SourceUpdate, ...]:
        """Return the newest update of each source."""
        return tuple(past[-1] for past in self._state.values())

    def remembered(self) -> Iterator[RepresentationMap]:
        """Yield all maps that are kept, current and former ones."""
        for past in self._state.values():
            for each in past:
                yield from each.maps


def _stated_by(map: RepresentationMap) -> set[str]:
    """Return the names of the properties that a map states."""
    degree = map.property.measure if map.value_type == "float32" else None
    return {map.property.name} | ({degree} if degree else set())


def _aware(time: datetime) -> datetime:
    if time.tzinfo is None:
        raise ValueError(f"{time} has no time zone: give an aware datetime")
    return time
