"""Solves tasks with clingo: a logic program over the events of a task.

The events are pickups, placings and actions of domain files. A drive between two events is one atom
with its exact time, which is minimised; `expand_plan` expands it afterwards. This is exact because
only drives happen between two events, and their times depend only on the two sites: the call of an
elevator takes a constant expected time, and a closed door is opened, and left as it was, at each
passage.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import clingo
import numpy as np
from clingo import Function, Number, String, Symbol

from planner.infeasibility import infeasibility
from planner.plan import Plan
from planner.routing_graph import RoutingGraph
from planner.tasks.goal import ROBOT, Goal, parse_goal
from planner.tasks.lower_bound import lower_bound
from planner.tasks.plan_expansion import TaskEvent, expand_plan
from planner.tasks.problem import NoPlanError, Problem, join_reasons, milliseconds
from planner.tasks.problem_builder import build_problem, is_reached
from planner.tasks.sites import ApproachPosesOf
from planner.tasks.world import TaskState, TaskWorld

if TYPE_CHECKING:
    from planner.tasks.domain_file import Domain

PATIENCE = 10.0  # seconds after which the best plan found so far is taken


def find_plan(
    graph: RoutingGraph,
    world: TaskWorld,
    state: TaskState,
    goal: Goal | str,
    *,
    domain: Domain | None = None,
    approach_poses: ApproachPosesOf | None = None,
    patience: float = PATIENCE,
) -> Plan:
    """The plan that reaches a goal in the least time.

    Each object that the goal moves is picked up once, and once more if it is in the way of another.
    So up to five deliveries are proven to be optimal within `patience`.

    Parameters
    ----------
    domain
        Additional actions.
    approach_poses
        Returns the base poses for an object, the best first; by default its `approach_pose`, or
        else its own pose.
    patience
        Seconds after which the best plan found so far is returned; see its `bound`.

    Raises
    ------
    UnknownObjectError, GoalError, NoPlanError
        With what is unknown, contradictory or in the way.
    """
    if isinstance(goal, str):
        goal = parse_goal(goal, domain.relations if domain else ())
    if is_reached(graph, world, state, goal):
        return Plan(goal.text, (), 0.0, 0.0)
    problem = build_problem(graph, world, state, goal, domain=domain, approach_poses=approach_poses)
    events, meant, proven = solve(problem, patience, graph)
    plan = expand_plan(graph, problem, events, meant)
    bound = plan.seconds if proven else min(lower_bound(problem), plan.seconds)
    return Plan(goal.text, plan.actions, plan.seconds, bound)


def solve(
    problem: Problem, patience: float, graph: RoutingGraph
) -> tuple[list[TaskEvent], dict[str, str], bool]:
    """Events in order, the goal's words by object, and whether the solution is optimal."""
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
        raise NoPlanError(_why_none(problem, graph))
    return *_read(best, problem), bool(result.exhausted)


@cache
def _program() -> str:
    return Path(__file__).with_name("domain.lp").read_text()


def _facts(problem: Problem) -> Iterator[Symbol]:
    def fact(name: str, *arguments: int | str | Symbol) -> Symbol:
        return Function(
            name,
            [
                Number(a) if isinstance(a, int) else String(a) if isinstance(a, str) else a
                for a in arguments
            ],
        )

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
        yield from (fact("candidate", words[word], name) for name in names)
    yield from (fact("differ", words[a], words[b]) for a, b in problem.differ)
    for word, places in problem.regions.items():
        yield from (fact("means", words[word], place) for place in places)
    yield from (fact("site_in", i, site.place) for i, site in enumerate(problem.sites))
    yield from (fact("movable", name, limit) for name, limit in problem.limits.items())
    yield from (fact("carrier", name) for name in problem.carriers)
    for on, names in problem.takes.items():
        yield from (fact("takes", on, name) for name in names)
    for name, number in problem.spots.items():
        yield fact("fixed" if name in problem.fixed else "initially_at", name, number)
    yield from (fact("initially_on", name, on) for name, on in problem.on.items())
    yield from (fact("initially_held", name) for name in problem.held)
    yield from (fact("last", number, place) for number, place in problem.finals)
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
            for option in product(*(problem.candidates[word] for word in atom.words)):
                of = fact(atom.relation, *option)
                yield fact("option", k, of)
                for number, name in zip(numbers, option, strict=True):
                    yield fact("uses", k, of, number, name)
    yield from (fact("initially", fact(*known)) for known in problem.facts)
    for i, operator in enumerate(problem.operators):
        yield fact("operator", i, milliseconds(operator.seconds))
        if operator.at in problem.fixed:
            yield fact("acts_on_site", i, problem.spots[operator.at])
        elif operator.at is not None:
            yield fact("acts_at", i, operator.at)
        yield from (fact("needs_held", i, name) for name in operator.held)
        yield from (fact("needs_on", i, *pair) for pair in operator.on)
        for part in ("needs", "needs_not", "adds", "deletes"):
            yield from (fact(part, i, fact(*known)) for known in getattr(operator, part))


def _read(shown: list[Symbol], problem: Problem) -> tuple[list[TaskEvent], dict[str, str]]:
    """The events of a model, and the goal's words by the objects that they stand for."""
    by_slot: dict[int, TaskEvent] = {}
    called: dict[str, list[str]] = {}
    words = list(problem.candidates)
    finish: TaskEvent | None = None
    for symbol in shown:
        values = [
            a.number if a.type is clingo.SymbolType.Number else a.string for a in symbol.arguments
        ]
        if symbol.name == "is":
            called.setdefault(str(values[1]), []).append(words[int(values[0])].text)
        elif symbol.name == "finish":
            finish = TaskEvent("finish", (), site=int(values[0]))
        elif symbol.name == "do":
            by_slot[int(values[1])] = TaskEvent(
                "do", (), operator=problem.operators[int(values[0])]
            )
        else:
            by_slot[int(values[-1])] = TaskEvent(symbol.name, tuple(map(str, values[:-1])))
    events = [by_slot[slot] for slot in sorted(by_slot)]
    texts_of_goal = [text for texts in called.values() for text in set(texts)]
    names = {n: texts[0] for n, texts in called.items() if texts_of_goal.count(texts[0]) == 1}
    return [*events, finish] if finish else events, names


def _why_none(problem: Problem, graph: RoutingGraph) -> str:
    """A likely reason why there is no plan."""
    spots, sites = problem.spots, problem.sites
    ways = [
        (f"{name} cannot be brought", spots[name], [spots[on]])
        for on, names in problem.takes.items()
        for name in names
        if name in spots and on in spots
    ]
    ends = [number for number, _ in problem.finals]
    placed = [spots[on] for on in problem.takes if on in spots]
    ways += [("the robot cannot go on", spot, ends) for spot in placed]
    lifted = [[spots[name]] for name in problem.limits if name in spots]
    ways += [("the robot cannot go on", spot, there) for spot in placed for there in lifted]
    for what, here, there in ways:
        if there and np.isinf(problem.seconds[here, there]).all():
            a, b = sites[here], sites[there[0]]
            reason = infeasibility(graph, a, b).partition(": ")[2]
            return f"{what} from {a.place} to {b.place}: {reason}"
    if problem.held:
        return (
            f"no order of actions reaches {problem.goal.text}: the robot already carries "
            f"{', '.join(problem.held)} (capacity {problem.capacity})"
        )
    if problem.refused:
        return f"no order of actions reaches {problem.goal.text}: {join_reasons(problem.refused)}"
    return (
        f"no order of actions reaches {problem.goal.text} with one pickup of each object; "
        "split the goal"
    )
