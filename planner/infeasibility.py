"""The reason why no route exists: what blocks the route that needs the fewest blocked edges."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.graph import Graph
from planner.routing_graph import Endpoint, RoutingGraph
from planner.topology import OUTSIDE

_BLOCKED = 1e9  # seconds that a blocked passage costs here

ADD_ONE = "; add the connector that is missing"
"""The advice where nothing joins two places."""


def infeasibility(graph: RoutingGraph, start: Endpoint, goal: Endpoint) -> str:
    """Why no route leads from one endpoint to the other, in words, with the graph's penalties.

    It names the blocked edges of the route that needs the fewest of them, and the doors that would
    make one if they were at their rooms.
    """
    reason = _reason(graph, start, goal)
    astray = _astray_on_way(graph, start.place, goal.place)
    if not astray:
        return reason
    one = len(astray) == 1
    doors = f"{', '.join(astray)} would join them, but {'is' if one else 'are'} not at"
    return f"{reason}; {doors} {'its' if one else 'their'} rooms: semmap check says how far"


def _astray_on_way(graph: RoutingGraph, start: str, goal: str) -> list[str]:
    """The fewest doors that, at their rooms, would make a way from place to place for the robot."""
    topology = graph.topology
    numbers = {name: k for k, name in enumerate({**topology.places, OUTSIDE: None})}
    ways = [
        (door.places[side], door.places[1 - side], "")
        for door in topology.connectors.values()
        for side in (0, 1)
        if OUTSIDE not in door.places and graph.robot.blocking_reason(door, side) is None
    ]
    for cabins in topology.cabins().values() if graph.robot.rides_elevators else ():
        ways += [(a, b, "") for a in cabins for b in cabins]
    for name, (a, b) in topology.astray.items():
        if a in topology.places and b in topology.places and OUTSIDE not in (a, b):
            ways += [(a, b, name), (b, a, name)]
    tails, heads = ([numbers[way[end]] for way in ways] for end in (0, 1))
    found = Graph(tails, heads, [float(bool(name)) for *_, name in ways], len(numbers)).shortest(
        [(numbers[start], 0.0)], [(numbers[goal], 0.0)]
    )
    return [] if found is None else [name for k in found[1] if (name := ways[int(k)][2])]


def _reason(graph: RoutingGraph, start: Endpoint, goal: Endpoint) -> str:
    robot = graph.robot
    message = f"no route from {start.place} to {goal.place}"
    if start.place == goal.place and start.pose is not None and goal.pose is not None:
        a, b = (f"({p.x:.2f}, {p.y:.2f})" for p in (start.pose, goal.pose))
        hint = robot.folding_hint
        return f"{message}: {robot.name} finds no path in {start.place} from {a} to {b}{hint}"
    for place in (start.place, goal.place):
        if not len(graph.nodes.get(place, ())):
            return f"{message}: {place} has no door; add a connector that joins it"
    for endpoint in (start, goal):
        if endpoint.pose is not None and np.isinf(endpoint.seconds).all():
            x, y = endpoint.pose.x, endpoint.pose.y
            there = f"from ({x:.2f}, {y:.2f}) in {endpoint.place}"
            return f"{message}: {there} {robot.name} reaches none of its doors"
    blocked = _blocked_edges(graph)
    weights = graph.base.copy()
    for edge, (_, more) in blocked.items():
        weights[edge] = more if math.isinf(weights[edge]) else weights[edge] + more
    tails, heads = graph.arcs
    relaxed = Graph(tails, heads, weights, 2 * len(graph.poses))
    path = relaxed.shortest(*graph.path_ends(_relaxed(start), _relaxed(goal)))
    if path is None:
        ride = "" if robot.rides_elevators else " without an elevator (behaviour use_elevator)"
        return f"{message}: nothing joins them{ride}{ADD_ONE}"
    edges = [int(e) for e in path[1]]
    reasons = dict.fromkeys(blocked[e][0] for e in edges if e in blocked)
    if edges:
        ends = (start, int(graph.tails[edges[0]])), (goal, int(graph.heads[edges[-1]]))
        reasons |= dict.fromkeys(filter(None, (_no_path_at_end(graph, *end) for end in ends)))
    hint = robot.folding_hint if any(" finds no path " in reason for reason in reasons) else ""
    return f"{message}: {'; '.join(reasons)}{hint}"


def _blocked_edges(graph: RoutingGraph) -> dict[int, tuple[str, float]]:
    """The blocked edges: each with the reason, and the seconds that using it costs here."""
    blocked: dict[int, tuple[str, float]] = {}
    for node in range(2 * len(graph.connectors)):
        reason = graph.robot.blocking_reason(graph.connectors[node // 2], node % 2)
        reason = reason or graph.obstruction(node)
        if reason is not None:
            blocked[node] = reason, _BLOCKED
    for place, edges in graph.travel_edges.items():
        for edge in range(edges.start, edges.stop):
            if math.isfinite(graph.seconds[edge]):
                continue
            a, b = (graph.connectors[nodes[edge] // 2].name for nodes in (graph.tails, graph.heads))
            if place == OUTSIDE:
                reason = f"{a} leads outside, which the map does not describe"
                blocked[edge] = reason, 100 * _BLOCKED
            else:
                blocked[edge] = _no_path(graph, place, a, b), 10 * _BLOCKED
    for edge, reason in graph.cut_rides.items():
        blocked[edge] = reason, 10 * _BLOCKED
    for edge, reason in graph.penalties.blocked.items():
        before, more = blocked.get(edge, (reason, 0.0))
        blocked[edge] = before, more + _BLOCKED
    return blocked


def _relaxed(endpoint: Endpoint) -> Endpoint:
    """An endpoint with paths to all doors of its place, long ones where there are none."""
    return replace(endpoint, seconds=np.minimum(endpoint.seconds, 10 * _BLOCKED))


def _no_path(graph: RoutingGraph, place: str, a: str, b: str) -> str:
    """That no path leads through a place, from a door to another or to a point."""
    if not graph.costs.has_outline(place):
        return f"the map has no outline of {place}, so no floor to drive on"
    return f"{graph.robot.name} finds no path in {place} from {a} to {b}"


def _no_path_at_end(graph: RoutingGraph, endpoint: Endpoint, node: int) -> str | None:
    """That no path leads from an endpoint to a door of its place; None if one does."""
    if np.isfinite(endpoint.seconds[endpoint.nodes == node]).all():
        return None
    if endpoint.pose is None:
        return graph.costs.obstruction(endpoint.place, graph.poses[node])
    x, y, door = endpoint.pose.x, endpoint.pose.y, graph.connectors[node // 2].name
    return _no_path(graph, endpoint.place, door, f"({x:.2f}, {y:.2f})")
