"""A robot with a gripper: Nav2 drives it; its gripper is a file, which outlives its process."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

from planner.mission.behaviours import RobotObservation, Sighting
from planner.mission.command import Command
from semmap.geometry.pose import Pose
from semmap_ros.nav2_robot import Done, Nav2Robot

GRIP = Pose(0.3, 0.0, 0.6)


class Porter(Nav2Robot):
    """It picks up and puts down at once."""

    def observe(self) -> RobotObservation:
        """Its gripper, and where it put the objects."""
        file = Path(os.environ["PORTER"])
        state = json.loads(file.read_text()) if file.exists() else {}
        held = {name: GRIP for name, put in state.items() if put is None}
        put = {
            name: Sighting(spot[0], "on", Pose(*spot[1])) for name, spot in state.items() if spot
        }
        return replace(super().observe(), holds=held, seen=put)

    def pickup(self, command: Command) -> Done:
        """Hold the object."""
        return self._note(command, None)

    def place(self, command: Command) -> Done:
        """Put it at its spot."""
        assert command.spot is not None
        return self._note(command, (command.arguments[-1], list(command.spot)))

    def _note(self, command: Command, put: object) -> Done:
        file = Path(os.environ["PORTER"])
        file.write_text(json.dumps({command.arguments[0]: put}))
        return Done()
