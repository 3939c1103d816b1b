"""What of a robot decides where it can go and how long that takes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from navgrid.terrain import DriveLimits
from planner.topology import Connector
from semmap.robot import Part

__all__ = ["RobotClass"]


@dataclass(frozen=True)
class RobotClass:
    """Robots that have the same shape and can do the same.

    Attributes
    ----------
    parts : its shape (Deeken et al., section 4.3); without, only the connectors' states bar it
    gait : the highest step and the steepest slope it takes; asked where it has a shape
    speed : metres a second, on clear ground
    behaviours : what it is able to do; it passes no connector that needs another. None: everything
    permissions : it passes a connector whose property `permission` names one of these, or none
    opens, unlocks : whether it opens closed connectors, and unlocks locked ones
    outside : whether its ways may lead through the outside, of which the map knows nothing
    reach : lowest and highest distance of what it takes from its origin, metres on the ground
    heights : lowest and highest z above the floor of what it takes, metres
    capacity : how many things it carries at once
    """

    name: str = "robot"
    parts: tuple[Part, ...] = ()
    gait: DriveLimits = field(default_factory=DriveLimits)
    speed: float = 1.0
    behaviours: frozenset[str] | None = None
    permissions: frozenset[str] = frozenset()
    opens: bool = True
    unlocks: bool = False
    outside: bool = False
    reach: tuple[float, float] = (0.2, 0.8)
    heights: tuple[float, float] = (0.0, 1.6)
    capacity: int = 1

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("a class of robots has a name: give it one")
        for part in self.parts:
            if part.interval[1] <= self.gait.max_step:
                raise ValueError(
                    f"robot {self.name}: its part {part.name} ends at {part.interval[1]:.3f} m, "
                    f"below a step of {self.gait.max_step:g} m; give a lower step"
                )
        if not 0 < self.speed < math.inf:
            raise ValueError(f"robot {self.name}: its speed is {self.speed} m/s; give one above 0")
        if self.capacity < 1:
            raise ValueError(f"robot {self.name} carries {self.capacity} things; give 1 or more")
        for what in ("reach", "heights"):
            low, high = getattr(self, what)
            if not 0 <= low < high < math.inf:
                raise ValueError(
                    f"robot {self.name}: its {what} is {low} to {high} m; give the lower end first"
                )

    @property
    def rides(self) -> bool:
        """Whether it uses elevators."""
        return self.behaviours is None or "use_elevator" in self.behaviours

    def obstacle(self, connector: Connector, side: int) -> str | None:
        """What bars it from passing a connector from ``places[side]``, in words; else None."""
        if not connector.passes(side):
            here, there = connector.places[side], connector.places[1 - side]
            return f"{connector.name} leads only from {there} to {here}"
        return self.bar(connector)

    def bar(self, connector: Connector) -> str | None:
        """What bars it from passing a connector from either side, in words; else None."""
        name = connector.name
        if connector.state == "locked" and not self.unlocks:
            return f"{name} is locked"
        if connector.state == "closed" and connector.shut and not self.opens:
            return f"{name} is closed"
        if self.behaviours is not None and connector.behaviour not in self.behaviours:
            return f"{name} needs the behaviour {connector.behaviour}"
        if connector.permissions and not connector.permissions & self.permissions:
            wanted = " or ".join(sorted(connector.permissions))
            return f"{name} needs the permission {wanted}"
        return self._misfit(connector)

    @cached_property
    def _sizes(self) -> list[tuple[str, float, float]]:
        """Of each part its name, width and height; a robot passes forwards, along its x axis."""
        return [(p.name, float(np.ptp(p.footprint[:, 1])), p.interval[1]) for p in self.parts]

    def _misfit(self, connector: Connector) -> str | None:
        for name, across, top in self._sizes:
            if connector.width is not None and across > connector.width:
                return (
                    f"the {name} does not fit through {connector.name}: it is {across:.2f} m "
                    f"wide, the opening {connector.width:.2f} m"
                )
            if connector.height is not None and top > connector.height:
                return (
                    f"the {name} does not fit under {connector.name}: it reaches to "
                    f"{top:.2f} m, the opening to {connector.height:.2f} m"
                )
        if self.parts and connector.step > self.gait.max_step:
            return (
                f"{connector.name} has a step of {connector.step:.2f} m, {self.name} takes "
                f"{self.gait.max_step:.2f} m"
            )
        if self.parts and connector.type == "stairs":
            return f"{connector.name} is a flight of stairs"
        if self.parts and connector.type == "ramp":
            a, b = connector.poses
            slope = math.atan2(abs(a.z - b.z), math.hypot(a.x - b.x, a.y - b.y))
            if slope > self.gait.max_slope:
                return (
                    f"{connector.name} is {math.degrees(slope):.0f}° steep, {self.name} climbs "
                    f"{math.degrees(self.gait.max_slope):.0f}°"
                )
        return None
