"""How long the robot's behaviours take, other than driving inside a place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from planner.topology import PlaceConnector


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
                raise ValueError(f"durations: {name} is {value}; give a finite number above zero")

    def of_opening(self, connector: PlaceConnector) -> float:
        """Seconds of opening or unlocking a connector; 0 if the robot does not have to."""
        if not connector.must_be_opened:
            return 0.0
        if connector.state == "closed":
            return self.measured.get(("open_door", connector.name), self.open)
        return self.measured.get(("unlock_door", connector.name), self.unlock)

    def of_passing(self, connector: PlaceConnector, speed: float) -> float:
        """Seconds from one approach pose of an open connector to the other, at `speed` m/s."""
        mean = self.measured.get((connector.behaviour, connector.name))
        return connector.metres / speed if mean is None else mean

    def of_calling(self, elevator: str) -> float:
        """Seconds of waiting for an elevator."""
        return self.measured.get(("call_elevator", elevator), self.call)

    def of_riding(self, elevator: str, height: float) -> float:
        """Seconds of riding an elevator up or down by `height` metres."""
        ride = self.measured.get(("use_elevator", elevator), self.ride)
        return ride + self.ride_per_metre * abs(height)
