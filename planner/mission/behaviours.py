"""What a robot is asked to do, and what it answers: the interface to the robot's own software."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from planner.mission.stage import Stage
from semmap.geometry.pose import Pose

__all__ = ["Behaviours", "Doing", "Observation", "Outcome", "Seen"]

Cause = Literal[
    "locked", "closed", "blocked", "absent", "missed", "dropped", "gone", "full", "misplaced",
    "unable", "interrupted", "cancelled",
]  # fmt: skip
"""Why a behaviour failed: a door is locked or does not open, the way is blocked, the elevator does
not come, the grasp missed, the thing fell, or is not there, nothing is free to put it on, the robot
does not stand where it begins, it cannot do such things, its runner died, it was told to stop."""


@dataclass(frozen=True)
class Outcome:
    """How a behaviour ended.

    Attributes
    ----------
    cause : of a failure; None where it succeeded
    said : in words
    seconds : how long it took, by the robot's clock
    """

    cause: Cause | None = None
    said: str = ""
    seconds: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Whether it did what it was asked."""
        return self.cause is None


@dataclass(frozen=True)
class Seen:
    """Where a thing is seen: in or on which holder, at which pose in the map's frame."""

    holder: str
    relation: Literal["in", "on"]
    pose: Pose


@dataclass(frozen=True)
class Observation:
    """What the robot knows by its own senses, now.

    Attributes
    ----------
    place, pose : where it is: the room or cabin, and its base in the map's frame
    holds : the things in its grippers, with their poses in the robot's frame
    seen : the things around it that it recognises; one that it does not see may still be there
    doors : the connectors before it: open, closed, locked; or ajar: opened for it to pass
    """

    place: str
    pose: Pose
    holds: Mapping[str, Pose] = field(default_factory=dict)
    seen: Mapping[str, Seen] = field(default_factory=dict)
    doors: Mapping[str, str] = field(default_factory=dict)


class Doing(Protocol):
    """A behaviour at work."""

    def poll(self) -> Outcome | None:
        """How it ended; None while it works. Does not wait."""
        ...

    def cancel(self) -> None:
        """Stop as soon as it is safe, and be still when this returns."""
        ...


class Behaviours(Protocol):
    """What a robot can do. Each begins at once, and does not wait for its end.

    A behaviour that a connector or a domain file names is a method of that name, too; a robot
    without it is unable to.
    """

    def observe(self) -> Observation:
        """Where it is, what it holds and sees; asked after every behaviour and every restart."""
        ...

    def navigate(self, stage: Stage) -> Doing:
        """Drive inside of a place to `stage.step.leave`."""
        ...

    def open_door(self, stage: Stage) -> Doing:
        """Open `stage.step.connector`, before which it stands."""
        ...

    def pass_door(self, stage: Stage) -> Doing:
        """Go through `stage.step.connector` to `stage.step.leave`."""
        ...

    def call_elevator(self, stage: Stage) -> Doing:
        """Call `stage.step.elevator`, and wait until it stands open."""
        ...

    def use_elevator(self, stage: Stage) -> Doing:
        """Ride from the cabin `stage.step.from_place` to `stage.step.to_place`."""
        ...

    def switch_map(self, stage: Stage) -> Doing:
        """Load the map `stage.step.map` with the frame `stage.step.frame`, and localise in it."""
        ...

    def pickup(self, stage: Stage) -> Doing:
        """Take the thing ``stage.arguments[0]`` from ``stage.arguments[1]``."""
        ...

    def place(self, stage: Stage) -> Doing:
        """Put the thing ``stage.arguments[0]`` down at `stage.spot`."""
        ...
