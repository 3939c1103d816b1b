"""Routes on a graph that people drew: a Nav2 route graph, or the lanes of an Open-RMF building.

The robot drives along the drawn edges alone, from the node of its place that is nearest to its
start to the one nearest to the goal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations

import networkx as nx
import numpy as np
import shapely

from planner.route import NoRouteError, Route, RouteStep
from planner.route_search import make_step, passage_steps
from planner.routing_graph import Endpoint, RoutingGraph
from semmap.geometry.pose import Pose

START, GOAL = ("start",), ("goal",)  # the ends of a route among the names of nodes


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
    moves = nx.DiGraph()
    for move in _moves(drawn, graph):
        pair = move.start.name, move.end.name
        if move.seconds < moves.get_edge_data(*pair, {"seconds": math.inf})["seconds"]:
            moves.add_edge(*pair, seconds=move.seconds, move=move)
    for end in starts:
        for name, seconds, metres in _nearest_nodes(drawn, graph, end, "begins"):
            moves.add_edge(START, name, seconds=seconds, metres=metres, endpoint=end)
    for end in goals:
        for name, seconds, metres in _nearest_nodes(drawn, graph, end, "ends"):
            moves.add_edge(name, GOAL, seconds=seconds, metres=metres, endpoint=end)
    try:
        path = nx.dijkstra_path(moves, START, GOAL, weight="seconds")
    except nx.NetworkXNoPath:
        raise NoRouteError(
            f"the drawn graph does not lead from {starts[0].place} to {goals[0].place} for "
            f"{graph.robot.name}"
        ) from None
    edges = [moves.edges[pair] for pair in pairwise(path)]
    start, goal = edges[0]["endpoint"], edges[-1]["endpoint"]
    steps = _steps(graph, drawn, start, goal, edges)
    metres = math.fsum(e["move"].metres if "move" in e else e["metres"] for e in edges)
    return Route(
        start.place, goal.place, tuple(steps), math.fsum(e["seconds"] for e in edges), metres
    )


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
    stated = [(c, s) for c, s in here if c.name == edge.connector]
    line = shapely.LineString([start.point[:2], end.point[:2]])
    found = stated or [
        (c, s) for c, s in joining if start.place != end.place or c.leaf().intersects(line)
    ]
    if not found:
        return None
    ways = [
        (c.leaf().distance(line), math.dist(c.poses[s][:3], start.point), c, s) for c, s in found
    ]
    _, _, connector, side = min(ways, key=lambda way: way[:2])
    return 2 * graph.index[connector.name] + side


def _nearest_nodes(
    drawn: DrawnGraph, graph: RoutingGraph, end: Endpoint, verb: str
) -> list[tuple[str, float, float]]:
    """The node that is nearest to a pose in its place; of a whole place, all its nodes."""
    nodes = [node for node in drawn.nodes.values() if node.place == end.place]
    if not nodes:
        raise NoRouteError(
            f"the drawn graph has no node in {end.place}, where the route {verb}: draw one, or "
            "plan without drawn=True"
        )
    if end.pose is None:
        return [(node.name, 0.0, 0.0) for node in nodes]
    travel = graph.costs.between(end.place, [end.pose], [Pose(*node.point) for node in nodes])
    nearest = int(np.argmin(travel.seconds[0]))
    if not np.isfinite(travel.seconds[0, nearest]):
        raise NoRouteError(
            f"{graph.robot.name} reaches no node of the drawn graph in {end.place}, where the "
            f"route {verb}"
        )
    return [
        (nodes[nearest].name, float(travel.seconds[0, nearest]), float(travel.metres[0, nearest]))
    ]


def _steps(
    graph: RoutingGraph,
    drawn: DrawnGraph,
    start: Endpoint,
    goal: Endpoint,
    edges: Sequence[Mapping[str, object]],
) -> Iterator[RouteStep]:
    """A step for each edge that has a length, and what doors and elevators need."""
    at = start.pose
    for edge in edges:
        move = edge.get("move")
        if isinstance(move, _Move):
            yield from _steps_of(graph, move)
            at = _towards(move.end, move.start)
            continue
        seconds, metres = float(edge["seconds"]), float(edge["metres"])  # type: ignore[arg-type]
        is_last = edge is edges[-1]
        there = goal.pose if is_last else _first(drawn, edges)
        if there is not None and metres > 0:
            place = goal.place if is_last else start.place
            yield make_step(graph, "navigate", place, place, at, there, seconds, metres)
        at = there


def _first(drawn: DrawnGraph, edges: Sequence[Mapping[str, object]]) -> Pose | None:
    move = edges[1].get("move") if len(edges) > 1 else None
    return _towards(move.start, move.end, ahead=True) if isinstance(move, _Move) else None


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
