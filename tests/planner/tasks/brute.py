"""The shortest plan by exhaustive search over states (Dijkstra), to hold the planner against."""

from __future__ import annotations

import heapq
from itertools import count

from planner.route_search import seconds_between
from planner.routing_graph import RoutingGraph
from planner.tasks.world import TaskObject, TaskState, TaskWorld


def shortest(
    graph: RoutingGraph,
    world: TaskWorld,
    state: TaskState,
    done,
    *,
    movable: list[str],
    surfaces: list[str],
    limits: dict[str, int],
    end: str | None = None,
) -> float | None:
    """Milliseconds of the shortest plan after which `done(below, held)`; None: there is none.

    `end` is a room in which the robot shall be at last.
    """

    def ground(item: TaskObject):
        p = item.pose
        return type(p)(p.x, p.y, p.z - item.height, p.qx, p.qy, p.qz, p.qw)

    items = world.objects
    sites = {None: graph.endpoint(state.place, state.pose)}
    for name in {*movable, *surfaces}:
        sites[name] = graph.endpoint(items[name].place, ground(items[name]))
    keys = list(sites)
    took = seconds_between(graph, [sites[k] for k in keys], [sites[k] for k in keys])
    drive = {
        (a, b): (0 if a == b else took[i, j])
        for i, a in enumerate(keys)
        for j, b in enumerate(keys)
    }
    home = {}
    if end is not None:
        last = seconds_between(graph, [sites[k] for k in keys], [graph.endpoint(end)])[:, 0]
        home = dict(zip(keys, last, strict=True))
    capacity = graph.robot.capacity
    first = (
        None,
        frozenset((n, items[n].holder, n) for n in movable if n not in state.carrying),
        frozenset(state.carrying),
        tuple(limits.get(n, 0) for n in movable),
    )
    order = count()
    queue: list = [(0, next(order), first, False)]
    seen = set()
    while queue:
        cost, _, now, ended = heapq.heappop(queue)
        if ended:
            return cost
        if now in seen:
            continue
        seen.add(now)
        at, where, held, left = now
        below = {n: h for n, h, _ in where}
        spot = {n: s for n, _, s in where}
        settled = all(n in state.carrying for n in held)
        if settled and done(below, held):
            more = 0 if end is None else round(1000 * home[at]) if home[at] < 1e18 else None
            if more is not None:
                heapq.heappush(queue, (cost + more, next(order), now, True))
        for i, name in enumerate(movable):
            if name in held:
                for on in surfaces:
                    if on == name or on in held:
                        continue
                    if on in movable and any(h == on for h in below.values()):
                        continue
                    place = spot.get(on, on)
                    if drive[at, place] > 1e18:
                        continue
                    more = round(1000 * drive[at, place]) + round(1000 * graph.durations.place)
                    new = (place, where | {(name, on, place)}, held - {name}, left)
                    heapq.heappush(queue, (cost + more, next(order), new, False))
            elif len(held) < capacity and left[i] and name not in below.values():
                place = spot[name]
                if drive[at, place] > 1e18:
                    continue
                more = round(1000 * drive[at, place]) + round(1000 * graph.durations.pickup)
                fewer = (*left[:i], left[i] - 1, *left[i + 1 :])
                gone = frozenset(w for w in where if w[0] != name)
                new = (place, gone, held | {name}, fewer)
                heapq.heappush(queue, (cost + more, next(order), new, False))
    return None
