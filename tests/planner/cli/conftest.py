"""The fixtures of missions, for their commands."""

from tests.planner.mission.conftest import mission_url, world

__all__ = ["mission_url", "world"]
