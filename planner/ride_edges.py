"""The edges of a routing graph between the cabins of one elevator."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from planner.duration import Durations
from planner.travel_edges import TravelEdges
from semmap.geometry.pose import Pose


def ride_edges(
    cabins: Mapping[str, Iterable[str]],
    inside: Mapping[str, NDArray[np.int64]],
    poses: Sequence[Pose],
    durations: Durations,
    speed: float,
) -> tuple[TravelEdges, list[str]]:
    """The rides between each two cabins of an elevator, and the elevator of each ride.

    `cabins` has those of each elevator, `inside` the approach poses of each place by number,
    `poses` all approach poses in the map's frame; `speed` is the robot's inside of a cabin, m/s.
    """
    elevators: list[str] = []
    rides: list[tuple[int, int, float, float]] = []
    for elevator, places in cabins.items():
        for here, there in permutations(places, 2):
            for a, b in product(inside.get(here, ()), inside.get(there, ())):
                p, q = poses[a], poses[b]
                across = math.hypot(p.x - q.x, p.y - q.y)
                seconds = durations.of_riding(elevator, p.z - q.z)
                seconds += across / speed
                elevators.append(elevator)
                rides.append((int(a), int(b), seconds, across))
    columns = np.array(rides).reshape(-1, 4).T
    tails, heads = columns[:2].astype(np.int64)
    return TravelEdges(tails, heads, columns[2], columns[3]), elevators
