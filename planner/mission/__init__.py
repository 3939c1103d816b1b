"""Missions: goals that robots pursue step by step, through failures and restarts (section 4.1)."""

from planner.mission.behaviours import Behaviours, Doing, Observation, Outcome, Seen
from planner.mission.journal import Journal, MissionError
from planner.mission.runner import Result, Runner
from planner.mission.stage import Stage, stages_of

__all__ = [
    "Behaviours",
    "Doing",
    "Journal",
    "MissionError",
    "Observation",
    "Outcome",
    "Result",
    "Runner",
    "Seen",
    "Stage",
    "stages_of",
]
