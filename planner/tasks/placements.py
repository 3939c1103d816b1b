"""Determines where the objects of a problem are, and where they may be put."""

from __future__ import annotations

from collections.abc import Collection

from planner.tasks.goal_objects import GoalObjects
from planner.tasks.object_checks import ObjectChecks
from planner.tasks.problem import Problem
from planner.tasks.problem_draft import ProblemDraft


def add_placements(
    draft: ProblemDraft, checks: ObjectChecks, objects: GoalObjects, anywhere: Collection[str]
) -> None:
    """Fill the surfaces of a problem, and the sites at which the robot reaches them.

    The objects `anywhere` may be put on every surface of the problem.
    """
    targets = _targets(draft.problem)
    _add_surfaces(draft, checks, objects, anywhere)
    _add_sites(draft, targets)
    _add_holders(draft, targets)


def _targets(problem: Problem) -> set[str]:
    """The objects that the goal and the operators name."""
    targets = {n for names in problem.candidates.values() for n in names}
    targets |= {o.at for o in problem.operators if o.at is not None}
    targets |= {on for o in problem.operators for _, on in o.on}
    return targets


def _add_surfaces(
    draft: ProblemDraft, checks: ObjectChecks, objects: GoalObjects, anywhere: Collection[str]
) -> None:
    problem, world = draft.problem, draft.world
    moved = problem.limits
    surfaces = dict.fromkeys(on for name in moved for on in objects.surfaces.get(name, ()))
    for name in moved:
        holder = world.objects[name].holder
        if holder is not None and name not in problem.held:
            surfaces.setdefault(holder)
    for name in moved:
        options = list(dict.fromkeys(objects.surfaces.get(name, ())))
        if name in anywhere or name in problem.held:
            for on in surfaces:
                item = world.objects.get(on)
                if on == name or on in options or (item is None and on not in draft.graph.nodes):
                    continue
                movable = item is not None and on in moved
                if not movable and checks.unsuitable(name, on) is None:
                    options.append(on)
        for on in options:
            problem.takes.setdefault(on, []).append(name)


def _add_sites(draft: ProblemDraft, targets: set[str]) -> None:
    problem, sites, world = draft.problem, draft.sites, draft.world
    moved = problem.limits
    for name in [*moved, *problem.takes, *targets]:
        item = world.objects.get(name)
        if item is None:
            problem.fixed.add(name)
            problem.spots[name] = sites.of_floor(name)
            continue
        if item.carrier:
            problem.carriers.add(name)
        if name not in problem.held:
            below = world.objects.get(item.holder or "")
            rides = below is not None and below.carrier and below.name in moved
            problem.spots[name] = sites.of_object(below if rides and below is not None else item)
        if name not in moved and (item.carrier or item.obstacle(draft.heights) is not None):
            problem.fixed.add(name)


def _add_holders(draft: ProblemDraft, targets: set[str]) -> None:
    problem, world = draft.problem, draft.world
    relevant = {*problem.limits, *problem.takes, *targets}
    above = {n for on in relevant if on not in problem.fixed for n in world.above.get(on, ())}
    for name in relevant | above:
        item = world.objects.get(name)
        if item is not None and item.holder is not None and name not in problem.held:
            problem.on[name] = item.holder
