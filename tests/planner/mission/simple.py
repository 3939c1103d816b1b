"""A planner for one object at a time: the shortest way to it, and with it to where it shall lie."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from sqlalchemy import text

from planner.plan import Action, Plan
from planner.readers.topology import read_topology
from planner.route import NoRouteError, Route
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot

WHERE = """
SELECT h.name AS holder, p.relation, w.pose, r.name AS place, rw.pose AS room
FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
LEFT JOIN entity h ON h.id = p.holder_id
LEFT JOIN LATERAL (SELECT k.id, k.name FROM holders_of(ARRAY[e.id]) o
                   JOIN entity k ON k.id = o AND k.kind = 'room' LIMIT 1) r ON true
LEFT JOIN world rw ON rw.entity_id = r.id
WHERE e.map_id = current_map() AND e.name = :name
"""
INSTANCES = """
SELECT o.label FROM object_type o WHERE o.map_id = current_map() AND o.type = :type ORDER BY o.label
"""


def simple_planner(
    seen: Snapshot,
    robot: str,
    goal: str,
    *,
    without: frozenset[str] = frozenset(),
    tried: frozenset[tuple[str, Pose]] = frozenset(),
) -> Plan:
    topology = read_topology(seen)
    graph = RoutingGraph(topology.without(without))
    where = {r: seen.connection.execute(text(WHERE), {"name": r}).one_or_none() for r in (robot,)}
    here, pose = where[robot].place, Pose(*where[robot].pose)
    said = re.fullmatch(r"(on|in)\((\w+), ([\w-]+)\)", goal)
    if said is None:
        raise ValueError(f"{goal} is no goal")
    relation, what, target = said.groups()
    if what == "robot":
        if here == target:
            return Plan(goal, (), 0.0, 0.0)
        return plan(
            goal, way(find_route(graph, graph.endpoint(here, pose), graph.endpoint(target)))
        )
    names = [what, *seen.connection.execute(text(INSTANCES), {"type": what}).scalars()]
    objects = {n: seen.connection.execute(text(WHERE), {"name": n}).one_or_none() for n in names}
    objects = {n: row for n, row in objects.items() if row is not None}
    if any(row.holder == target and row.relation == relation for row in objects.values()):
        return Plan(goal, (), 0.0, 0.0)
    held = [n for n, row in objects.items() if row.holder == robot]
    to = seen.connection.execute(text(WHERE), {"name": target}).one()
    over = stand(to)
    if held:
        route = find_route(graph, graph.endpoint(here, pose), graph.endpoint(to.place, over))
        put = Action("place", (held[0], target), 10.0, way(route)[-1].steps, over)
        return plan(goal, [*way(route)[:-1], put])
    best: tuple[float, list[Action]] | None = None
    why: Exception = ValueError(f"no {what} is left")
    for name, row in objects.items():
        if name in without:
            continue
        at = stand(row)
        try:
            first = find_route(graph, graph.endpoint(here, pose), graph.endpoint(row.place, at))
            then = find_route(graph, graph.endpoint(row.place, at), graph.endpoint(to.place, over))
        except NoRouteError as error:
            why = error
            continue
        take = Action("pickup", (name, row.holder), 10.0, way(first)[-1].steps, at)
        put = Action("place", (name, target), 10.0, way(then)[-1].steps, over)
        actions = [*way(first)[:-1], take, *way(then)[:-1], put]
        if best is None or first.seconds + then.seconds < best[0]:
            best = (first.seconds + then.seconds, actions)
    if best is None:
        raise why
    return plan(goal, best[1])


def stand(row: Any) -> Pose:
    """Beside an object, towards the middle of its room."""
    at, room = Pose(*row.pose), Pose(*row.room)
    return Pose.planar(at.x, at.y - 0.7 if at.y > 2 else at.y + 0.7, 0.0, room.z)


def way(route: Route) -> list[Action]:
    """An action a transition, with the walk before it; the walk at the end is one more."""
    actions, waiting = [], []
    for step in route.steps:
        waiting.append(step)
        if step.behaviour not in ("navigate", "open_door", "unlock_door", "switch_map"):
            actions.append(Action(step.behaviour, (), step.seconds, tuple(waiting)))
            waiting = []
    return [*actions, Action("drive", (), 0.0, tuple(waiting))]


def plan(goal: str, actions: list[Action]) -> Plan:
    if actions and actions[-1].name == "drive":
        if actions[-1].steps:
            actions[-1] = replace(actions[-1], name="navigate")
        else:
            actions.pop()
    return Plan(goal, tuple(actions), 0.0, 0.0)
