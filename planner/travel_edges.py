"""The edges of a routing graph inside of places: from each approach pose to all others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.topology import OUTSIDE
from planner.travel_cost import TravelCost
from semmap.geometry.pose import Pose

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class TravelEdges(NamedTuple):
    """Travel edges as arrays (n,), one edge for each direction."""

    tails: Ints  # from which approach pose
    heads: Ints  # to which approach pose
    seconds: Floats  # infinite where no path leads
    metres: Floats

    def take(self, which: Any) -> TravelEdges:
        """Some of the edges, by an index array, a mask or a slice."""
        return TravelEdges(
            self.tails[which], self.heads[which], self.seconds[which], self.metres[which]
        )


def measure_travel(
    costs: TravelCost, place: str, nodes: Ints, poses: Sequence[Pose]
) -> TravelEdges:
    """The travel in a place between each two of its approach poses, by number (n,) and pose."""
    others = ~np.eye(len(poses), dtype=bool)
    travel = costs.between(place, poses, poses)
    a, b = (k[others] for k in np.meshgrid(nodes, nodes, indexing="ij"))
    return TravelEdges(a, b, travel.seconds[others], travel.metres[others])


def complete_travel(
    stored: TravelEdges, inside: Mapping[str, Ints], place_of: Sequence[str]
) -> tuple[TravelEdges, dict[str, int]]:
    """The stored edges of places that lack none, and the number of edges of each.

    `inside` has the approach poses of each place, `place_of` the place of each approach pose.
    """
    numbers = {place: i for i, place in enumerate(inside)}
    of = np.array([numbers[p] for p in place_of], np.int64)[stored.tails]
    order = np.argsort(of, kind="stable")
    counts = np.bincount(of, minlength=len(numbers))
    poses = np.array([len(nodes) for nodes in inside.values()])
    complete = counts == poses * (poses - 1)
    if OUTSIDE in numbers:
        complete[numbers[OUTSIDE]] = False
    block = stored.take(order[complete[of[order]]])
    return block, {p: n for p, n, c in zip(numbers, counts.tolist(), complete, strict=True) if c}
