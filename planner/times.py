"""How long a robot takes for what is no walk: opening a door, riding an elevator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from planner.topology import Connector

__all__ = ["Times"]


@dataclass(frozen=True)
class Times:
    """Seconds a behaviour takes; the mean of what was recorded, where there is one.

    Attributes
    ----------
    call : until an elevator that was called stands open
    ride : riding it once; `ride_per_metre` more for each metre of height
    open, unlock : opening a closed connector, unlocking a locked one
    pickup, place : taking a thing, and putting it down
    learned : mean seconds by behaviour and name of the connector or elevator
    """

    call: float = 8.0
    ride: float = 7.0
    ride_per_metre: float = 1.0
    open: float = 2.0
    unlock: float = 10.0
    pickup: float = 10.0
    place: float = 10.0
    learned: Mapping[tuple[str, str], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "learned":
                for (behaviour, of), mean in value.items():
                    if not 0 <= mean < math.inf:
                        raise ValueError(f"times: {behaviour} of {of} takes {mean} s")
            elif not 0 <= value < math.inf or (name == "ride" and value == 0):
                raise ValueError(f"times: {name} is {value}; give a finite number above zero")

    def of_opening(self, connector: Connector) -> float:
        """Opening or unlocking a connector, as its state asks; an elevator opens its own doors."""
        if not connector.shut:
            return 0.0
        if connector.state == "closed":
            return self.learned.get(("open_door", connector.name), self.open)
        return self.learned.get(("unlock_door", connector.name), self.unlock)

    def of_passing(self, connector: Connector, speed: float) -> float:
        """From the pose before a connector to the pose behind it, once it is open."""
        return self.learned.get((connector.behaviour, connector.name), connector.metres / speed)

    def of_calling(self, elevator: str) -> float:
        """Waiting for an elevator."""
        return self.learned.get(("call_elevator", elevator), self.call)

    def of_riding(self, elevator: str, height: float) -> float:
        """Riding an elevator over so many metres of height."""
        ride = self.learned.get(("use_elevator", elevator), self.ride)
        return ride + self.ride_per_metre * abs(height)
