"""Routes on a graph that people drew: a Nav2 route graph, or the lanes of an Open-RMF building.

The robot drives along the drawn edges alone, from the node of its place that is nearest to its
start to the one nearest to the goal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np
import shapely

from planner.graph import Graph
from planner.route import NoRouteError, Route, RouteStep
from planner.route_search import make_step, passage_steps
from planner.routing_graph import Endpoint, RoutingGraph
from semmap.geometry.pose import Pose


@dataclass(frozen=True)
class DrawnNode:
    """A node: its name, its place, and its position in the map's frame, metres."""

    name: str
    place: str
    x: float
    y: float
    z: float

    @property
    def point(self) -> tuple[float, float, float]:
        """The position."""
        return self.x, self.y, self.z


@dataclass(frozen=True)
class DrawnEdge:
    """An edge in one direction, between nodes by name; None: the graph does not state it."""

    start: str
    end: str
    seconds: float | None = None  # its least duration
    speed_limit: float | None = None  # m/s
    connector: str | None = None
    elevator: str | None = None


@dataclass(frozen=True)
class DrawnGraph:
    """Nodes by name, and edges between them."""

    nodes: Mapping[str, DrawnNode]
    edges: Sequence[DrawnEdge]


@dataclass(frozen=True)
class _Move:
    """An edge as one robot takes it; `passage` is the number of the edge of its routing graph."""

    start: DrawnNode
    end: DrawnNode
    seconds: float
    passage: int | None = None
    elevator: str | None = None

    @property
    def metres(self) -> float:
        return 0.0 if self.elevator else math.dist(self.start.point, self.end.point)


def find_drawn_route(
    drawn: DrawnGraph, graph: RoutingGraph, starts: Sequence[Endpoint], goals: Sequence[Endpoint]
) -> Route:
    """The route on a drawn graph that takes the least time, from any start to any goal.

    Connectors that the robot of `graph` cannot pass now are closed on the drawn graph, too. Raises
    NoRouteError: the drawn graph has no node in the place of a start or of a goal, or does not join
    them.
    """
    first, last = _legs(drawn, graph, starts, "begins"), _legs(drawn, graph, goals, "ends")
    number = {name: i for i, name in enumerate(drawn.nodes)}
    moves = [*_moves(drawn, graph)]
    tails, heads = ([number[getattr(m, end).name] for m in moves] for end in ("start", "end"))
    roads = Graph(tails, heads, [m.seconds for m in moves], len(number))
    ends = ([(number[name], leg.seconds) for name, leg in legs.items()] for legs in (first, last))
    path = roads.shortest(*ends)
    if path is None:
        raise NoRouteError(
            f"the drawn graph does not lead from {starts[0].place} to {goals[0].place} for "
            f"{graph.robot.name}"
        )
    taken = [moves[edge] for edge in path[1]]
    shared = sorted(first.keys() & last.keys(), key=lambda n: first[n].seconds + last[n].seconds)
    begin = first[taken[0].start.name if taken else shared[0]]
    end = last[taken[-1].end.name if taken else shared[0]]
    seconds, metres = (
        math.fsum(getattr(each, what) for each in (begin, *taken, end))
        for what in ("seconds", "metres")
    )
    steps = tuple(_steps(graph, begin, taken, end))
    return Route(begin.end.place, end.end.place, steps, seconds, metres)


