"""Whole tasks by answer set programming: "the muffin on desk1" (Deeken et al., section 4.1)."""

from planner.tasks.goal import Goal, GoalError, parse_goal
from planner.tasks.plan import plan_task
from planner.tasks.problem import NoPlanError
from planner.tasks.world import State, Thing, World

__all__ = [
    "Goal",
    "GoalError",
    "NoPlanError",
    "State",
    "Thing",
    "World",
    "parse_goal",
    "plan_task",
]
