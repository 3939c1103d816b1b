"""Plans cost what a stock planner finds for the exported problem."""

import contextlib
import warnings

import pytest
from hypothesis import given, settings

from planner.routing_graph import RoutingGraph
from planner.tasks import NoPlanError, TaskState, find_plan, parse_goal
from planner.tasks.pddl import write_pddl
from planner.tasks.problem_builder import build_problem
from tests.planner.office import office
from tests.planner.tasks.houses import houses
from tests.planner.tasks.test_solver import office_world


def solved(problem, folder):
    """Milliseconds of the plan of Fast Downward, optimal; None where there is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from unified_planning.io import PDDLReader
        from unified_planning.shortcuts import OneshotPlanner, get_environment

        get_environment().credits_stream = None
        task = PDDLReader().parse_problem(*map(str, write_pddl(problem, folder)))
        # it writes its translation into the working folder, where other tests of it may run
        with contextlib.chdir(folder), OneshotPlanner(name="fast-downward-opt") as planner:
            found = planner.solve(task).plan
    if found is None:
        return None
    metric = task.quality_metrics[0]
    total = 0
    for step in found.actions:
        cost = metric.get_action_cost(step.action)
        if cost is None:
            continue
        bound = dict(zip(step.action.parameters, step.actual_parameters, strict=True))
        value = cost.substitute(
            {task.environment.expression_manager.ParameterExp(p): v for p, v in bound.items()}
        ).simplify()
        total += (
            value.constant_value()
            if value.is_constant()
            else (task.initial_value(value).constant_value())
        )
    return total


def test_figure_4_costs_the_same(tmp_path):
    graph = RoutingGraph(office())
    goal = parse_goal("on(muffin, desk1)")
    problem = build_problem(graph, office_world(), TaskState("lab1"), goal)
    plan = find_plan(graph, office_world(), TaskState("lab1"), goal)
    assert solved(problem, tmp_path) == pytest.approx(1000 * plan.seconds, abs=2)


@settings(max_examples=5)
@given(houses(most_things=2))
def test_random_houses_cost_the_same(tmp_path_factory, house):
    graph = RoutingGraph(house.topology, house.robot)
    goal = parse_goal(house.goal)
    try:
        problem = build_problem(graph, house.world, house.state, goal)
    except NoPlanError:
        return
    found = solved(problem, tmp_path_factory.mktemp("pddl"))
    try:
        plan = find_plan(graph, house.world, house.state, goal)
    except NoPlanError:
        assert found is None
        return
    assert found == pytest.approx(1000 * plan.seconds, abs=len(plan.actions))
