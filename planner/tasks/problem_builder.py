"""Builds the problem of a goal: the objects, surfaces and sites that its plan can use.

Only the objects that a goal names, the objects in their way and the surfaces for them become part
of the problem. So neither the size of the building nor the number of its objects matters.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable

import numpy as np

from planner.route_search import seconds_between
from planner.routing_graph import RoutingGraph
from planner.tasks.candidate_pruning import prune
from planner.tasks.domain_file import Domain
from planner.tasks.goal import ROBOT, Atom, Goal
from planner.tasks.goal_objects import find_surfaces, find_wanted, resolve_words
from planner.tasks.problem import NoPlanError, Problem
from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.sites import ApproachPosesOf, Sites
from planner.tasks.world import TaskState, TaskWorld


def build_problem(
    graph: RoutingGraph,
    world: TaskWorld,
    state: TaskState,
    goal: Goal,
    *,
    domain: Domain | None = None,
    approach_poses: ApproachPosesOf | None = None,
) -> Problem:
    """The problem of a goal.

    Raises UnknownObjectError: a word of the goal stands for nothing; GoalError: the goal
    contradicts itself or the world; NoPlanError: the goal cannot be reached.
    """
    sites = Sites(graph, world, state.place, state.pose, approach_poses)
    times = graph.durations
    problem = Problem(goal, state, graph.robot.capacity, times.pickup, times.place)
    draft = ProblemDraft(graph, world, sites, problem)
    _add_held(problem, world)
    resolve_words(problem, world, graph.topology)
    find_wanted(draft)
    extra, more = domain.extend(problem, world) if domain else ([], 0)
    lifted = [n for n in extra if draft.obstacle(n) is None and n not in problem.held]
    find_surfaces(draft)
    aside = _limit_pickups(draft, [*lifted, *draft.surfaces])
    if domain is None:
        prune(draft, aside)
    _add_surfaces(draft, {*aside, *extra})
    targets = _targets(problem)
    _add_sites(draft, targets)
    _add_holders(draft, targets)
    _count_slots(draft, more)
    problem.finals = draft.finals
    _add_travel_times(draft)
    return problem


def is_reached(graph: RoutingGraph, world: TaskWorld, state: TaskState, goal: Goal) -> bool:
    """Whether a goal that names one thing by each of its words is reached.

    Where it is not sure, as of goals that any of several things reaches, the answer is no. Raises
    what `build_problem` does for words.
    """
    sites = Sites(graph, world, state.place, state.pose, None)
    problem = Problem(goal, state, graph.robot.capacity, 0.0, 0.0)
    draft = ProblemDraft(graph, world, sites, problem)
    _add_held(problem, world)
    resolve_words(problem, world, graph.topology)
    if any(len(names) > 1 for names in problem.candidates.values()):
        return False
    return all(_is_true(draft, atom) for atom in goal.atoms)


def _is_true(draft: ProblemDraft, atom: Atom) -> bool:
    problem = draft.problem
    if atom.relation == "carries":
        return problem.candidates.get(atom.words[1], [""])[0] in problem.held
    if atom.relation not in ("on", "in"):
        return False
    word, target = atom.words
    if word.text == ROBOT:
        return problem.regions[target] == [problem.state.place]
    return draft.satisfied(word, problem.candidates[word][0])


def _add_held(problem: Problem, world: TaskWorld) -> None:
    carrying = problem.state.carrying
    for name in carrying:
        if name not in world.objects:
            raise NoPlanError(f"the robot carries {name}, which the world does not have")
    if len(carrying) > problem.capacity:
        raise NoPlanError(
            f"the robot already carries {', '.join(carrying)}: more than its "
            f"capacity of {problem.capacity}"
        )
    problem.held = list(carrying)


def _limit_pickups(draft: ProblemDraft, moved: Iterable[str]) -> dict[str, None]:
    """Limit the pickups of the objects that are moved; returns those to be put aside."""
    problem, world = draft.problem, draft.world
    limits = dict.fromkeys(moved, 1)
    aside = dict.fromkeys(off for name in limits for off in draft.tucked.get(name, ()))
    for word, names in problem.candidates.items():
        if word in draft.wanted and all(n in limits for n in names):
            continue
        for name in names:  # space is made on a target
            if draft.needs_space(world.objects[name]):
                for above in world.above.get(name, ()):
                    if draft.obstacle(above) is None:
                        aside.update(dict.fromkeys([above, *draft.tucked[above]]))
    for off in aside:
        limits[off] = limits.get(off, 0) + 1
    for name in problem.held:
        limits.setdefault(name, 1 if name in draft.surfaces else 0)
    problem.limits = limits
    return aside


def _count_slots(draft: ProblemDraft, more: int) -> None:
    """Set the maximum number of events of a plan; `more` of them are those of a domain file."""
    problem = draft.problem

    def events(names: Iterable[str]) -> int:
        return sum(2 * problem.limits.get(n, 0) + (n in problem.held) for n in set(names))

    several: list[int] = []
    sure: set[str] = set(problem.held)
    for names in problem.candidates.values():
        groups = [{n, *draft.tucked.get(n, ())} | _off_target(draft, n) for n in names]
        if len(groups) == 1:
            sure |= groups[0]
        else:
            several.append(max(map(events, groups)))
    problem.slots = events(sure) + sum(several) + more


def _off_target(draft: ProblemDraft, name: str) -> set[str]:
    """The objects to take off a target."""
    found: set[str] = set()
    if draft.needs_space(draft.world.objects[name]):
        for above in draft.world.above.get(name, ()):
            found |= {above, *draft.tucked.get(above, ())}
    return found


def _targets(problem: Problem) -> set[str]:
    """The objects that the goal and the operators name."""
    targets = {n for names in problem.candidates.values() for n in names}
    targets |= {o.at for o in problem.operators if o.at is not None}
    targets |= {on for o in problem.operators for _, on in o.on}
    return targets


def _add_surfaces(draft: ProblemDraft, anywhere: Collection[str]) -> None:
    """Fill the surfaces of a problem; the objects `anywhere` may be put on each of them."""
    problem, world = draft.problem, draft.world
    moved = problem.limits
    surfaces = dict.fromkeys(on for name in moved for on in draft.surfaces.get(name, ()))
    for name in moved:
        holder = world.objects[name].holder
        if holder is not None and name not in problem.held:
            surfaces.setdefault(holder)
    for name in moved:
        options = list(dict.fromkeys(draft.surfaces.get(name, ())))
        if name in anywhere or name in problem.held:
            for on in surfaces:
                item = world.objects.get(on)
                if on == name or on in options or (item is None and on not in draft.graph.nodes):
                    continue
                movable = item is not None and on in moved
                if not movable and draft.unsuitable(name, on) is None:
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
        below = world.objects.get(item.holder or "")
        rides = below is not None and below.carrier and below.name in moved
        if name not in problem.held:
            problem.spots[name] = sites.of_object(below if rides and below is not None else item)
        stays = item.carrier or item.obstacle(draft.heights) is not None
        if name not in moved and (stays or not (rides or draft.needs_space(item))):
            problem.fixed.add(name)


def _add_holders(draft: ProblemDraft, targets: set[str]) -> None:
    problem, world = draft.problem, draft.world
    relevant = {*problem.limits, *problem.takes, *targets}
    above = {n for on in relevant if on not in problem.fixed for n in world.above.get(on, ())}
    for name in relevant | above:
        item = world.objects.get(name)
        if item is not None and item.holder is not None and name not in problem.held:
            problem.on[name] = item.holder


def _add_travel_times(draft: ProblemDraft) -> None:
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
