"""From events to actions: the drives between them as doors, elevators and openings (Figure 4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from planner.network import Network, Site
from planner.plan import Action, Plan
from planner.route import Step
from planner.tasks.problem import Operator, Problem
from planner.topology import Topology

__all__ = ["Event", "actions_along", "expand"]


@dataclass(frozen=True)
class Event:
    """A slot of the program: pickup(thing), place(thing, on), do(operator), finish at a site."""

    kind: str
    arguments: tuple[str, ...]
    operator: Operator | None = None
    site: int | None = None


def expand(
    network: Network,
    problem: Problem,
    events: Sequence[Event],
    called: Mapping[str, str],
) -> Plan:
    """All actions of a plan, in order.

    Parameters
    ----------
    called : what the goal calls a thing, by its name; the arguments of actions say it so
    """
    actions: list[Action] = []
    on, at = dict(problem.on), dict(problem.spots)
    here = 0
    names: tuple[str, ...]
    shown: tuple[str, ...]
    for event in events:
        if event.kind == "pickup":
            (thing,) = event.arguments
            there = at[thing]
            names = (thing, on.pop(thing))
            shown, seconds = (called.get(thing, thing), names[1]), problem.pickup
            at.pop(thing)
        elif event.kind == "place":
            thing, target = event.arguments
            there = at[target]
            names, shown, seconds = (
                event.arguments,
                (called.get(thing, thing), target),
                problem.place,
            )
            on[thing] = target
            _settle(thing, there, on, at)
        elif event.kind == "finish":
            assert event.site is not None
            there, names, shown, seconds = event.site, (), (), 0.0
        else:
            assert event.operator is not None
            operator = event.operator
            there = here if operator.at is None else at[operator.at]
            names, seconds = operator.arguments, operator.seconds
            shown = tuple(called.get(n, n) for n in names)
        driven, walk = _drive(network, problem.sites[here], problem.sites[there])
        actions += driven
        here = there
        if event.kind == "finish":
            if walk:
                actions.append(Action("navigate", (problem.sites[here].place,), _sum(walk), walk))
            continue
        name = event.operator.name if event.operator else event.kind
        actions.append(
            Action(
                name, shown, _sum(walk) + seconds, walk, problem.sites[here].pose,
                () if names == shown else names,
            )
        )  # fmt: skip
    return Plan(problem.goal.text, tuple(actions), sum(a.seconds for a in actions), 0.0)


def _settle(thing: str, site: int, on: Mapping[str, str], at: dict[str, int]) -> None:
    """A thing is at a site now, and so is what stands on it."""
    at[thing] = site
    for above, below in on.items():
        if below == thing:
            _settle(above, site, on, at)


def _drive(network: Network, a: Site, b: Site) -> tuple[list[Action], tuple[Step, ...]]:
    """The actions on the way from one site to another, and the walk that is left at its end."""
    if a is b:
        return [], ()
    actions = list(actions_along(network.route(a, b).stages, network.topology))
    if actions and actions[-1].name == "navigate":
        return actions[:-1], actions[-1].steps
    return actions, ()


def actions_along(stages: Sequence[Step], topology: Topology) -> Iterator[Action]:
    """The stages of a route as Figure 4 prints them: a walk belongs to what it leads to.

    A walk at the end is an action of its own: ``navigate(place)``.
    """
    waiting: list[Step] = []
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


def _action(name: str, arguments: tuple[str, ...], steps: Sequence[Step]) -> Action:
    return Action(name, arguments, _sum(steps), tuple(steps))


def _arguments(step: Step, topology: Topology) -> tuple[str, ...]:
    if step.behaviour == "call_elevator":
        return ()
    if step.connector is None:
        storeys = [topology.places[p].storey or p for p in (step.from_place, step.to_place)]
        return storeys[0], storeys[1]
    if step.behaviour in ("open_door", "unlock_door"):
        return (step.connector.name,)
    return step.connector.name, step.from_place, step.to_place


def _sum(steps: Sequence[Step]) -> float:
    return sum(s.seconds for s in steps)
