"""Running sources: rates, failures, and their maps; readers and writers at the same time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest

from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.regions.shaped_region import Box, Sphere
from semmap.fields.sources import SourceManager
from semmap.fields.sources.manager import EndOfPercepts
from semmap.language.schema import Property
from tests.waiting import wait_until

SEES = Property("urn:t#sees", "sees", "Region", "Agent", "voxel", "entity", measure="attention")
COUNT = Property("urn:t#count", "count", "Region", None, "voxel", "number")
SECONDS = float(os.environ.get("SEMMAP_SOAK", "3"))


class Percept:
    def __init__(self, number: int) -> None:
        self.number = number
        self.time = datetime.now(UTC)


def counter() -> Callable[[], Percept]:
    numbers = iter(range(10**9))
    return lambda: Percept(next(numbers))


def spheres(percept: Percept) -> list[RepresentationMap]:
    return [
        RepresentationMap.of_regions(SEES, [(Sphere((i, 0, 0), 0.2), True)], 0.05, about=f"h{i}")
        for i in range(percept.number % 3 + 1)
    ]


def with_maps(maps: MapBuffer) -> list[str]:
    return sorted(name for name, update in maps.newest().items() if update.maps)


def during(maps: MapBuffer, begin: datetime, end: datetime) -> tuple[RepresentationMap, ...]:
    return tuple(m for update in maps.updates(begin, end) for m in update.maps)


def at(maps: MapBuffer, moment: datetime) -> tuple[RepresentationMap, ...]:
    return during(maps, moment, moment)


def test_sources_start_and_stop_at_run_time() -> None:
    with SourceManager(MapBuffer()) as manager:
        manager.activate("gaze", spheres, counter(), rate=100)
        manager.activate("more", spheres, counter(), rate=1)
        with pytest.raises(ValueError, match="is running"):
            manager.activate("gaze", spheres, counter())
        wait_until(lambda: manager.status()["gaze"].updates > 5)
        assert with_maps(manager.maps) == ["gaze", "more"]
        # Another number of maps each time.
        seen = set()
        wait_until(lambda: seen.add(len(manager.maps.now())) or len(seen) > 2)
        assert manager.status()["more"].updates <= 2
        manager.deactivate("gaze")
        assert with_maps(manager.maps) == ["more"]
        assert set(manager.status()) == {"more"}
        with pytest.raises(LookupError, match="running: more"):
            manager.deactivate("gaze")
    assert with_maps(manager.maps) == []
    assert manager.maps.now() == ()


def test_a_source_continues_after_an_error(caplog: pytest.LogCaptureFixture) -> None:
    def source(percept: Percept) -> list[RepresentationMap]:
        if percept.number % 2:
            raise RuntimeError("no light")
        return spheres(percept)

    with SourceManager(MapBuffer()) as manager:
        manager.activate("gaze", source, counter(), rate=200)
        wait_until(lambda: manager.status()["gaze"].updates > 3)
        wait_until(lambda: manager.status()["gaze"].error == "RuntimeError: no light")
        assert with_maps(manager.maps) == ["gaze"]
    assert "source gaze failed" in caplog.text


def test_the_same_percept_makes_no_new_maps() -> None:
    one = Percept(0)
    with SourceManager(MapBuffer()) as manager:
        manager.activate("gaze", spheres, lambda: one, rate=500)
        manager.activate("none", spheres, lambda: None, rate=500)
        wait_until(lambda: manager.status()["gaze"].updates == 1)
        time.sleep(0.05)
        assert manager.status()["gaze"].updates == 1
        assert with_maps(manager.maps) == ["gaze"]


def test_wrong_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="above 0"):
        SourceManager(MapBuffer()).activate("gaze", spheres, counter(), rate=0)


def test_moments_and_intervals() -> None:
    start = datetime(2026, 11, 21, tzinfo=UTC)

    def after(seconds: float) -> datetime:
        return start + timedelta(seconds=seconds)

    made = [spheres(Percept(0)) for _ in range(6)]
    maps = MapBuffer(timedelta(seconds=10))
    for i, each in enumerate(made[:4]):
        maps.put("gaze", each, after(5 * i))
    maps.put("other", made[4], after(7))

    def numbers(found: tuple[RepresentationMap, ...]) -> list[int]:
        return sorted(i for i, each in enumerate(made) if each[0] in found)

    assert numbers(maps.now()) == [3, 4]
    assert numbers(at(maps, after(6))) == [1]
    assert numbers(at(maps, after(10))) == [2, 4]
    assert numbers(during(maps, after(6), after(11))) == [1, 2, 4]
    assert numbers(at(maps, after(4.9))) == []  # older than its span
    assert min(maps.oldest().values()) == after(5)
    maps.withdraw("gaze", after(20))
    assert numbers(maps.now()) == [4]
    assert numbers(at(maps, after(19))) == [3, 4]
    maps.put("gaze", made[5], after(40))
    assert numbers(at(maps, after(31))) == [4]
    with pytest.raises(ValueError, match="older than those"):
        maps.put("gaze", made[5], after(39))
    with pytest.raises(ValueError, match="time zone"):
        at(maps, datetime(2026, 1, 1))
    with pytest.raises(ValueError, match="before it begins"):
        during(maps, after(2), after(1))


def test_readers_never_see_half_of_an_update() -> None:
    """4 sources at 30 Hz, each of two maps that say the same number everywhere, and 4 readers."""

    def source(percept: Percept) -> list[RepresentationMap]:
        return [
            RepresentationMap.of_regions(
                COUNT,
                [(Box((0, y, 0), (2, 2, 1)), float(percept.number))],
                0.05,
                value_type="float32",
            )
            for y in (0.0, 3.0)
        ]

    torn: list[Any] = []
    reads = [0] * 4
    stop = threading.Event()

    def read(reader: int, maps: MapBuffer) -> None:
        last: dict[int, float] = {}
        while not stop.is_set():
            now = maps.now()
            values = [np.unique(each.values()) for each in now]
            if any(len(v) != 1 for v in values) or len(now) % 2:
                torn.append(values)
            for i in range(0, len(now), 2):
                a, b = float(values[i][0]), float(values[i + 1][0])
                if a != b or a < last.get(i, 0):
                    torn.append((i, a, b))
                last[i] = a
            reads[reader] += 1

    with SourceManager(MapBuffer(timedelta(seconds=1))) as manager:
        for k in range(4):
            manager.activate(f"source{k}", source, counter(), rate=30)
        wait_until(lambda: len(manager.maps.now()) == 8)
        readers = [threading.Thread(target=read, args=(k, manager.maps)) for k in range(4)]
        for reader in readers:
            reader.start()
        time.sleep(SECONDS)
        stop.set()
        for reader in readers:
            reader.join()
        updates = [each.updates for each in manager.status().values()]
        errors = [each.error for each in manager.status().values()]
    assert torn == []
    assert errors == [None] * 4
    assert min(reads) > 10
    assert min(updates) >= 0.5 * 30 * SECONDS / 4  # a shared machine; none starves


def test_an_unknown_follows_when_percepts_stop() -> None:
    """What a source provides is known from its first percept to its timeout or its end."""

    def provided() -> frozenset[str]:
        return frozenset().union(*(update.provides for update in maps.current()))

    maps, percepts = MapBuffer(), [Percept(0)]
    with SourceManager(maps) as manager:
        manager.activate("spheres", spheres, lambda: percepts[-1], rate=100, timeout=0.2)
        wait_until(lambda: provided() == {"sees"})
        wait_until(lambda: provided() == frozenset())
        assert "no percept for 0.2 s" in str(manager.status()["spheres"].error)
        percepts.append(Percept(1))
        wait_until(lambda: provided() == {"sees"})

        def ending() -> Percept:
            if manager.status()["ending"].updates:
                raise EndOfPercepts
            return percepts[0]

        manager.activate("ending", lambda _: [], ending, rate=100)
        wait_until(lambda: manager.status()["ending"].error == "the percepts ended")


def test_a_percept_that_arrives_wakes_its_source() -> None:
    """The source does not wait for its next turn."""

    class Box1:
        def __init__(self) -> None:
            self.newest: Percept | None = None
            self.arrived = threading.Event()

        def __call__(self) -> Percept | None:
            self.arrived.clear()
            return self.newest

        def wait(self, seconds: float) -> bool:
            return self.arrived.wait(seconds)

    maps, inbox, woken = MapBuffer(), Box1(), threading.Event()
    maps.on_put(woken.set)
    with SourceManager(maps) as manager:
        manager.activate("spheres", spheres, inbox, rate=2)
        time.sleep(0.6)
        begin = time.monotonic()
        inbox.newest = Percept(0)
        inbox.arrived.set()
        assert woken.wait(5)
        assert time.monotonic() - begin < 0.4
