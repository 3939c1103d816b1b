"""The interface to the software of a robot: its behaviours, and what it observes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

from planner.mission.command import Command
from semmap.geometry.pose import Pose

Cause = Literal[
    "locked",
    "closed",
    "blocked",
    "absent",
    "missed",
    "dropped",
    "gone",
    "full",
    "misplaced",
    "unable",
    "unfit",
    "interrupted",
    "cancelled",
]
"""Why a behaviour failed.

- locked, closed: the door is locked, or does not open.
- blocked: the path is blocked.
- absent: the elevator does not come.
- missed, dropped, gone, full: the grasp missed, the object fell or is not there, no space is free.
- misplaced: the robot is not where the behaviour begins.
- unable: the robot does not have the behaviour, or its gripper and arm cannot do it there.
- unfit: its gripper cannot do it, wherever its base stands.
- interrupted, cancelled: its process ended, or it was stopped.
"""


@dataclass(frozen=True)
class Outcome:
    """How a behaviour ended: the cause of a failure, or None, and details in words."""

    cause: Cause | None = None
    message: str = ""
    seconds: float = 0.0  # by the clock of the robot

    @property
    def succeeded(self) -> bool:
        """Whether the behaviour succeeded."""
        return self.cause is None


@dataclass(frozen=True)
class Sighting:
    """Where a robot sees an object: in or on which holder, and its pose in the map's frame."""

    holder: str
    relation: Literal["in", "on"]
    pose: Pose


@dataclass(frozen=True)
class PlaceLook:
    """What a look showed of one place, by names of the map: the object was seen there, or not.

    `visible` is the share of the place that the look showed, in (0, 1]. `hit` and `false_alarm`,
    P(seen | the object is in what was shown) and P(seen | it is not), are those of the detector.
    None: those of the map.
    """

    object: str
    place: str
    seen: bool
    visible: float = 1.0
    hit: float | None = None
    false_alarm: float | None = None


@dataclass(frozen=True)
class RobotObservation:
    """What a robot observes at present.

    Attributes
    ----------
    place, pose
        The room or cabin in which the robot is, and its base in the map's frame.
    holds
        The objects in its grippers, with their poses in the robot's frame.
    seen
        The objects around it that it recognises; others may still be there.
    doors
        The states of the connectors near it: open, closed or locked; ajar if a robot has opened it
        to pass.
    looks
        What a look has shown that ended since the last observation.
    """

    place: str
    pose: Pose
    holds: Mapping[str, Pose] = field(default_factory=dict)
    seen: Mapping[str, Sighting] = field(default_factory=dict)
    doors: Mapping[str, str] = field(default_factory=dict)
    looks: Sequence[PlaceLook] = ()


class RunningBehaviour(Protocol):
    """A behaviour that is running."""

    def poll(self) -> Outcome | None:
        """How the behaviour ended; None while it runs. Does not block."""

    def cancel(self) -> None:
        """Stop as soon as it is safe; returns when the robot stands still."""


class Behaviours(Protocol):
    """The behaviours of a robot. Each method starts a behaviour and returns at once.

    A connector or a domain file may name additional behaviours: they are methods of that name. A
    search needs `open_container`, and `look`, for the object ``command.arguments[0]`` with the
    camera at ``command.camera``, whose answer is in the next observation. A robot without the
    method fails with the cause ``unable``.
    """

    def observe(self) -> RobotObservation:
        """The present observation; called after every behaviour and every restart."""

    def navigate(self, command: Command) -> RunningBehaviour:
        """Drive inside a place to `command.step.leave`."""

    def open_door(self, command: Command) -> RunningBehaviour:
        """Open `command.step.connector`, before which it stands."""

    def pass_door(self, command: Command) -> RunningBehaviour:
        """Go through `command.step.connector` to `command.step.leave`."""

    def call_elevator(self, command: Command) -> RunningBehaviour:
        """Call `command.step.elevator`, and wait until it stands open."""

    def use_elevator(self, command: Command) -> RunningBehaviour:
        """Ride from the cabin `command.step.from_place` to `command.step.to_place`."""

    def switch_map(self, command: Command) -> RunningBehaviour:
        """Load the map `command.step.map` in `command.step.frame`, and localise in it."""

    def pickup(self, command: Command) -> RunningBehaviour:
        """Pick up the object ``command.arguments[0]`` from ``command.arguments[1]``."""

    def place(self, command: Command) -> RunningBehaviour:
        """Put the object ``command.arguments[0]`` down at `command.spot`."""
