"""The quickest routes between endpoints of a routing graph."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.infeasibility import infeasibility
from planner.route import NoRouteError, Route
from planner.route_steps import steps_along
from planner.routing_graph import Edges, Endpoint, RoutingGraph


def seconds_between(
    graph: RoutingGraph, starts: Sequence[Endpoint], goals: Sequence[Endpoint]
) -> NDArray[np.float64]:
    """(n, m) seconds from each start to each goal; infinite where no route exists."""
    found = np.full((len(starts), len(goals)), math.inf)
    if not starts or not goals:
        return found
    departures = [graph.departures(s) for s in starts]
    arrivals = [graph.arrivals(g) for g in goals]
    sources, targets = (
        np.unique(np.concatenate([nodes for nodes, _ in ends])) for ends in (departures, arrivals)
    )
    distances = graph.graph.distances(sources, targets)
    columns = [np.searchsorted(targets, nodes) for nodes, _ in arrivals]
    for i, start in enumerate(starts):
        nodes, seconds = departures[i]
        away = distances[np.searchsorted(sources, nodes)] + seconds[:, None]
        nearest = away.min(axis=0, initial=math.inf)
        for j, goal in enumerate(goals):
            found[i, j] = (nearest[columns[j]] + arrivals[j][1]).min(initial=math.inf)
            if start.place == goal.place:
                found[i, j] = min(found[i, j], _inside(graph, start, goal)[0])
    return found


def find_route(graph: RoutingGraph, start: Endpoint, goal: Endpoint) -> Route:
    """The route that takes the least time; raises NoRouteError, which says what blocks it."""
    inside = _inside(graph, start, goal) if start.place == goal.place else (math.inf, math.inf)
    path = graph.graph.shortest(*graph.path_ends(start, goal))
    if path is None and math.isinf(inside[0]):
        raise NoRouteError(infeasibility(graph, start, goal))
    if path is None or inside[0] <= path[0]:
        return _route_inside(graph, start, goal, inside)
    return _route_along(graph, start, goal, path[1])


def find_alternatives(graph: RoutingGraph, start: Endpoint, goal: Endpoint, k: int) -> list[Route]:
    """The k quickest routes, the quickest first, or all if there are fewer.

    No route visits an approach pose twice, and no two routes pass the same connectors and ride the
    same elevators in the same order.
    """
    found: dict[tuple[object, ...], Route] = {}
    wanted, more = k, True
    while more and len(found) < k:
        paths = graph.graph.alternatives(*graph.path_ends(start, goal), wanted)
        for _, edges in paths:
            found.setdefault(_transitions(graph, edges), _route_along(graph, start, goal, edges))
        more, wanted = len(paths) == wanted, 2 * wanted
    if start.place == goal.place:
        inside = _inside(graph, start, goal)
        if inside[0] < (found[()].seconds if () in found else math.inf):
            found[()] = _route_inside(graph, start, goal, inside)
    return sorted(found.values(), key=lambda r: r.seconds)[:k]


def _transitions(graph: RoutingGraph, edges: Edges) -> tuple[object, ...]:
    """The passages among edges, and each ride with the cabin to which it leads."""
    passages = 2 * len(graph.connectors)
    return tuple(
        int(e) if e < passages else (graph.rides[int(e)], graph.place_of[int(graph.heads[e])])
        for e in edges
        if e < passages or int(e) in graph.rides
    )


def _inside(graph: RoutingGraph, start: Endpoint, goal: Endpoint) -> tuple[float, float]:
    """Seconds and metres from pose to pose inside one place."""
    if start.pose is None or goal.pose is None:
        return 0.0, 0.0
    travel = graph.costs.between(start.place, [start.pose], [goal.pose])
    return float(travel.seconds[0, 0]), float(travel.metres[0, 0])


def _route_inside(
    graph: RoutingGraph, start: Endpoint, goal: Endpoint, inside: tuple[float, float]
) -> Route:
    steps = steps_along(graph, start, goal, (), None, inside)
    return Route(start.place, goal.place, steps, *inside)


def _route_along(graph: RoutingGraph, start: Endpoint, goal: Endpoint, edges: Edges) -> Route:
    if len(edges):
        first, last = int(graph.tails[edges[0]]), int(graph.heads[edges[-1]])
    else:
        first = last = _shared_node(start, goal)
    i, j = (int(np.flatnonzero(e.nodes == n)[0]) for e, n in ((start, first), (goal, last)))
    seconds = math.fsum([start.seconds[i], *graph.seconds[list(edges)], goal.seconds[j]])
    metres = math.fsum([start.metres[i], *graph.metres[list(edges)], goal.metres[j]])
    steps = steps_along(graph, start, goal, edges, (i, j), (seconds, metres))
    return Route(start.place, goal.place, steps, seconds, metres)


def _shared_node(start: Endpoint, goal: Endpoint) -> int:
    """The approach pose over which the path from start to goal without edges is shortest."""
    from_start = dict(zip(start.nodes.tolist(), start.seconds.tolist(), strict=True))
    to_goal = dict(zip(goal.nodes.tolist(), goal.seconds.tolist(), strict=True))
    shared = (n for n in to_goal if n in from_start)
    return int(min(shared, key=lambda n: from_start[n] + to_goal[n]))
