"""Whole tasks by answer set programming: "the muffin on desk1" (Deeken et al., section 4.1)."""

from planner.tasks.goal import Goal, GoalError, parse_goal
from planner.tasks.problem import NoPlanError
from planner.tasks.solver import find_plan
from planner.tasks.world import TaskObject, TaskState, TaskWorld

__all__ = [
    "Goal",
    "GoalError",
    "NoPlanError",
    "TaskObject",
    "TaskState",
    "TaskWorld",
    "find_plan",
    "parse_goal",
]
