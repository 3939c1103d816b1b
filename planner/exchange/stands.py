"""The poses before connectors and the ways between them: what every route graph is made of."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from shapely import MultiPolygon, Polygon

from planner.exchange.bends import ways_around
from planner.network import Network
from planner.topology import OUTSIDE, Connector, Topology
from semmap.geometry.pose import Pose

__all__ = [
    "ExchangeError",
    "Move",
    "Stand",
    "Stands",
    "Waypoint",
    "around_corners",
    "stands_of",
    "with_middles",
]


Outline: TypeAlias = Polygon | MultiPolygon


class ExchangeError(ValueError):
    """A topology that a format cannot hold; the message says the mend."""


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
    def point(self) -> tuple[float, float, float]:
        return (self.pose.x, self.pose.y, self.pose.z)

    @property
    def name(self) -> str:
        """Unique, as names of places and connectors are."""
        return f"{self.connector.name}@{self.place}"


@dataclass(frozen=True)
class Waypoint:
    """A point of a place that is before no connector: at a corner, or in the middle."""

    name: str
    place: str
    storey: str
    point: tuple[float, float, float]
    elevator: str | None = None


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
    """All stands and moves of a network, or of one storey of it, and the waypoints between."""

    stands: tuple[Stand | Waypoint, ...]
    moves: tuple[Move, ...]

    @property
    def storeys(self) -> list[str]:
        return list(dict.fromkeys(stand.storey for stand in self.stands))

    def busiest(self) -> tuple[str, int]:
        """The place with the most connectors, and how many it has."""
        counted = Counter(s.place for s in self.stands if isinstance(s, Stand))
        return counted.most_common(1)[0]


def stands_of(network: Network, *, storey: str | None = None, storeyless: str = "map") -> Stands:
    """The stands of a network and the moves that its robot may make between them.

    Shortest ways over the moves are those of the network. Of `OUTSIDE` the map knows nothing, so
    that no walk leads through it.

    Parameters
    ----------
    storey : only this one, with no ride, as those lead away
    storeyless : name of the storey of places that have none

    Raises
    ------
    ExchangeError
        There is no such storey.
    """
    topology = network.topology
    stands = [
        Stand(c, side, _storey(topology, c, side) or storeyless, _elevator(topology, c, side))
        for c in network.connectors
        for side in (0, 1)
    ]
    kept = list(range(len(stands)))
    if storey is not None:
        known = dict.fromkeys(p.storey or storeyless for p in topology.places.values())
        if storey not in known:
            raise ExchangeError(f"there is no storey {storey}; there are: {', '.join(known)}")
        kept = [n for n in kept if stands[n].storey == storey]
    number = {node: i for i, node in enumerate(kept)}
    moves = []
    for edge, (tail, head) in enumerate(zip(network.tails, network.heads, strict=True)):
        start, end, seconds = int(tail), int(head), float(network.seconds[edge])
        if start not in number or end not in number or math.isinf(seconds):
            continue
        a, b = number[start], number[end]
        if edge in network.rides:
            moves.append(Move(a, b, "ride", seconds, elevator=network.rides[edge]))
        elif edge < len(stands):  # passages come first
            into = stands[end].elevator if stands[end].elevator != stands[start].elevator else None
            moves.append(Move(a, b, "passage", seconds, stands[start].connector, into))
        elif stands[start].place != OUTSIDE:
            moves.append(Move(a, b, "walk", seconds))
    return Stands(tuple(stands[n] for n in kept), tuple(moves))


def with_middles(made: Stands, outlines: Mapping[str, Outline], speed: float) -> Stands:
    """A waypoint more in each place, under its name, that walks join with the place's stands."""
    stands, moves = list(made.stands), list(made.moves)
    for place, numbers in _inside(made).items():
        if stands[numbers[0]].elevator is not None:
            continue
        points = np.array([stands[n].point for n in numbers])
        outline = outlines.get(place)
        x, y = points[:, :2].mean(axis=0)
        if outline is not None:
            middle = outline.centroid
            if not outline.contains(middle):
                middle = outline.representative_point()
            x, y = middle.x, middle.y
        z = float(points[0, 2])
        number = len(stands)
        stands.append(Waypoint(place, place, stands[numbers[0]].storey, (float(x), float(y), z)))
        for n in numbers:
            seconds = math.dist(stands[n].point, stands[number].point) / speed
            moves += [Move(n, number, "walk", seconds), Move(number, n, "walk", seconds)]
    return Stands(tuple(stands), tuple(moves))


def around_corners(made: Stands, outlines: Mapping[str, Outline], speed: float) -> Stands:
    """Walks that would lead through a wall of their place, led over waypoints at its corners.

    A stretch between corners takes its length at `speed`, or more as the walks over it do: of
    several the least. Walks that stay inside, and places without outline, are left as they are.
    """
    stands = list(made.stands)
    bent: dict[tuple[int, int], list[int]] = {}
    for place, numbers in _inside(made).items():
        if place not in outlines:
            continue
        ways = ways_around(outlines[place], np.array([stands[n].point[:2] for n in numbers]))
        used = sorted({c for way in ways.between.values() for c in way})
        first, z = stands[numbers[0]], stands[numbers[0]].point[2]
        at = {}
        for count, corner in enumerate(used, 1):
            x, y = ways.corners[corner]
            at[corner] = len(stands)
            stands.append(
                Waypoint(f"{place}#{count}", place, first.storey, (float(x), float(y), z))
            )
        for (i, j), way in ways.between.items():
            if way:
                bent[numbers[i], numbers[j]] = [at[c] for c in way]
                bent[numbers[j], numbers[i]] = [at[c] for c in reversed(way)]
    moves = []
    legs: dict[tuple[int, int], float] = {}
    for move in made.moves:
        over = bent.get((move.start, move.end)) if move.kind == "walk" else None
        if over is None:
            moves.append(move)
            continue
        steps = list(pairwise([move.start, *over, move.end]))
        metres = [math.dist(stands[a].point, stands[b].point) for a, b in steps]
        pace = max(move.seconds / sum(metres), 1 / speed)
        for step, length in zip(steps, metres, strict=True):
            legs[step] = min(legs.get(step, math.inf), pace * length)
    moves += [Move(a, b, "walk", seconds) for (a, b), seconds in legs.items()]
    return Stands(tuple(stands), tuple(moves))


def _inside(made: Stands) -> dict[str, list[int]]:
    """The stands of each place that is drawn, by number."""
    inside: dict[str, list[int]] = {}
    for number, stand in enumerate(made.stands):
        if stand.place != OUTSIDE:
            inside.setdefault(stand.place, []).append(number)
    return inside


def _storey(topology: Topology, connector: Connector, side: int) -> str | None:
    """That of the place, or of the place on the other side: a door to the outside has one."""
    here, there = (topology.places[connector.places[s]] for s in (side, 1 - side))
    return here.storey or (there.storey if here.name == OUTSIDE else None)


def _elevator(topology: Topology, connector: Connector, side: int) -> str | None:
    return topology.places[connector.places[side]].elevator
