"""The time of an update of relations after one of 1,000 entities moved; one thread."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Row, median_seconds, print_rows
from semmap.fields import Box, Cone, RegionMap, Sphere
from semmap.fields.relations.tracker import RelationTracker

__all__ = ["main"]

ENTITIES = 1000
SIZE = 0.05
PLAN = np.array((40.0, 25.0))
UPDATE_MS = 2.0


def furnished() -> tuple[RegionMap, list[NDArray[np.float64]]]:
    """Return a floor of 40 x 25 m with 500 tables of 1.2 x 0.8 m, a ball on each; five views."""
    random = np.random.default_rng(7)
    here = RegionMap(SIZE, threads=1)
    cells = random.permutation(28 * 18)[: ENTITIES // 2]
    places = [np.array((1 + 1.4 * (c % 28), 1 + 1.35 * (c // 28), 0.0)) for c in cells]
    regions: list[tuple[object, Box | Sphere | Cone]] = [
        ("floor", Box((*PLAN / 2, -0.1), (*PLAN, 0.2)))
    ]
    for i, place in enumerate(places):
        regions.append((f"table{i}", Box(place + (0, 0, 0.4), (1.2, 0.8, 0.8))))  # noqa: RUF005
        regions.append((f"ball{i}", Sphere(place + (0, 0, 0.95), 0.15)))  # noqa: RUF005
    for i in range(5):
        eyes = (*random.uniform((5, 5), PLAN - 5), 1.6)
        regions.append((f"view{i}", Cone(eyes, (*random.normal(size=2), -0.2), 0.5, 5.0)))
    here.insert_many(regions)
    return here, places


def main() -> None:
    """Print the table."""
    here, places = furnished()
    views = {f"view{i}": f"human{i}" for i in range(5)}
    tracker = RelationTracker(here, views=views)  # near is within 0.5 m
    start = time.perf_counter()
    tracker.update(here.entities())
    first = time.perf_counter() - start
    facts = len(tracker.holding())
    rows = [
        Row(
            f"all of {len(here):,} entities at first",
            f"{1e3 * first:.0f} ms",
            f"{facts:,} facts",
            "reported",
            True,
        )
    ]

    up = np.array((0, 0, 0.95))
    for name, steps in (
        ("ball3", [Sphere(places[3] + up + (x, 0, 0), 0.15) for x in (0.05, 0.0)]),
        ("table3", [Box(places[3] + (x, 0, 0.4), (1.2, 0.8, 0.8)) for x in (0.05, 0.0)]),
        ("view3", [Cone((20, 12, 1.6), (1, y, -0.2), 0.5, 5.0) for y in (0.0, 0.1)]),
        ("floor", [Box((*PLAN / 2, z), (*PLAN, 0.2)) for z in (-0.15, -0.1)]),
    ):
        size = here.size(name)

        def move(name: str = name, steps: list[object] = steps) -> None:  # type: ignore[assignment]
            for region in steps:
                here.move(name, region)  # type: ignore[arg-type]

        def follow(name: str = name, steps: list[object] = steps) -> None:  # type: ignore[assignment]
            for region in steps:
                here.move(name, region)  # type: ignore[arg-type]
                tracker.update([name])

        moved = median_seconds(move, 21)
        update = 1e3 * (median_seconds(follow, 21) - moved) / len(steps)
        small = name != "floor"
        rows.append(
            Row(
                f"{name} ({size:,} voxels) moves by 5 cm",
                f"{update:.2f} ms",
                f"all entities again: {1e3 * first / update:,.0f}x",
                f"at most {UPDATE_MS:g} ms" if small else "reported",
                not small or update <= UPDATE_MS,
            )
        )
    print_rows("Relations", rows)


if __name__ == "__main__":
    main()
