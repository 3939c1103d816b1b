"""The shortest way from place to place: which connectors to pass, in order, and how.

The doors of a place are joined by the way between the poses before them, so that of two doors to
one corridor the nearer is taken (Deeken et al., section 4.1 and Figure 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise, permutations, product
from typing import Any, NamedTuple

import networkx as nx

from planner.topology import OUTSIDE, Connector, Topology
from semmap.geometry.pose import Pose

__all__ = ["Costs", "NoRouteError", "Route", "Step", "route"]

Point = tuple[float, ...]
Walk = Callable[[str, Point, Point], float]


@dataclass(frozen=True)
class Costs:
    """What a way costs beside the metres walked, all in metres that one would rather walk.

    Attributes
    ----------
    ride : calling an elevator and riding it once
    ride_per_metre : each metre of height that the ride overcomes
    closed : opening a closed connector
    locked : unlocking a locked one, where locked ones are allowed
    """

    ride: float = 15.0
    ride_per_metre: float = 1.0
    closed: float = 2.0
    locked: float = 10.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < math.inf or (name == "ride" and value == 0):
                raise ValueError(f"costs: {name} is {value}; give a finite number above zero")


@dataclass(frozen=True)
class Step:
    """One behaviour of the robot on its way.

    Attributes
    ----------
    behaviour : pass_door, call_elevator, use_elevator, or what the connector names
    from_place, to_place : where the robot is before and after; equal for call_elevator
    connector : what it passes or stands before; None for use_elevator
    elevator : the elevator that it calls or uses
    approach : pose in the map's frame at which the step begins, facing the connector
    leave : pose at which it ends: for a passage, the pose behind the connector, turned away from it
    """

    behaviour: str
    from_place: str
    to_place: str
    connector: Connector | None
    elevator: str | None
    approach: Pose
    leave: Pose


@dataclass(frozen=True)
class Route:
    """Steps in order; `cost` in metres (see `Costs`), `walked` the metres walked in places."""

    start: str
    goal: str
    steps: tuple[Step, ...]
    cost: float
    walked: float

    @property
    def doors(self) -> list[Step]:
        """The passages alone: one step for each connector passed."""
        return [s for s in self.steps if s.connector is not None and s.from_place != s.to_place]


class NoRouteError(ValueError):
    """No way leads there; the message says which connector would open one."""


class _Node(NamedTuple):
    """Standing before a connector, in the place on one of its sides; start and goal beside."""

    connector: str
    side: int


def _ridden(node: _Node) -> _Node:
    """Before that connector, having just ridden there: what follows is no other walk or ride."""
    return _Node(node.connector, node.side + 2)


_START, _GOAL = _Node("start", -1), _Node("goal", -1)

Obstacle = Callable[[Connector, int], str | None]


def straight(place: str, a: Point, b: Point) -> float:
    """The distance of two points (x, y, z) of a place, as the crow flies."""
    return math.dist(a, b)


def route(
    topology: Topology,
    start: str,
    goal: str,
    *,
    start_point: Point | None = None,
    goal_point: Point | None = None,
    allow_closed: bool = True,
    allow_locked: bool = False,
    allow_outside: bool = False,
    behaviours: Collection[str] | None = None,
    costs: Costs | None = None,
    walk: Walk = straight,
) -> Route:
    """The cheapest route from one place to another.

    Parameters
    ----------
    start_point, goal_point : (x, y, z) in the map's frame, metres
        Where in the place the robot stands and wants to be; without it, any door is equally near.
    allow_closed, allow_locked
        Whether the robot can open closed and unlock locked connectors.
    allow_outside
        Whether a way may lead through `OUTSIDE`, of which the map knows nothing. As start or goal
        it is always allowed.
    behaviours
        What the robot is able to do (riding an elevator takes ``use_elevator``); it passes no
        connector that needs another behaviour. None: everything.
    walk
        Cost in metres of the way between two points of a place, by default the straight distance.

    Raises
    ------
    UnknownPlaceError, NoRouteError

    Examples
    --------
    >>> from planner.topology import Connector, Place, Topology
    >>> door = Connector("door1", ("lab", "hall"), (Pose.planar(1, 0), Pose.planar(3, 0, math.pi)))
    >>> found = route(Topology.of([Place("lab"), Place("hall")], [door]), "lab", "hall")
    >>> [(step.behaviour, step.connector.name) for step in found.steps]
    [('pass_door', 'door1')]
    """
    topology.place(start), topology.place(goal)
    costs = costs or Costs()
    if start == goal:
        inside = walk(start, start_point, goal_point) if start_point and goal_point else 0.0
        return Route(start, goal, (), inside, inside)

    def obstacle(connector: Connector, side: int) -> str | None:
        """What forbids passing the connector from that side."""
        here, there = connector.places[side], connector.places[1 - side]
        if connector.state == "locked" and not allow_locked:
            return f"{connector.name} is locked"
        if connector.state == "closed" and not allow_closed:
            return f"{connector.name} is closed"
        if not connector.passes(side):
            return f"{connector.name} leads only from {there} to {here}"
        if behaviours is not None and connector.behaviour not in behaviours:
            return f"{connector.name} needs the behaviour {connector.behaviour}"
        if there == OUTSIDE and goal != OUTSIDE and not allow_outside:
            return f"{connector.name} leads outside, of which the map knows nothing"
        return None

    rides = behaviours is None or "use_elevator" in behaviours
    graph = _search_graph(topology, start, goal, start_point, goal_point, costs, walk, rides)
    way = _shortest(graph, obstacle, math.inf)
    if way is None:
        raise NoRouteError(_why_not(topology, graph, start, goal, obstacle, rides))
    edges = [graph.edges[a, b] for a, b in pairwise(way)]
    cost = math.fsum(edge["walked"] + edge["extra"] for edge in edges)
    walked = math.fsum(edge["walked"] for edge in edges)
    return Route(start, goal, tuple(_steps(topology, edges)), cost, walked)


def _search_graph(
    topology: Topology,
    start: str,
    goal: str,
    start_point: Point | None,
    goal_point: Point | None,
    costs: Costs,
    walk: Walk,
    rides: bool,
) -> nx.DiGraph:
    """The poses before connectors; joined by walks inside a place, passages and rides."""
    graph = nx.DiGraph()
    graph.add_nodes_from((_START, _GOAL))
    doors: dict[str, list[tuple[_Node, Point]]] = {name: [] for name in topology.places}
    for c in topology.connectors.values():
        for side in (0, 1):
            doors[c.places[side]].append((_Node(c.name, side), _point(c.poses[side])))

    for place, poses in doors.items():
        for a, p in poses:
            for b, q in poses:
                if a != b:
                    graph.add_edge(a, b, walked=walk(place, p, q), extra=0.0)
    if rides:
        for elevator, cabins in topology.cabins().items():
            for here, there in permutations(cabins, 2):
                for (a, p), (b, q) in product(doors[here], doors[there]):
                    extra = costs.ride + costs.ride_per_metre * abs(p[2] - q[2])
                    graph.add_edge(a, _ridden(b), walked=0.0, extra=extra, rides=(elevator, a, b))
    for c in topology.connectors.values():
        extra = {"open": 0.0, "closed": costs.closed, "locked": costs.locked}[c.state]
        through = math.dist(_point(c.poses[0]), _point(c.poses[1]))
        for side in (0, 1):
            a, b = _Node(c.name, side), _Node(c.name, 1 - side)
            for begin in (a, _ridden(a)):
                graph.add_edge(begin, b, walked=through, extra=extra, passes=(c, side))
    for node, p in doors[start]:
        graph.add_edge(
            _START, node, walked=walk(start, start_point, p) if start_point else 0.0, extra=0.0
        )
    for node, p in doors[goal]:
        rest = walk(goal, p, goal_point) if goal_point else 0.0
        for end in (node, _ridden(node)):
            graph.add_edge(end, _GOAL, walked=rest, extra=0.0)
    return graph


def _point(pose: Pose) -> Point:
    return (pose.x, pose.y, pose.z)


def _shortest(graph: nx.DiGraph, obstacle: Obstacle, penalty: float) -> list[_Node] | None:
    """The cheapest way from start to goal; a forbidden passage costs `penalty` metres more."""

    def weight(a: _Node, b: _Node, edge: dict[str, Any]) -> float | None:
        cost: float = edge["walked"] + edge["extra"]
        if "passes" in edge and obstacle(*edge["passes"]) is not None:
            c, side = edge["passes"]
            worst = 100.0 if c.places[1 - side] == OUTSIDE else 1.0
            return None if math.isinf(penalty) else cost + worst * penalty
        return cost

    try:
        way: list[_Node] = nx.dijkstra_path(graph, _START, _GOAL, weight=weight)
    except nx.NetworkXNoPath:
        return None
    return way


def _steps(topology: Topology, edges: list[dict[str, Any]]) -> Iterator[Step]:
    """What the robot does along the edges of a way; walks need no step of their own."""
    for edge in edges:
        if "rides" in edge:
            elevator, a, b = edge["rides"]
            first, last = topology.connectors[a.connector], topology.connectors[b.connector]
            yield Step(
                "use_elevator",
                first.places[a.side],
                last.places[b.side],
                None,
                elevator,
                _turned(first.poses[a.side]),
                last.poses[b.side],
            )
        elif "passes" in edge:
            connector, side = edge["passes"]
            here, there = connector.places[side], connector.places[1 - side]
            approach, behind = connector.poses[side], connector.poses[1 - side]
            elevator = topology.places[there].elevator
            if elevator is not None and topology.places[here].elevator != elevator:
                yield Step("call_elevator", here, here, connector, elevator, approach, approach)
            behaviour = connector.behaviour
            if behaviour == "call_elevator":  # what is left to do once it came
                behaviour = "pass_door"
            yield Step(behaviour, here, there, connector, None, approach, _turned(behind))


def _turned(pose: Pose) -> Pose:
    """The pose turned by half a turn about its own z axis; its quaternion with w >= 0."""
    back = pose @ Pose(qz=1.0, qw=0.0)
    if back.qw >= 0:
        return back
    return Pose(back.x, back.y, back.z, -back.qx, -back.qy, -back.qz, -back.qw)


def _why_not(
    topology: Topology,
    graph: nx.DiGraph,
    start: str,
    goal: str,
    obstacle: Obstacle,
    rides: bool,
) -> str:
    """Which forbidden passages the way with the fewest of them would need."""
    way = _shortest(graph, obstacle, 1e9)
    if way is None:
        for place in (start, goal):
            if not topology.doors_of(place):
                return (
                    f"no route from {start} to {goal}: {place} has no door; "
                    "add a connector that joins it"
                )
        lift = "" if rides else " without riding an elevator (behaviour use_elevator)"
        return (
            f"no route from {start} to {goal}: nothing joins them{lift}; "
            "add the connector that is missing"
        )
    passed = [graph.edges[a, b].get("passes") for a, b in pairwise(way)]
    reasons = [reason for p in passed if p is not None and (reason := obstacle(*p)) is not None]
    return f"no route from {start} to {goal}: {'; '.join(reasons)}"
