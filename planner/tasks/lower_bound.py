"""A lower bound on the duration of any plan, for plans that are not proven to be optimal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from planner.tasks.goal import ROBOT
from planner.tasks.problem import Problem

_NEVER = 1e9


def lower_bound(problem: Problem) -> float:
    """Seconds that every plan takes at least.

    Each delivery takes a pickup, a drive with the load and a placing. Before each pickup comes a
    drive without load from the start or from a delivery, each of which is used once: the cheapest
    assignment is the bound (Frederickson, Hecht and Kim, 1978, for the stacker crane problem). With
    a capacity above one, loads overlap, and only the first visits of all sites are assigned.
    """
    legs = _legs(problem)
    if not legs:
        return 0.0
    handled = sum(problem.pickup * (source != [-1]) + problem.place for source, _ in legs)
    d = problem.seconds
    if problem.capacity == 1:
        loaded = sum(
            float(min(d[a, b] for a in source for b in target))
            for source, target in legs
            if source != [-1]
        )
        ends: list[list[int]] = [[0], *(target for _, target in legs)]
        starts = [source for source, _ in legs if source != [-1]]
        return handled + loaded + _assigned(d, ends, starts)
    visits: list[list[int]] = []
    for options in (o for leg in legs for o in leg if o != [-1]):
        if not any(set(options) & set(seen) for seen in visits) and 0 not in options:
            visits.append(options)
    return handled + _assigned(d, [[0], *visits], visits, apart=True)


def _assigned(
    d: NDArray[np.float64],
    before: list[list[int]],
    after: list[list[int]],
    *,
    apart: bool = False,
) -> float:
    """The cost of the cheapest assignment of each visit to the visit before it."""
    if not after:
        return 0.0
    cost = np.array([[min(d[a, b] for a in p for b in q) for p in before] for q in after])
    if apart:
        cost[np.arange(len(after)), np.arange(len(after)) + 1] = _NEVER
    cost = np.minimum(cost, _NEVER)
    rows, columns = linear_sum_assignment(cost)
    found = cost[rows, columns]
    return float(found[found < _NEVER].sum())


def _legs(problem: Problem) -> list[tuple[list[int], list[int]]]:
    """For each object to be moved: the sites at which it may be, and to which it may go."""
    legs = []
    for atom in problem.goal.atoms:
        if atom.relation not in ("on", "in") or atom.words[0].text == ROBOT:
            continue
        names = problem.candidates[atom.words[0]]
        targets = {on for on, takes in problem.takes.items() if set(takes) & set(names)}
        if atom.words[1] in problem.candidates:
            targets &= set(problem.candidates[atom.words[1]])
        there = {*targets, *problem.candidates.get(atom.words[1], ())}
        if not targets or any(problem.on.get(n) in there for n in names):
            continue  # it may be there already
        if any(t not in problem.fixed for t in targets):
            continue  # a movable target may come towards it
        if any(n in problem.carriers or problem.on.get(n) in problem.carriers for n in names):
            continue
        source = (
            [-1] if any(n in problem.held for n in names) else [problem.spots[n] for n in names]
        )
        legs.append((source, [problem.spots[t] for t in targets]))
    return legs
