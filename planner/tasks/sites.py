"""Where a robot stands for what a goal names, and whether a way leads there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from planner.network import Network, Site
from planner.tasks.world import Thing, World
from semmap.geometry.pose import Pose

__all__ = ["Sites", "StandOf"]

StandOf = Callable[[Thing], Pose | None]


class Sites:
    """Sites by number, as they come up; the first is the robot's own.

    Parameters
    ----------
    stand : where the robot stands for a thing; by default at it, on the ground, where the thing
        does not say better
    """

    def __init__(
        self, network: Network, world: World, place: str, pose: Pose | None, stand: StandOf | None
    ) -> None:
        self.network, self.world = network, world
        self.stand = stand or _stand
        self.all: list[Site] = []
        self._numbers: dict[tuple[str, Pose | None], int] = {}
        self._away: dict[int, float] = {}  # seconds from the robot, as far as asked
        self.at(place, pose)

    def at(self, place: str, pose: Pose | None) -> int:
        """The site of a pose in a place, or of wherever in it."""
        key = (place, pose)
        if key not in self._numbers:
            self._numbers[key] = len(self.all)
            self.all.append(self.network.site(place, pose))
        return self._numbers[key]

    def of(self, name: str) -> int:
        """The site for a thing, or for the floor of a place."""
        thing = self.world.things.get(name)
        return self.of_floor(name) if thing is None else self.of_thing(thing)

    def of_thing(self, thing: Thing) -> int:
        """Where the robot stands for a thing; the robot's own where it is in no place."""
        return 0 if thing.place is None else self.at(thing.place, self.stand(thing))

    def of_floor(self, place: str) -> int:
        """Where something is put on a place's floor: just inside of its first door."""
        nodes = self.network.nodes.get(place)
        return self.at(place, None if nodes is None else self.network.stands[nodes[0]])

    def survey(self, numbers: Iterable[int]) -> None:
        """Look at once how far many sites are from the robot."""
        new = [n for n in dict.fromkeys(numbers) if n not in self._away]
        if new:
            took = self.network.times_between(self.all[:1], [self.all[n] for n in new])[0]
            self._away.update(zip(new, took.tolist(), strict=True))

    def leads(self, number: int) -> bool:
        """Whether a way leads from the robot to a site."""
        if number not in self._away:
            self.survey([number])
        return math.isfinite(self._away[number])

    def barred(self, number: int, name: str) -> str:
        """Why none leads to the site of something."""
        reason = self.network.why_not(self.all[0], self.all[number]).partition(": ")[2]
        return f"{name} cannot be reached: {reason}"


def _stand(thing: Thing) -> Pose | None:
    if thing.stand is not None or thing.pose is None:
        return thing.stand
    return thing.pose._replace(z=thing.pose.z - thing.height)
