"""Plans for tasks: a logic program over the events of a task, solved with clingo.

Only picking up, putting down and the actions of domain files are events of the program; a drive
between two is one atom with its exact time, minimised, and expanded afterwards (`expand`). That is
exact, because between two events only moves happen, and what they take depends on the two sites
alone: a call of an elevator takes a constant expected time, and a closed door is opened, and left
as it was, at each passage.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import clingo
from clingo import Function, Number, String, Symbol

from planner.network import Network
from planner.plan import Plan
from planner.tasks.bound import lower_bound
from planner.tasks.expand import Event, expand
from planner.tasks.goal import ROBOT, Goal, parse_goal
from planner.tasks.posing import pose_problem
from planner.tasks.problem import NoPlanError, Problem, milliseconds
from planner.tasks.sites import StandOf
from planner.tasks.world import State, World

if TYPE_CHECKING:
    from planner.tasks.domain_file import Domain

__all__ = ["plan_task", "solve"]

PATIENCE = 10.0
"""Seconds after which the best plan found is taken."""


def plan_task(
    network: Network,
    world: World,
    state: State,
    goal: Goal | str,
    *,
    domain: Domain | None = None,
    stand: StandOf | None = None,
    patience: float = PATIENCE,
) -> Plan:
    """The plan that reaches a goal in the least time.

    Each thing that the goal moves is picked up once, and once more if it stands in the way of
    another; with that, up to five deliveries are proven optimal well within `patience`.

    Parameters
    ----------
    domain : actions that the user adds
    stand : where the robot's base stands for a thing; by default its `stand`, else the thing's pose
    patience : seconds after which the best plan found is taken; its `bound` tells what it may miss

    Raises
    ------
    UnknownThingError, GoalError, NoPlanError
        With what is unknown, contradictory or in the way.
    """
    if isinstance(goal, str):
        goal = parse_goal(goal, domain.relations if domain else ())
    extend = None if domain is None else domain.extend
    problem = pose_problem(network, world, state, goal, stand=stand, extend=extend)
    events, meant, proven = solve(problem, patience)
    plan = expand(network, problem, events, meant)
    bound = plan.seconds if proven else min(lower_bound(problem), plan.seconds)
    return Plan(goal.text, plan.actions, plan.seconds, bound)


def solve(problem: Problem, patience: float = PATIENCE) -> tuple[list[Event], dict[str, str], bool]:
    """Events in order, what each chosen thing is called, and whether nothing is shorter."""
    control = clingo.Control(["--warn=none"])
    control.add("base", [], _program())
    with control.backend() as backend:
        for fact in _facts(problem):
            backend.add_rule([backend.add_atom(fact)])
    control.ground([("base", [])])
    best: list[Symbol] = []

    def take(model: clingo.Model) -> None:
        best[:] = model.symbols(shown=True)

    until = time.monotonic() + patience
    with control.solve(on_model=take, async_=True) as handle:
        done = handle.wait(max(until - time.monotonic(), 0.0))
        if not done:
            handle.cancel()
        result = handle.get()
    if not best:
        if not done:
            raise NoPlanError(
                f"no plan was found within {patience:g} s; split the goal, or allow more time"
            )
        raise NoPlanError(_why_none(problem))
    return *_read(best, problem), bool(result.exhausted)


@cache
def _program() -> str:
    return Path(__file__).with_name("domain.lp").read_text()


def _facts(problem: Problem) -> Iterator[Symbol]:
    def fact(name: str, *arguments: int | str | Symbol) -> Symbol:
        return Function(
            name,
            [Number(a) if isinstance(a, int) else String(a) if isinstance(a, str) else a
             for a in arguments],
        )  # fmt: skip

    words = {w: i for i, w in enumerate([*problem.candidates, *problem.regions])}
    yield fact("slots", problem.slots)
    yield fact("capacity", problem.capacity)
    yield fact("start", 0)
    yield fact("pickup_time", milliseconds(problem.pickup))
    yield fact("place_time", milliseconds(problem.place))
    for i, row in enumerate(problem.seconds):
        for j, seconds in enumerate(row):
            if seconds < float("inf"):
                yield fact("drive", i, j, milliseconds(float(seconds)))
    for word, names in problem.candidates.items():
        for name in names:
            yield fact("candidate", words[word], name)
    for a, b in problem.differ:
        yield fact("differ", words[a], words[b])
    for word, places in problem.regions.items():
        for place in places:
            yield fact("means", words[word], place)
    for i, site in enumerate(problem.sites):
        yield fact("site_in", i, site.place)
    for name, limit in problem.limits.items():
        yield fact("movable", name, limit)
    for name in problem.carriers:
        yield fact("carrier", name)
    for on, names in problem.takes.items():
        for name in names:
            yield fact("takes", on, name)
    for name, number in problem.spots.items():
        yield fact("fixed" if name in problem.fixed else "initially_at", name, number)
    for name, on in problem.on.items():
        yield fact("initially_on", name, on)
    for name in problem.held:
        yield fact("initially_held", name)
    for number, place in problem.finals:
        yield fact("last", number, place)
    for k, atom in enumerate(problem.goal.atoms):
        numbers = [-1 if w.text == ROBOT else words[w] for w in atom.words]
        if atom.relation == "carries":
            yield fact("need_carried", numbers[1])
        elif atom.relation == "on" or (
            atom.relation == "in" and atom.words[1] not in problem.regions
        ):
            yield fact("need_on", *numbers)
        elif atom.relation == "in" and numbers[0] < 0:
            yield fact("need_robot", numbers[1])
        elif atom.relation == "in":
            yield fact("need_in", *numbers)
        else:
            yield fact("need_fact", k)
            options: list[tuple[str, ...]] = [()]
            for word in atom.words:
                options = [(*o, n) for o in options for n in problem.candidates[word]]
            for option in options:
                of = fact(atom.relation, *option)
                yield fact("option", k, of)
                for number, name in zip(numbers, option, strict=True):
                    yield fact("uses", k, of, number, name)
    for said in problem.facts:
        yield fact("initially", fact(*said))
    for i, operator in enumerate(problem.operators):
        yield fact("operator", i, milliseconds(operator.seconds))
        if operator.at is not None:
            if operator.at in problem.fixed:
                yield fact("acts_on_site", i, problem.spots[operator.at])
            else:
                yield fact("acts_at", i, operator.at)
        for name in operator.held:
            yield fact("asks_held", i, name)
        for a_on, b_on in operator.on:
            yield fact("asks_on", i, a_on, b_on)
        for name_, facts in (
            ("asks", operator.asks), ("asks_not", operator.asks_not),
            ("adds", operator.adds), ("deletes", operator.deletes),
        ):  # fmt: skip
            for said in facts:
                yield fact(name_, i, fact(*said))


def _read(shown: list[Symbol], problem: Problem) -> tuple[list[Event], dict[str, str]]:
    """The events of a model, and the goal's words by the things that they mean."""
    by_slot: dict[int, Event] = {}
    called: dict[str, list[str]] = {}
    words = list(problem.candidates)
    finish: Event | None = None
    for symbol in shown:
        values = [a.number if a.type is clingo.SymbolType.Number else a.string
                  for a in symbol.arguments]  # fmt: skip
        if symbol.name == "is":
            called.setdefault(str(values[1]), []).append(words[int(values[0])].text)
        elif symbol.name == "finish":
            finish = Event("finish", (), site=int(values[0]))
        elif symbol.name == "do":
            by_slot[int(values[1])] = Event("do", (), operator=problem.operators[int(values[0])])
        else:
            by_slot[int(values[-1])] = Event(symbol.name, tuple(map(str, values[:-1])))
    events = [by_slot[slot] for slot in sorted(by_slot)]
    said = [text for texts in called.values() for text in set(texts)]
    names = {n: texts[0] for n, texts in called.items() if said.count(texts[0]) == 1}
    return [*events, finish] if finish else events, names


def _why_none(problem: Problem) -> str:
    """What may have made it impossible, in words."""
    for on, names in problem.takes.items():
        for name in names:
            if name not in problem.spots:
                continue
            here, there = problem.spots[name], problem.spots.get(on)
            if there is not None and problem.seconds[here, there] == float("inf"):
                places = [problem.sites[i].place for i in (here, there)]
                return (
                    f"{name} cannot be brought from {places[0]} to {places[1]}: no way leads there"
                )
    if problem.held:
        return (
            f"no order of actions reaches {problem.goal.text}: the robot already carries "
            f"{', '.join(problem.held)} (capacity {problem.capacity})"
        )
    return (
        f"no order of actions reaches {problem.goal.text}, if no thing is picked up twice; say the "
        "goal in parts"
    )