def _moves(drawn: DrawnGraph, graph: RoutingGraph) -> Iterator[_Move]:
    """The edges that the robot can take, and rides between nodes in the cabins of an elevator."""
    speed, blocked = graph.robot.speed, graph.penalties.blocked
    for edge in drawn.edges:
        start, end = drawn.nodes.get(edge.start), drawn.nodes.get(edge.end)
        if start is None or end is None or edge.elevator is not None:
            continue
        metres = math.dist(start.point, end.point)
        seconds = metres / min(speed, edge.speed_limit or speed)
        number = _passage(graph, edge, start, end)
        if number is not None:
            if math.isinf(graph.seconds[number]) or number in blocked:
                continue
            connector = graph.connectors[number // 2]
            drive = connector.metres / speed
            seconds += max(float(graph.seconds[number]) - drive, 0.0)
            seconds += graph.penalties.seconds.get(number, 0.0)
        yield _Move(start, end, max(seconds, edge.seconds or 0.0), number)
    if graph.robot.rides_elevators:
        cabins: dict[str, list[DrawnNode]] = {}
        for node in drawn.nodes.values():
            elevator = graph.topology.places[node.place].elevator
            if elevator is not None:
                cabins.setdefault(elevator, []).append(node)
        for elevator, nodes in cabins.items():
            for a, b in permutations(nodes, 2):
                if a.place != b.place:
                    seconds = graph.durations.of_riding(elevator, abs(a.z - b.z))
                    yield _Move(a, b, seconds, elevator=elevator)


def _passage(graph: RoutingGraph, edge: DrawnEdge, start: DrawnNode, end: DrawnNode) -> int | None:
    """The number of the passage that an edge takes: of the stated connector, or the crossed one."""
    here = graph.topology.connectors_of(start.place)
    joining = [(c, s) for c, s in here if c.places[1 - s] == end.place]
    leaves = start.place != end.place  # of a passage in pieces, one does
    stated = [(c, s) for c, s in (here if leaves else joining) if c.name == edge.connector]
    line = shapely.LineString([start.point[:2], end.point[:2]])
    found = stated or [(c, s) for c, s in joining if leaves or c.leaf().intersects(line)]
    if not found:
        return None
    ways = [
        (c.leaf().distance(line), math.dist(c.poses[s][:3], start.point), c, s) for c, s in found
    ]
    _, _, connector, side = min(ways, key=lambda way: way[:2])
    return 2 * graph.index[connector.name] + side


class _Leg(NamedTuple):
    """The drive between an end of a route and a node in its place."""

    end: Endpoint
    seconds: float
    metres: float


def _legs(
    drawn: DrawnGraph, graph: RoutingGraph, ends: Sequence[Endpoint], verb: str
) -> dict[str, _Leg]:
    """The quickest leg to each node that is the nearest to an end in its place.

    Of a whole place, all its nodes are.
    """
    found: dict[str, _Leg] = {}
    for end in ends:
        nodes = [node for node in drawn.nodes.values() if node.place == end.place]
        if not nodes:
            raise NoRouteError(
                f"the drawn graph has no node in {end.place}, where the route {verb}: draw one, or "
                "plan without drawn=True"
            )
        if end.pose is None:
            found |= {node.name: _Leg(end, 0.0, 0.0) for node in nodes}
            continue
        travel = graph.costs.between(end.place, [end.pose], [Pose(*node.point) for node in nodes])
        seconds, metres = travel.seconds[0], travel.metres[0]
        nearest = int(np.argmin(seconds))
        if not np.isfinite(seconds[nearest]):
            raise NoRouteError(
                f"{graph.robot.name} reaches no node of the drawn graph in {end.place}, where the "
                f"route {verb}"
            )
        leg = _Leg(end, float(seconds[nearest]), float(metres[nearest]))
        known = found.setdefault(nodes[nearest].name, leg)
        found[nodes[nearest].name] = min(known, leg, key=lambda each: each.seconds)
    return found


def _steps(
    graph: RoutingGraph, begin: _Leg, moves: Sequence[_Move], end: _Leg
) -> Iterator[RouteStep]:
    """A step for each part that has a length, and what doors and elevators need."""
    at, place = begin.end.pose, begin.end.place
    if moves:
        there = _towards(moves[0].start, moves[0].end, ahead=True)
        if begin.metres > 0:
            yield make_step(graph, "navigate", place, place, at, there, *begin[1:])
        for move in moves:
            yield from _steps_of(graph, move)
        at, place = _towards(moves[-1].end, moves[-1].start), end.end.place
    if end.end.pose is not None and end.metres > 0:
        yield make_step(graph, "navigate", place, place, at, end.end.pose, *end[1:])


def _towards(node: DrawnNode, other: DrawnNode, *, ahead: bool = False) -> Pose:
    """The pose at a node with the heading of the drive from, or ahead to, another one."""
    dx, dy = (other.x - node.x, other.y - node.y) if ahead else (node.x - other.x, node.y - other.y)
    return Pose.planar(node.x, node.y, math.atan2(dy, dx), node.z)


def _steps_of(graph: RoutingGraph, move: _Move) -> Iterator[RouteStep]:
    here, there = move.start.place, move.end.place
    a, b = _towards(move.start, move.end, ahead=True), _towards(move.end, move.start)
    if move.elevator is not None:
        yield make_step(
            graph, "use_elevator", here, there, a, b, move.seconds, elevator=move.elevator
        )
        yield make_step(graph, "switch_map", there, there, b, b)
        return
    if move.passage is None:
        yield make_step(graph, "navigate", here, there, a, b, move.seconds, move.metres)
        return
    yield from passage_steps(graph, move.passage, a, b, move.metres, move.seconds)
