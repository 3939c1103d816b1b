"""The body of a simulated robot: what its behaviours share."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.mission.behaviours import Cause
from planner.mission.command import Command
from planner.mission.sim_world import SimWorld
from planner.topology import Topology
from semmap.geometry.pose import Pose

PathFinder = Callable[[str, Pose, Pose], NDArray[np.float64] | None]
"""Returns the path in a place between two poses, (N, 2) points in the map's frame, or None."""

Work = Generator[float, float, "tuple[Cause | None, str]"]
"""A running behaviour: receives its seconds so far, yields its duration, returns its outcome."""


@dataclass(frozen=True)
class SimBody:
    """A robot in a simulated world."""

    name: str
    world: SimWorld
    cabin_doors: dict[str, dict[str, str]]  # by elevator and door, the cabin behind it
    path: PathFinder
    velocity: float  # m/s, by its clock
    seed: int  # of random failures
    wait: float  # seconds for an elevator that another robot uses

    def fails(self, what: str) -> bool:
        """Whether a behaviour fails this time."""
        return self.world.fails(self.name, what, self.seed)

    def stands_at(self, command: Command) -> bool:
        """Whether the robot is where a command begins."""
        return command.begins(*self.world.robot(self.name))

    def misplaced(self, command: Command) -> tuple[Cause, str]:
        """The outcome of a command that begins elsewhere."""
        place, pose = self.world.robot(self.name)
        return "misplaced", f"{command} does not begin in {place} at ({pose.x:.2f}, {pose.y:.2f})"

    def elevator_of(self, door: str) -> str | None:
        """The elevator behind a door."""
        return next((lift for lift, doors in self.cabin_doors.items() if door in doors), None)


def cabin_doors(topology: Topology) -> dict[str, dict[str, str]]:
    """For each elevator, the cabin behind each of its doors."""
    return {
        lift: {
            connector.name: place
            for connector in topology.connectors.values()
            for place in connector.places
            if place in cabins
        }
        for lift, cabins in topology.cabins().items()
    }


def lasting(seconds: float) -> Generator[float, float, None]:
    """Wait until a behaviour has run for these seconds."""
    while (yield seconds) < seconds:
        pass
