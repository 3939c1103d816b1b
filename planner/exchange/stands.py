"""The poses before connectors and the ways between them: what every route graph is made of."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations, product
from typing import Literal

from planner.topology import OUTSIDE, Connector, Topology
from semmap.geometry.pose import Pose

__all__ = ["ExchangeError", "Move", "Stand", "Stands", "Times", "stands_of"]

Point = tuple[float, ...]
Walk = Callable[[str, Point, Point], float]
"""Seconds of the way between two points (x, y, z; the map's frame) of a place; inf: no way."""


class ExchangeError(ValueError):
    """A topology that a format cannot hold; the message says the mend."""


@dataclass(frozen=True)
class Times:
    """How long it takes, in seconds, beside walking inside of places.

    Attributes
    ----------
    speed : metres a second, on straight ways and through connectors
    ride : calling an elevator and riding it once
    ride_per_metre : each metre of height that the ride overcomes
    closed, locked : opening a closed connector, unlocking a locked one
    """

    speed: float = 0.5
    ride: float = 30.0
    ride_per_metre: float = 2.0
    closed: float = 4.0
    locked: float = 20.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < math.inf or (name in ("speed", "ride") and value == 0):
                raise ValueError(f"times: {name} is {value}; give a finite number above zero")

    def straight(self, place: str, a: Point, b: Point) -> float:
        """Seconds as the crow flies; a `Walk`."""
        return math.dist(a, b) / self.speed


@dataclass(frozen=True)
class Stand:
    """The pose before a connector, on one of its sides (0 or 1), facing it."""

    connector: Connector
    side: int
    storey: str
    elevator: str | None = None

    @property
    def place(self) -> str:
        return self.connector.places[self.side]

    @property
    def pose(self) -> Pose:
        return self.connector.poses[self.side]

    @property
    def point(self) -> Point:
        return (self.pose.x, self.pose.y, self.pose.z)

    @property
    def name(self) -> str:
        """Unique, as names of places and connectors are."""
        return f"{self.connector.name}@{self.place}"


@dataclass(frozen=True)
class Move:
    """One way from stand to stand (indices), in one direction.

    Attributes
    ----------
    kind : walk inside of a place, passage through a connector, ride of an elevator
    connector : what a passage leads through
    elevator : what a ride uses, or what a passage leads into
    """

    start: int
    end: int
    kind: Literal["walk", "passage", "ride"]
    seconds: float
    connector: Connector | None = None
    elevator: str | None = None


@dataclass(frozen=True)
class Stands:
    """All stands and moves of a topology, or of one storey of it."""

    stands: tuple[Stand, ...]
    moves: tuple[Move, ...]

    @property
    def storeys(self) -> list[str]:
        return list(dict.fromkeys(stand.storey for stand in self.stands))

    def busiest(self) -> tuple[str, int]:
        """The place with the most stands, and how many it has."""
        return Counter(stand.place for stand in self.stands).most_common(1)[0]


def stands_of(
    topology: Topology,
    *,
    storey: str | None = None,
    walk: Walk | None = None,
    times: Times | None = None,
    allow_locked: bool = False,
    storeyless: str = "map",
) -> Stands:
    """The stands of a topology and the moves that are allowed between them.

    Shortest ways over the moves are those of `planner.route.route`. Of `OUTSIDE` the map knows
    nothing, so that no walk leads through it.

    Parameters
    ----------
    storey : only this one, with no ride, as those lead away
    walk : seconds between two points of a place, by default those of the straight line
    allow_locked : whether locked connectors are passed, too
    storeyless : name of the storey of places that have none

    Raises
    ------
    ExchangeError
        There is no such storey.
    """
    times = times or Times()
    walk = walk or times.straight
    stands = [
        Stand(c, side, _storey(topology, c, side) or storeyless, _elevator(topology, c, side))
        for c in topology.connectors.values()
        for side in (0, 1)
    ]
    if storey is not None:
        known = dict.fromkeys(p.storey or storeyless for p in topology.places.values())
        if storey not in known:
            raise ExchangeError(f"there is no storey {storey}; there are: {', '.join(known)}")
        stands = [stand for stand in stands if stand.storey == storey]
    moves = [
        *_walks(stands, walk),
        *_passages(topology, stands, times, allow_locked),
        *_rides(stands, times),
    ]
    return Stands(tuple(stands), tuple(moves))


def _storey(topology: Topology, connector: Connector, side: int) -> str | None:
    """That of the place, or of the place on the other side: a door to the outside has one."""
    here, there = (topology.places[connector.places[s]] for s in (side, 1 - side))
    return here.storey or (there.storey if here.name == OUTSIDE else None)


def _elevator(topology: Topology, connector: Connector, side: int) -> str | None:
    return topology.places[connector.places[side]].elevator


def _walks(stands: list[Stand], walk: Walk) -> Iterator[Move]:
    inside: dict[str, list[int]] = {}
    for number, stand in enumerate(stands):
        if stand.place != OUTSIDE:
            inside.setdefault(stand.place, []).append(number)
    for place, numbers in inside.items():
        for a, b in permutations(numbers, 2):
            seconds = walk(place, stands[a].point, stands[b].point)
            if not math.isinf(seconds):
                yield Move(a, b, "walk", seconds)


def _passages(
    topology: Topology, stands: list[Stand], times: Times, allow_locked: bool
) -> Iterator[Move]:
    numbers = {(s.connector.name, s.side): number for number, s in enumerate(stands)}
    extra = {"open": 0.0, "closed": times.closed, "locked": times.locked}
    for (name, side), start in numbers.items():
        connector, end = stands[start].connector, numbers.get((name, 1 - side))
        if end is None or not connector.passes(side):
            continue
        if connector.state == "locked" and not allow_locked:
            continue
        through = math.dist(stands[start].point, stands[end].point) / times.speed
        into = stands[end].elevator if stands[start].elevator != stands[end].elevator else None
        yield Move(start, end, "passage", through + extra[connector.state], connector, into)


def _rides(stands: list[Stand], times: Times) -> Iterator[Move]:
    cabins: dict[str, dict[str, list[int]]] = {}
    for number, stand in enumerate(stands):
        if stand.elevator is not None:
            cabins.setdefault(stand.elevator, {}).setdefault(stand.place, []).append(number)
    for elevator, places in cabins.items():
        for here, there in permutations(places.values(), 2):
            for a, b in product(here, there):
                height = abs(stands[a].pose.z - stands[b].pose.z)
                seconds = times.ride + times.ride_per_metre * height
                yield Move(a, b, "ride", seconds, elevator=elevator)
