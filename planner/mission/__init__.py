"""Missions: goals that robots pursue step by step, through failures and restarts (section 4.1)."""

from planner.mission.behaviours import (
    Behaviours,
    Outcome,
    RobotObservation,
    RunningBehaviour,
    Sighting,
)
from planner.mission.command import Command, commands_of
from planner.mission.runner import MissionResult, Runner
from planner.mission.store.mission_list import MissionError
from planner.mission.store.missions import MissionStore

__all__ = [
    "Behaviours",
    "Command",
    "MissionError",
    "MissionResult",
    "MissionStore",
    "Outcome",
    "RobotObservation",
    "Runner",
    "RunningBehaviour",
    "Sighting",
    "commands_of",
]
