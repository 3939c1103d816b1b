"""Passages of connectors: how long a class of robots takes, and which of them it cannot make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from planner.duration import Durations
from planner.robot_class import RobotClass
from planner.topology import PlaceConnector

_DECISIVE = attrgetter("state", "type", "behaviour", "permissions", "width", "height", "step")
"""What decides whether a robot is blocked, except the direction and the slope of a ramp."""


class Passages:
    """The passages of connectors by one class of robots, two for each connector.

    `elevators` has the elevator of each place that is a cabin.
    """

    def __init__(
        self, robot: RobotClass, durations: Durations, elevators: Mapping[str, str]
    ) -> None:
        self._robot = robot
        self._durations = durations
        self._elevators = elevators

    def seconds(
        self, connectors: Sequence[PlaceConnector], metres: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(2 n,) seconds of passing each connector from either side, over so many metres."""
        durations, elevators = self._durations, self._elevators
        found = metres / self._robot.speed
        for i, connector in enumerate(connectors):
            if durations.measured:
                found[2 * i : 2 * i + 2] = durations.of_passing(connector, self._robot.speed)
            if connector.state != "open":
                found[2 * i : 2 * i + 2] += durations.of_opening(connector)
            a, b = connector.places
            if (a in elevators or b in elevators) and elevators.get(a) != elevators.get(b):
                for side, there in enumerate((b, a)):  # the elevator has to be called first
                    if there in elevators:
                        found[2 * i + side] += durations.of_calling(elevators[there])
        return found

    def blocked(self, connectors: Sequence[PlaceConnector]) -> NDArray[np.bool_]:
        """(2 n,) whether the robot cannot pass each connector from either side."""
        blocked: list[bool] = []
        known: dict[tuple[object, ...], bool] = {}  # most doors are alike
        for c, key in zip(connectors, map(_DECISIVE, connectors), strict=True):
            answer = known.get(key)
            if answer is None or c.type == "ramp":
                answer = known[key] = self._robot.blocking_reason(c) is not None
            blocked.append(answer)
        found = np.repeat(np.array(blocked, np.bool_), 2)
        for i, c in enumerate(connectors):
            if c.direction != "both":
                found[2 * i : 2 * i + 2] |= [not c.passes(0), not c.passes(1)]
        return found

    def elevator_to_call(self, here: str, there: str) -> str | None:
        """The elevator that must come before a robot can pass from one place to another."""
        a, b = self._elevators.get(here), self._elevators.get(there)
        return b if a != b else None
