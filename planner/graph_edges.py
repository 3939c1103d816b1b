"""The edges of a routing graph: travel in places, passages of connectors, rides in elevators."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations, product
from operator import attrgetter
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from planner.robot_class import Durations, RobotClass
from planner.topology import OUTSIDE, PlaceConnector
from semmap.arrays import Floats, Ints
from semmap.geometry.pose import Pose


class Travel(NamedTuple):
    """Seconds and metres from n poses to m poses, (n, m) float64; infinite where no path leads."""

    seconds: Floats
    metres: Floats


class TravelCost(Protocol):
    """Measures paths inside of a place. A path takes as long in either direction."""

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        """The travel from each of n poses in a place to each of m; poses in the map's frame."""

    def obstruction(self, place: str, pose: Pose) -> str | None:
        """What closes the door of an approach pose in a place, in words; None if nothing does."""

    def standing(self, place: str, pose: Pose) -> Pose:
        """Where the robot stands for an approach pose in a place: aside of what is there."""

    def has_outline(self, place: str) -> bool:
        """Whether it is known where the floor of a place is."""

    def bends(self, connector: PlaceConnector) -> list[tuple[float, float]]:
        """Where the way through a connector bends, from its first place on; none if straight."""


class StraightTravelCost:
    """Straight lines at one speed, m/s, whatever is in the way."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        """The travel along straight lines from each of n poses to each of m."""
        metres = np.array([math.dist(p[:3], q[:3]) for p in a for q in b]).reshape(len(a), len(b))
        return Travel(metres / self.speed, metres)

    def obstruction(self, place: str, pose: Pose) -> str | None:
        """Nothing."""
        return None

    def standing(self, place: str, pose: Pose) -> Pose:
        """The pose itself."""
        return pose

    def has_outline(self, place: str) -> bool:
        """As if all had."""
        return True

    def bends(self, connector: PlaceConnector) -> list[tuple[float, float]]:
        """None."""
        return []


class TravelEdges(NamedTuple):
    """Travel edges as arrays (n,), one edge for each direction."""

    tails: Ints  # from which approach pose
    heads: Ints  # to which approach pose
    seconds: Floats  # infinite where no path leads
    metres: Floats

    def take(self, which: Any) -> TravelEdges:
        """Some of the edges, by an index array, a mask or a slice."""
        return TravelEdges(*(column[which] for column in self))


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


_DECISIVE = attrgetter(
    "state", "type", "behaviour", "permissions", "width", "height", "step", "narrowed"
)
"""What decides whether a robot is blocked, except the direction and the slope of a ramp."""


def passage_seconds(
    connectors: Sequence[PlaceConnector],
    metres: Floats,
    robot: RobotClass,
    durations: Durations,
    elevators: Mapping[str, str],
) -> Floats:
    """(2 n,) seconds of passing each connector from either side, over so many metres.

    `elevators` has the elevator of each place that is a cabin.
    """
    found = metres / robot.speed
    for i, connector in enumerate(connectors):
        if durations.measured:
            found[2 * i : 2 * i + 2] = durations.of_passing(connector, robot.speed)
        if connector.state != "open":
            found[2 * i : 2 * i + 2] += durations.of_opening(connector)
        a, b = connector.places
        if (a in elevators or b in elevators) and elevators.get(a) != elevators.get(b):
            for side, there in enumerate((b, a)):  # the elevator has to be called first
                if there in elevators:
                    found[2 * i + side] += durations.of_calling(elevators[there])
    return found


def blocked_passages(connectors: Sequence[PlaceConnector], robot: RobotClass) -> NDArray[np.bool_]:
    """(2 n,) whether the robot cannot pass each connector from either side."""
    blocked: list[bool] = []
    known: dict[tuple[object, ...], bool] = {}  # most doors are alike
    for c, key in zip(connectors, map(_DECISIVE, connectors), strict=True):
        answer = known.get(key)
        if answer is None or c.type == "ramp":
            answer = known[key] = robot.blocking_reason(c) is not None
        blocked.append(answer)
    found = np.repeat(np.array(blocked, np.bool_), 2)
    for i, c in enumerate(connectors):
        if c.direction != "both":
            found[2 * i : 2 * i + 2] |= [not c.passes(0), not c.passes(1)]
    return found


def ride_edges(
    cabins: Mapping[str, Iterable[str]],
    inside: Mapping[str, Ints],
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
                seconds = durations.of_riding(elevator, p.z - q.z) + across / speed
                elevators.append(elevator)
                rides.append((int(a), int(b), seconds, across))
    columns = np.array(rides).reshape(-1, 4).T
    tails, heads = columns[:2].astype(np.int64)
    return TravelEdges(tails, heads, columns[2], columns[3]), elevators


@dataclass
class Penalties:
    """Changes of the edges of a routing graph for one query, by number of the edge.

    `seconds` are added to the cost, which decides on the route and is no duration; `blocked` says
    why an edge must not be used; `detours` are seconds and metres of longer travel.
    """

    seconds: dict[int, float] = field(default_factory=dict)
    blocked: dict[int, str] = field(default_factory=dict)
    detours: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, edges: Iterable[int], seconds: float, reason: str) -> None:
        """Make edges cost more; infinite seconds block them for this reason."""
        for edge in edges:
            if math.isinf(seconds):
                self.blocked.setdefault(edge, reason)
            else:
                self.seconds[edge] = self.seconds.get(edge, 0.0) + seconds
