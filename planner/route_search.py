"""The quickest routes between endpoints of a routing graph, and the steps of the robot on them.

Steps are those of Deeken et al., 4.1 and Figure 4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import file_name, frame_name
from planner.infeasibility import infeasibility
from planner.route import NoRouteError, Route, RouteStep
from planner.routing_graph import Edges, Endpoint, RoutingGraph
from planner.topology import PlaceConnector
from semmap.geometry.pose import Pose


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
    steps = steps_along(graph, start, goal, edges, (i, j))
    seconds, metres = (math.fsum(getattr(s, k) for s in steps) for k in ("seconds", "metres"))
    return Route(start.place, goal.place, steps, seconds, metres)


def _shared_node(start: Endpoint, goal: Endpoint) -> int:
    """The approach pose over which the path from start to goal without edges is shortest."""
    from_start = dict(zip(start.nodes.tolist(), start.seconds.tolist(), strict=True))
    to_goal = dict(zip(goal.nodes.tolist(), goal.seconds.tolist(), strict=True))
    shared = (n for n in to_goal if n in from_start)
    return int(min(shared, key=lambda n: from_start[n] + to_goal[n]))


def steps_along(
    graph: RoutingGraph,
    start: Endpoint,
    goal: Endpoint,
    edges: Edges,
    ends: tuple[int, int] | None,
    inside: tuple[float, float] = (0.0, 0.0),
) -> tuple[RouteStep, ...]:
    """The steps that lead from one endpoint to another along edges of the graph, in order.

    `ends` are the indices of the path's first approach pose among those of the start, and of its
    last among those of the goal. They are None if the route visits none: then it takes the seconds
    and metres `inside` the place.
    """
    if ends is None:
        if goal.pose is None:
            return ()
        here = start.place
        return (make_step(graph, "navigate", here, here, start.pose, goal.pose, *inside),)
    return tuple(_along(graph, start, goal, edges, ends))


def _along(
    graph: RoutingGraph, start: Endpoint, goal: Endpoint, edges: Edges, ends: tuple[int, int]
) -> Iterator[RouteStep]:
    here, at = start.place, start.pose
    # Seconds and metres of a drive whose end is known only with the next edge. The travel to an
    # approach pose has the way that is left out where the robot stands aside of it.
    pending = np.array([start.seconds[ends[0]], start.metres[ends[0]]])
    stand = cache(graph.standing)

    def aside(node: int) -> NDArray[np.float64]:
        metres = math.dist(stand(node)[:2], graph.poses[node][:2])
        return np.array([metres / graph.robot.speed, metres])

    if start.pose is not None:
        pending -= aside(int(start.nodes[ends[0]]))
    for edge in edges:
        a, b = int(graph.tails[edge]), int(graph.heads[edge])
        takes = np.array([graph.seconds[edge], graph.metres[edge]])
        if edge in graph.rides:
            before = turned_around(stand(a))
            if at != before:
                yield make_step(graph, "navigate", here, here, at, before, *_spent(pending))
                at, pending = before, np.zeros(2)
            there, behind = graph.place_of[b], stand(b)
            across = math.dist(before[:2], behind[:2])
            takes += np.array([1 / graph.robot.speed, 1]) * (across - takes[1])
            ride = here, there, at, behind, *_spent(takes)
            yield make_step(graph, "use_elevator", *ride, elevator=graph.rides[edge])
            here, at = there, behind
            yield make_step(graph, "switch_map", here, here, at, at)
        elif edge >= 2 * len(graph.connectors):
            pending += takes - aside(a) - aside(b)
        else:
            before = stand(a)
            if at != before:
                yield make_step(graph, "navigate", here, here, at, before, *_spent(pending))
            pending = np.zeros(2)
            there, behind = graph.place_of[b], turned_around(stand(b))
            bends = graph.bends(int(edge))
            way = [before[:2], *bends, behind[:2]]
            flat = math.fsum(math.dist(p, q) for p, q in pairwise(way))
            metres = math.hypot(flat, behind.z - before.z)
            yield from passage_steps(graph, int(edge), before, behind, metres, bends=bends)
            storeys = [graph.topology.places[p].storey for p in (here, there)]
            if None not in storeys and storeys[0] != storeys[1]:
                yield make_step(graph, "switch_map", there, there, behind, behind)
            here, at = there, behind
    if goal.pose is not None:
        pending += (goal.seconds[ends[1]], goal.metres[ends[1]])
        pending -= aside(int(goal.nodes[ends[1]]))
        yield make_step(graph, "navigate", here, here, at, goal.pose, *_spent(pending))


def _spent(takes: NDArray[np.float64]) -> tuple[float, float]:
    """Seconds and metres, at least 0."""
    return float(max(takes[0], 0.0)), float(max(takes[1], 0.0))


def passage_steps(
    graph: RoutingGraph,
    node: int,
    approach: Pose,
    leave: Pose,
    metres: float,
    seconds: float | None = None,
    bends: Sequence[tuple[float, float]] = (),
) -> Iterator[RouteStep]:
    """The steps from an approach pose to the other side of its connector.

    Together they take `seconds`; by default, the passage takes what it takes such robots. Its way
    is straight but for `bends`.
    """
    connector, durations = graph.connectors[node // 2], graph.durations
    here, there = graph.place_of[node], graph.place_of[node ^ 1]
    elevator = graph.elevator_to_call(node)
    calling, opening = 0.0, durations.of_opening(connector)
    waiting = here, here, approach, approach
    if elevator is not None:
        calling = durations.of_calling(elevator)
        yield make_step(
            graph, "call_elevator", *waiting, calling, connector=connector, elevator=elevator
        )
    if connector.must_be_opened:
        name = "open_door" if connector.state == "closed" else "unlock_door"
        yield make_step(graph, name, *waiting, opening, connector=connector)
    behaviour = connector.behaviour
    if behaviour == "call_elevator":  # it was called by now: what is left is to drive through
        behaviour = "pass_door"
    passing = durations.of_passing(connector, graph.robot.speed, metres)
    if seconds is not None:
        passing = max(seconds - calling - opening, 0.0)
    passage = make_step(
        graph, behaviour, here, there, approach, leave, passing, metres, connector=connector
    )
    yield replace(passage, bends=tuple(bends))


def make_step(
    graph: RoutingGraph,
    behaviour: str,
    here: str,
    there: str,
    approach: Pose | None,
    leave: Pose,
    seconds: float = 0.0,
    metres: float = 0.0,
    *,
    connector: PlaceConnector | None = None,
    elevator: str | None = None,
) -> RouteStep:
    """A step from one place to another, with the frame and the map to drive on."""
    storey = graph.topology.places[here].storey
    frame = "map" if storey is None else frame_name(storey)
    file = "master.yaml" if graph.robot.parts else "map.yaml"
    if storey is not None and graph.has_several_storeys:
        file = f"{file_name(storey)}/{file}"
    ends = here, there, connector, elevator, approach, leave
    return RouteStep(behaviour, *ends, seconds, metres, frame, file)


def turned_around(pose: Pose) -> Pose:
    """The pose turned by 180 degrees about its own z axis; its quaternion has w >= 0."""
    back = pose @ Pose(qz=1.0, qw=0.0)
    if back.qw >= 0:
        return back
    return Pose(back.x, back.y, back.z, -back.qx, -back.qy, -back.qz, -back.qw)
