"""Builds the problem of a goal: the objects, surfaces and sites that its plan can use.

Only the objects that a goal names, the objects in their way and the surfaces for them become part
of the problem. So neither the size of the building nor the number of its objects matters.
"""

from __future__ import annotations

from collections.abc import Callable

from planner.routing_graph import RoutingGraph
from planner.tasks.candidate_pruning import CandidatePruning
from planner.tasks.event_limits import count_slots, limit_pickups
from planner.tasks.final_sites import FinalSites
from planner.tasks.goal import Goal
from planner.tasks.goal_objects import GoalObjects
from planner.tasks.goal_words import resolve_words
from planner.tasks.object_checks import ObjectChecks
from planner.tasks.placements import add_placements
from planner.tasks.problem import NoPlanError, Problem
from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.sites import ApproachPoseOf, Sites
from planner.tasks.travel_matrix import add_travel_times
from planner.tasks.world import TaskState, TaskWorld

Extend = Callable[[Problem, TaskWorld], tuple[list[str], int]]
"""Adds operators and facts; returns the objects to hold for them, and the number of more events."""


def build_problem(
    graph: RoutingGraph,
    world: TaskWorld,
    state: TaskState,
    goal: Goal,
    *,
    approach_pose: ApproachPoseOf | None = None,
    extend: Extend | None = None,
) -> Problem:
    """The problem of a goal.

    Raises UnknownObjectError: a word of the goal stands for nothing; GoalError: the goal
    contradicts itself or the world; NoPlanError: the goal cannot be reached.
    """
    sites = Sites(graph, world, state.place, state.pose, approach_pose)
    times = graph.durations
    problem = Problem(goal, state, graph.robot.capacity, times.pickup, times.place)
    draft = ProblemDraft(graph, world, sites, problem)
    checks = ObjectChecks(draft)
    objects = GoalObjects(draft, checks)
    finals = FinalSites(draft)

    _add_held(problem, world)
    resolve_words(problem, world, graph.topology)
    objects.find_wanted()
    extra, more = extend(problem, world) if extend else ([], 0)
    lifted = [n for n in extra if checks.obstacle(n) is None and n not in problem.held]
    objects.find_surfaces()
    aside = limit_pickups(draft, checks, objects, [*lifted, *objects.surfaces])
    if extend is None:
        CandidatePruning(draft, checks, objects, aside, finals).prune()
    add_placements(draft, checks, objects, {*aside, *extra})
    count_slots(draft, checks, more)
    problem.finals = finals.all
    add_travel_times(draft)
    return problem


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
