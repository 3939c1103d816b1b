"""Expands the events of a plan to actions, with the drives between them (Figure 4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from planner.plan import Action, Plan
from planner.route import RouteStep
from planner.route_search import find_route
from planner.routing_graph import Endpoint, RoutingGraph
from planner.tasks.problem import Operator, Problem
from planner.topology import Topology


@dataclass(frozen=True)
class TaskEvent:
    """An event of a plan: pickup(object), place(object, on), do(operator), or finish at a site."""

    kind: str
    arguments: tuple[str, ...]
    operator: Operator | None = None
    site: int | None = None


def expand_plan(
    graph: RoutingGraph,
    problem: Problem,
    events: Sequence[TaskEvent],
    called: Mapping[str, str],
) -> Plan:
    """The plan with all its actions, in order.

    `called` has the goal's word for an object, by its name; arguments of actions use it.
    """
    actions: list[Action] = []
    on, at = dict(problem.on), dict(problem.spots)
    here = 0
    names: tuple[str, ...]
    for event in events:
        operator = event.operator
        if event.kind == "pickup":
            (item,) = event.arguments
            there, names, seconds = at.pop(item), (item, on.pop(item)), problem.pickup
        elif event.kind == "place":
            names, (item, target) = event.arguments, event.arguments
            there, seconds = at[target], problem.place
            on[item] = target
            _settle(item, there, on, at)
        elif operator is not None:
            there = here if operator.at is None else at[operator.at]
            names, seconds = operator.arguments, operator.seconds
        else:
            assert event.site is not None
            there, names, seconds = event.site, (), 0.0
        driven, drive = _drive(graph, problem.sites[here], problem.sites[there])
        actions += driven
        here = there
        if event.kind == "finish":
            if drive:
                end = next(name for number, name in problem.finals if number == there)
                actions.append(Action("navigate", (end,), _sum(drive), drive))
            continue
        named = len(names) if operator else 1  # surfaces have their own names
        shown = (*(called.get(n, n) for n in names[:named]), *names[named:])
        name, pose = operator.name if operator else event.kind, problem.sites[here].pose
        own = () if names == shown else names
        actions.append(Action(name, shown, _sum(drive) + seconds, drive, pose, own))
    return Plan(problem.goal.text, tuple(actions), sum(a.seconds for a in actions), 0.0)


def _settle(item: str, site: int, on: Mapping[str, str], at: dict[str, int]) -> None:
    """Put an object, and the objects on it, at a site."""
    at[item] = site
    for above, below in on.items():
        if below == item:
            _settle(above, site, on, at)


def _drive(
    graph: RoutingGraph, a: Endpoint, b: Endpoint
) -> tuple[list[Action], tuple[RouteStep, ...]]:
    """The actions between two sites, and the last drive, which belongs to the next action."""
    if a is b:
        return [], ()
    actions = list(actions_along(find_route(graph, a, b).steps, graph.topology))
    if actions and actions[-1].name == "navigate":
        return actions[:-1], actions[-1].steps
    return actions, ()


def actions_along(stages: Sequence[RouteStep], topology: Topology) -> Iterator[Action]:
    """The steps of a route as Figure 4 prints them: a drive belongs to the next action.

    A drive at the end is an action of its own: ``navigate(place)``.
    """
    waiting: list[RouteStep] = []
    last: Action | None = None
    for step in stages:
        if step.behaviour == "switch_map" and last is not None:
            last = _action(last.name, last.arguments, [*last.steps, step])
            continue
        waiting.append(step)
        if step.behaviour == "navigate":
            continue
        if last is not None:
            yield last
        last = _action(step.behaviour, _arguments(step, topology), waiting)
        waiting = []
    if last is not None:
        yield last
    if waiting:
        yield _action("navigate", (waiting[-1].to_place,), waiting)


def _action(name: str, arguments: tuple[str, ...], steps: Sequence[RouteStep]) -> Action:
    return Action(name, arguments, _sum(steps), tuple(steps))


def _arguments(step: RouteStep, topology: Topology) -> tuple[str, ...]:
    if step.behaviour == "call_elevator":
        return ()
    if step.connector is None:
        storeys = [topology.places[p].storey or p for p in (step.from_place, step.to_place)]
        return storeys[0], storeys[1]
    if step.behaviour in ("open_door", "unlock_door"):
        return (step.connector.name,)
    return step.connector.name, step.from_place, step.to_place


def _sum(steps: Sequence[RouteStep]) -> float:
    return sum(s.seconds for s in steps)
