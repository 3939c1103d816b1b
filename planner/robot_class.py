"""The properties of a robot that decide where it can go and how long that takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from navgrid.terrain import DriveLimits
from planner.topology import PlaceConnector
from semmap.finite_number import is_finite_number
from semmap.robot import Part


@dataclass(frozen=True)
class Durations:
    """Seconds that behaviours take; a measured mean counts where there is one.

    Attributes
    ----------
    call
        Waiting for an elevator that was called.
    ride, ride_per_metre
        Riding an elevator once, and more for each metre of height.
    open, unlock
        Opening a closed connector, and unlocking a locked one.
    measured
        Mean seconds by behaviour and name of the connector or elevator.
    """

    call: float = 8.0
    ride: float = 7.0
    ride_per_metre: float = 1.0
    open: float = 2.0
    unlock: float = 10.0
    pickup: float = 10.0
    place: float = 10.0
    measured: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "measured":
                for (behaviour, entity), mean in value.items():
                    if not 0 <= mean < math.inf:
                        raise ValueError(
                            f"durations: {behaviour} of {entity} takes {mean} s; "
                            "give a finite number, 0 or more"
                        )
            elif not 0 <= value < math.inf or (name == "ride" and value == 0):
                least = "above 0" if name == "ride" else "0 or more"
                raise ValueError(f"durations: {name} is {value}; give a finite number, {least}")

    def of_opening(self, connector: PlaceConnector) -> float:
        """Seconds of opening or unlocking a connector; 0 if the robot does not have to."""
        if not connector.must_be_opened:
            return 0.0
        if connector.state == "closed":
            return self.measured.get(("open_door", connector.name), self.open)
        return self.measured.get(("unlock_door", connector.name), self.unlock)

    def of_passing(
        self, connector: PlaceConnector, speed: float, metres: float | None = None
    ) -> float:
        """Seconds through an open connector at `speed` m/s.

        The way is `metres` long, by default as from one approach pose to the other.
        """
        mean = self.measured.get((connector.behaviour, connector.name))
        if mean is not None:
            return mean
        return (connector.metres if metres is None else metres) / speed

    def of_calling(self, elevator: str) -> float:
        """Seconds of waiting for an elevator."""
        return self.measured.get(("call_elevator", elevator), self.call)

    def of_riding(self, elevator: str, height: float) -> float:
        """Seconds of riding an elevator up or down by `height` metres."""
        ride = self.measured.get(("use_elevator", elevator), self.ride)
        return ride + self.ride_per_metre * abs(height)


OTHER_STATE = "if its joints can fold it, add the robot again with posture= (Database.add_robot)"

SAME = 1e-6
"""Metres by which a part may be larger than an opening: files round their numbers."""

_RADIUS = 0.3
_TURNS = np.stack([f((np.arange(16) + 0.5) * math.pi / 8) for f in (np.cos, np.sin)], 1)

BODY = Part(
    "body",
    ("body",),
    (0.0, 1.5),
    (_RADIUS / math.cos(math.pi / 16) * _TURNS).round(9),
    _RADIUS,
    _RADIUS / math.cos(math.pi / 16),
)
"""The shape inside of places of a robot of which nothing is known: 0.6 m wide, 1.5 m high."""

ASSUMED_BODY = (
    f"a robot {2 * _RADIUS:g} m wide and {BODY.interval[1]:g} m high is assumed: "
    "name yours by robot="
)


@dataclass(frozen=True)
class RobotClass:
    """Robots of the same shape and with the same abilities; a number out of range is a ValueError.

    Attributes
    ----------
    name
        Unique in the database.
    parts
        The shape (Deeken et al., section 4.3). A robot without parts is blocked by the states and
        demands of connectors, not by their sizes.
    drive_limits
        Highest step and steepest slope; they count for a robot that has a shape.
    speed
        Metres a second on clear ground.
    behaviours
        Names of the behaviours that it has: it passes no connector that needs another one. None
        stands for all.
    permissions
        It passes a connector that demands permissions if it has one of them.
    opens, unlocks
        Whether it opens closed connectors, and unlocks locked ones.
    outside
        Whether its routes may lead through the outside, which the map does not describe.
    reach
        Lowest and highest distance on the ground from its origin to the objects that it takes,
        metres.
    heights
        Lowest and highest z above the floor of the objects that it takes, metres.
    capacity
        How many objects it carries at once.
    """

    name: str = "robot"
    parts: tuple[Part, ...] = ()
    drive_limits: DriveLimits = field(default_factory=DriveLimits)
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
            raise ValueError("the name of a robot class is empty; give it one")
        for part in self.parts:
            if part.interval[1] <= self.drive_limits.ground:
                raise ValueError(
                    f"robot {self.name}: its part {part.name} ends at {part.interval[1]:.3f} m, "
                    f"below a step of {self.drive_limits.max_step:g} m; give a lower step"
                )
        if not (is_finite_number(self.speed) and self.speed > 0):
            raise ValueError(f"robot {self.name}: its speed is {self.speed} m/s; give one above 0")
        if not (is_finite_number(self.capacity) and self.capacity >= 1):
            raise ValueError(
                f"robot {self.name}: its capacity is {self.capacity} objects; give 1 or more"
            )
        for name in ("reach", "heights"):
            ends = getattr(self, name)
            try:
                low, high = map(float, ends)
            except (TypeError, ValueError):
                raise ValueError(
                    f"robot {self.name}: {name} is {ends}; give two numbers, metres"
                ) from None
            if not 0 <= low < high < math.inf:
                raise ValueError(
                    f"robot {self.name}: {name} is {low} to {high} m; give the lower end first"
                )

    @property
    def rides_elevators(self) -> bool:
        """Whether it has the behaviour ``use_elevator``."""
        return self.behaviours is None or "use_elevator" in self.behaviours

    def blocking_reason(self, connector: PlaceConnector, side: int | None = None) -> str | None:
        """Why the robot cannot pass a connector from ``connector.places[side]``; None if it can.

        Without a side, the direction of the connector does not count.
        """
        name = connector.name
        if side is not None and not connector.passes(side):
            here, there = connector.places[side], connector.places[1 - side]
            return f"{name} leads only from {there} to {here}"
        if connector.state == "locked" and not self.unlocks:
            return f"{name} is locked"
        if connector.must_be_opened and connector.state == "closed" and not self.opens:
            return f"{name} is closed"
        if self.behaviours is not None and connector.behaviour not in self.behaviours:
            return f"{name} needs the behaviour {connector.behaviour}"
        if connector.permissions and not connector.permissions & self.permissions:
            wanted = " or ".join(sorted(connector.permissions))
            return f"{name} needs the permission {wanted}"
        if (small := self.too_wide_for_the_rest(connector)) is not None:
            return small
        return self._misfit(connector) if self.parts else None

    def too_wide_for_the_rest(self, connector: PlaceConnector) -> str | None:
        """Why the objects on stairs or a ramp leave too little of it; None where they do not.

        A robot without a shape is as wide as `BODY`.
        """
        if connector.narrowed is None:
            return None
        free, objects, _ = connector.narrowed
        width = max((width for _, width, _ in self._sizes), default=2 * _RADIUS)
        if width <= free + 2e-3:
            return None
        leave = "leaves" if len(objects) == 1 else "leave"
        gap = f"{free:.2f} m of {connector.name} free" if free else f"no way over {connector.name}"
        return f"{', '.join(objects)} {leave} {gap}; {self.name} is {width:.2f} m wide"

    @property
    def folding_hint(self) -> str:
        """A sentence on another joint state, if a part reaches far beyond the base; else empty."""
        if not self.parts:
            return ""
        widest = max(self.parts, key=lambda part: part.circumscribed_radius)
        if widest.circumscribed_radius < 1.5 * self.parts[0].circumscribed_radius:
            return ""
        reach = widest.circumscribed_radius
        return f"; its {widest.name} reaches {reach:.2f} m around it: {OTHER_STATE}"

    @cached_property
    def _sizes(self) -> list[tuple[str, float, float]]:
        """Name, width and top of each part; a robot passes forwards, along its x axis."""
        return [(p.name, float(np.ptp(p.footprint[:, 1])), p.interval[1]) for p in self.parts]

    def too_large_for(self, connector: PlaceConnector) -> str | None:
        """Which part does not fit through the stated opening of a connector; None if all do."""
        for number, (name, width, top) in enumerate(self._sizes):
            hint = f"; {OTHER_STATE}" if number else ""  # the base, which is first, has one state
            if connector.width is not None and width > connector.width + SAME:
                return (
                    f"the {name} does not fit through {connector.name}: it is {width:.2f} m "
                    f"wide, the opening {connector.width:.2f} m{hint}"
                )
            if connector.height is not None and top > connector.height + SAME:
                return (
                    f"the {name} does not fit under {connector.name}: it reaches to "
                    f"{top:.2f} m, the opening to {connector.height:.2f} m{hint}"
                )
        return None

    def _misfit(self, connector: PlaceConnector) -> str | None:
        if (large := self.too_large_for(connector)) is not None:
            return large
        limits = self.drive_limits
        if connector.step > limits.ground:
            return (
                f"{connector.name} has a step of {connector.step:.2f} m, {self.name} takes "
                f"{limits.max_step:.2f} m"
            )
        if connector.type == "stairs":
            return f"{connector.name} is a flight of stairs"
        if connector.type == "ramp":
            a, b = connector.poses
            slope = math.atan2(abs(a.z - b.z), math.hypot(a.x - b.x, a.y - b.y))
            if slope > limits.max_slope:
                return (
                    f"{connector.name} is {math.degrees(slope):.0f}° steep, {self.name} climbs "
                    f"{math.degrees(limits.max_slope):.0f}°"
                )
        return None
