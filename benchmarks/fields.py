"""The region map on 50 balls of about 248,000 voxels, rasterising included; maps of sensors.

One thread; inserting is in processor time.
"""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable, Hashable
from datetime import UTC, datetime
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.spheres import centers
from benchmarks.timing import Row, median_seconds, print_rows
from semmap.database.files import schema_folder
from semmap.draw.depth_camera import look_at
from semmap.fields import Box, RegionMap, Sphere, voxels_of
from semmap.fields.maps.live_entities import LiveEntities
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.maps.operators import mask
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary, read_vocabulary
from semmap.fields.regions.region_map import NamedRegionMap, WithRole
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.service.percept_feeds import Inbox
from semmap.fields.sources import Gaze, GazeSource, ObjectSource, Segmentation, SourceManager

__all__ = ["main"]

BALLS = 50
RADIUS = 39.0
TIMES = 5

INSERT = {200: 2.5, 100: 4.0}
REMOVE = {200: 2.5, 100: 5.0}
"""Nanoseconds a voxel at most, by span of the centres."""

LOOK_UP_MS = 5.0
MOVE_MS = 2.0
GAZE_HZ = 20
LOOK_MS = 100.0
DEPTH_MS = 10.0


def balls(span: int) -> list[Sphere]:
    """The balls, in voxels of a metre."""
    return [Sphere(center, RADIUS) for center in centers(BALLS, span)]


def full_map(span: int) -> RegionMap:
    """A map with all of them, one by one."""
    whole = RegionMap(1.0, threads=1)
    for entity, ball in enumerate(balls(span)):
        whole.insert(entity, ball)
    return whole


def median_after(prepare: Callable[[], RegionMap], run: Callable[[RegionMap], object]) -> float:
    """The median time of a run on a map made for it, in seconds."""
    seconds = []
    for _ in range(TIMES):
        prepared = prepare()
        start = time.perf_counter()
        run(prepared)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def remove_even(whole: RegionMap) -> None:
    """Take every other ball out."""
    for entity in range(0, BALLS, 2):
        whole.remove(entity)


def seconds_a_voxel_in_a_dictionary(span: int) -> float:
    """Algorithm 1 of the paper over a hash table of sets, on three of the balls."""
    regions = [list(map(tuple, voxels_of(ball, 1.0).tolist())) for ball in balls(span)[:3]]
    start = time.perf_counter()
    at: dict[tuple[int, ...], frozenset[Hashable]] = {}
    empty: frozenset[Hashable] = frozenset()
    for entity, voxels in enumerate(regions):
        for voxel in voxels:
            at[voxel] = at.get(voxel, empty) | {entity}
    return (time.perf_counter() - start) / sum(map(len, regions))


def vocabulary() -> Vocabulary:
    """The properties of maps."""
    return read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])


def crates() -> RepresentationMap:
    """An object map of 1,069,200 voxels of 5 cm: crates on a floor of 10 x 11 m."""
    boxes = [
        (Box((x, y, 0.75), (0.9, 0.9, 1.5)), 1 + (x + y) % 5) for x in range(10) for y in range(11)
    ]
    legend = {value: f"crate{value}" for value in range(1, 6)}
    property = vocabulary()["containsObject"]
    return RepresentationMap.of_regions(property, boxes, 0.05, value_type="int32", legend=legend)


def looking_about(people: int) -> Gaze:
    """Return people at eye height among the crates; they look in all directions."""
    rng = np.random.default_rng(0)
    poses = {}
    for person in range(people):
        pose = np.eye(4)
        ahead = rng.normal(size=3) * (1, 1, 0.2)
        turn = Rotation.align_vectors([ahead / np.linalg.norm(ahead)], [[0, 0, 1]])[0]
        pose[:3, :3] = turn.as_matrix()
        pose[:3, 3] = (*rng.uniform(2, 8, 2), 1.6)
        poses[f"human{person}"] = pose
    return Gaze(poses, datetime.now(UTC))


