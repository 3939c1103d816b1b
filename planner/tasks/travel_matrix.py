"""Computes the travel times between the sites of a problem."""

from __future__ import annotations

import math

import numpy as np

from planner.route_search import seconds_between
from planner.tasks.problem_draft import ProblemDraft


def add_travel_times(draft: ProblemDraft) -> None:
    """Number the sites that a problem uses, and compute the travel times between them."""
    problem = draft.problem
    used = sorted({0, *problem.spots.values(), *(n for n, _ in problem.finals)})
    renumbered = {old: new for new, old in enumerate(used)}
    problem.sites = [draft.sites.all[i] for i in used]
    problem.spots = {name: renumbered[i] for name, i in problem.spots.items()}
    problem.finals = [(renumbered[i], place) for i, place in problem.finals]
    ends = {number for number, _ in problem.finals} - {*problem.spots.values()}
    starts = [i for i in range(len(used)) if i == 0 or i not in ends]
    # no drive leads back to the start, unless an object is there or the robot may end there
    goals = [i for i in range(len(used)) if i > 0 or i in ends or i in problem.spots.values()]
    problem.seconds = np.full((len(used), len(used)), math.inf)
    if goals:
        problem.seconds[np.ix_(starts, goals)] = seconds_between(
            draft.graph, [problem.sites[i] for i in starts], [problem.sites[i] for i in goals]
        )
    np.fill_diagonal(problem.seconds, 0.0)