def image() -> Segmentation:
    """A wavy wall 1.2 to 2.8 m away, with 9 masks."""
    y, x = np.mgrid[:480, :640]
    depth = (2 + 0.5 * np.sin(x / 80) + 0.3 * np.cos(y / 60)).astype(np.float32)
    labels = ((x // 80 + y // 80) % 9).astype(np.int32)
    names = {label: f"object{label}" for label in range(1, 9)}
    intrinsics = (525, 525, 319.5, 239.5)
    return Segmentation(depth, labels, names, intrinsics, np.eye(4), datetime.now(UTC))


def sensing() -> list[Row]:
    """Maps at the rate of sensors."""
    crate_map, percept = crates(), looking_about(10)
    gaze, objects = GazeSource(vocabulary()), ObjectSource(vocabulary())
    rate = 1 / median_seconds(lambda: [len(mask(crate_map, seen)) for seen in gaze(percept)])
    shown = image()
    depth = 1e3 * median_seconds(lambda: objects(shown))
    return [
        Row(
            f"10 gaze cones of 5 m, each a mask of {len(crate_map):,} voxels",
            f"{rate:.0f} Hz",
            "",
            f"at least {GAZE_HZ} Hz",
            rate >= GAZE_HZ,
        ),
        Row(
            "depth image 640 x 480 with masks to object map",
            f"{depth:.1f} ms",
            "",
            f"at most {DEPTH_MS:g} ms",
            depth <= DEPTH_MS,
        ),
    ]


def look_milliseconds(vocabulary: Vocabulary) -> float:
    """The median time from a percept of a gaze to the event that a person sees a book."""
    regions = RegionMap(0.05)
    names, roles, views = dict[Any, Any](), dict[Any, Any](), dict[Any, str]()
    for number in range(200):
        x, y = divmod(number, 20)
        regions.insert(number, Box((x, y - 10, 0.8), (0.3, 0.3, 0.3)))
    regions.insert("book", Box((3, 0.5, 1.2), (0.2, 0.2, 0.1)))
    regions.insert("room", Box((5, 0, 1.5), (12, 22, 3)))
    roles["room"] = "room"
    maps, arrived = MapBuffer(), threading.Event()
    maps.on_put(arrived.set)
    live = LiveEntities(NamedRegionMap(regions, names, roles, views))
    tracker = RelationTracker(regions, names=names, views=views, spaces=WithRole(roles))
    tracker.update(regions.entities())
    inbox, milliseconds = Inbox(), []
    with SourceManager(maps) as manager:
        manager.activate("gaze", GazeSource(vocabulary), inbox, rate=GAZE_HZ)
        for look in range(4 * TIMES):
            time.sleep(1.5 / GAZE_HZ)
            target = (3, 0.5, 1.2) if look % 2 == 0 else (0, 0, 9)
            start = time.perf_counter()
            inbox.put(Gaze({"human1": look_at((0, 0, 1.6), target)}, datetime.now(UTC)))
            arrived.wait()
            arrived.clear()
            events = tracker.update(live.update(maps.now()))
            assert any((e.relation, e.object) == ("sees", "book") for e in events)
            milliseconds.append(1e3 * (time.perf_counter() - start))
    return statistics.median(milliseconds)


def main() -> None:
    """Print the table."""
    rows = []
    look = look_milliseconds(read_vocabulary([schema_folder() / "ontology" / "fields.ttl"]))
    rows.append(
        Row(
            "a look at a book among 200 objects, from percept to event",
            f"{look:.1f} ms",
            "",
            f"at most {LOOK_MS:g} ms",
            look <= LOOK_MS,
        )
    )
    for span in (200, 100):
        whole = full_map(span)
        sizes = [len(whole.voxels(entity)) for entity in range(BALLS)]
        before = whole.memory()
        plain = 1e9 * seconds_a_voxel_in_a_dictionary(span)

        seconds = median_seconds(lambda span=span: full_map(span), TIMES, clock=time.process_time)  # type: ignore[misc]
        insert = 1e9 * seconds / sum(sizes)
        rows.append(
            Row(
                f"insert, a voxel, S = {span} ({before.set_count:,} sets)",
                f"{insert:.2f} ns",
                f"dictionary of 3 balls: {plain:.0f} ns: {plain / insert:.0f}x",
                f"at most {INSERT[span]:g} ns",
                insert <= INSERT[span],
            )
        )

        removed = sum(sizes[::2])
        remove = 1e9 * median_after(lambda span=span: full_map(span), remove_even) / removed  # type: ignore[misc]
        rows.append(
            Row(
                f"remove the even ones, a removed voxel, S = {span}",
                f"{remove:.2f} ns",
                "",
                f"at most {REMOVE[span]:g} ns",
                remove <= REMOVE[span],
            )
        )

        points = np.random.default_rng(0).uniform(61, 139 + span, (100_000, 3))
        look_up = 1e3 * median_seconds(lambda w=whole, p=points: w.set_numbers_at(p))  # type: ignore[misc]
        rows.append(
            Row(
                f"100,000 points looked up, S = {span}",
                f"{look_up:.1f} ms",
                "",
                f"at most {LOOK_UP_MS:g} ms",
                look_up <= LOOK_UP_MS,
            )
        )

        x, y, z = centers(BALLS, span)[7]
        there = [Sphere((x + 1, y, z), RADIUS), Sphere((x, y, z), RADIUS)]
        both = 1e3 * median_seconds(lambda w=whole, t=there: [w.move(7, ball) for ball in t])  # type: ignore[misc]
        rows.append(
            Row(
                f"move one of {sizes[7]:,} voxels by a voxel, S = {span}",
                f"{both / 2:.2f} ms",
                "",
                f"at most {MOVE_MS:g} ms",
                both / 2 <= MOVE_MS,
            )
        )

        remove_even(whole)
        after = whole.memory()
        rows.append(
            Row(
                f"bytes an active voxel, S = {span}",
                f"{before.bytes_per_voxel:.1f}; {after.bytes_per_voxel:.1f} after removal",
                f"{before.leaves:,} leaves, {before.tiles:,} tiles; "
                f"{after.leaves:,} leaves, {after.tiles:,} tiles",
                "reported",
                True,
            )
        )
    print_rows("Region map", rows)
    print_rows("Representation maps", sensing())


if __name__ == "__main__":
    main()
