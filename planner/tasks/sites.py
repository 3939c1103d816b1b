"""Sites: where the robot stands for the entities of a goal, and whether routes lead there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeAlias

from planner.infeasibility import infeasibility
from planner.route import NoRouteError
from planner.route_search import seconds_between
from planner.routing_graph import Endpoint, RoutingGraph
from planner.tasks.world import TaskObject, TaskWorld
from planner.topology import Place, PlaceRegion
from semmap.geometry.pose import Pose

Target: TypeAlias = TaskObject | PlaceRegion | Place
"""An object, a region, or the floor of a place."""

ApproachPoseOf = Callable[[Target], Pose | None]
"""Returns the base pose for a target; a NoRouteError says why there is none."""


class Sites:
    """Sites by number, in the order of their first use; the first is that of the robot.

    By default, base poses are an object's `approach_pose`, or else its own pose on the floor; the
    middle of a region; no pose for a floor.
    """

    def __init__(
        self,
        graph: RoutingGraph,
        world: TaskWorld,
        place: str,
        pose: Pose | None,
        approach_pose: ApproachPoseOf | None,
    ) -> None:
        self.graph, self.world = graph, world
        self.approach_pose = approach_pose or stand
        self.all: list[Endpoint] = []
        self._numbers: dict[tuple[str, Pose | None], int] = {}
        self._away: dict[int, float] = {}  # seconds from the robot, where queried
        self._without_pose: dict[tuple[str, str], int] = {}  # sites of targets and places
        self._reasons: dict[int, str] = {}  # why they have no base pose
        self.at(place, pose)

    def at(self, place: str, pose: Pose | None) -> int:
        """The number of the site of a pose in a place, or of the whole place."""
        key = (place, pose)
        if key not in self._numbers:
            self._numbers[key] = len(self.all)
            self.all.append(self.graph.endpoint(place, pose))
        return self._numbers[key]

    def of(self, name: str) -> int:
        """The number of the site of an object, or of the floor of a place."""
        item = self.world.objects.get(name)
        return self.of_floor(name) if item is None else self.of_object(item)

    def of_object(self, item: TaskObject) -> int:
        """The number of the site of an object; that of the robot if the object is in no place."""
        return 0 if item.place is None else self._site(item, item.place, item.pose)

    def of_floor(self, place: str) -> int:
        """The number of the site of a floor: before a free part of it, else at its first door."""
        nodes = self.graph.nodes.get(place)
        door = None if nodes is None else self.graph.poses[nodes[0]]
        return self._site(self.graph.topology.places[place], place, door)

    def of_region(self, region: PlaceRegion) -> list[int]:
        """The number of a site in a region, in the first of its places in which the robot fits."""
        numbers = [self._site(replace(region, places=(p,)), p, None) for p in region.places]
        return [n for n in numbers if n not in self._reasons][:1] or numbers[:1]

    def _site(self, target: Target, place: str, otherwise: Pose | None) -> int:
        """The number of the site of a target in a place."""
        if (target.name, place) in self._without_pose:
            return self._without_pose[target.name, place]
        try:
            pose = self.approach_pose(target) or otherwise
        except NoRouteError as error:
            number = self._without_pose[target.name, place] = len(self.all)
            self.all.append(self.graph.endpoint(place, otherwise))
            self._away[number], self._reasons[number] = math.inf, str(error)
            return number
        if isinstance(target, PlaceRegion) and pose is not None:
            pose = pose._replace(z=self.graph.topology.places[place].floor)
        return self.at(place, pose)

    def survey(self, numbers: Iterable[int]) -> None:
        """Compute the travel times from the robot to many sites at once."""
        new = [n for n in dict.fromkeys(numbers) if n not in self._away]
        if new:
            took = seconds_between(self.graph, self.all[:1], [self.all[n] for n in new])[0]
            self._away.update(zip(new, took.tolist(), strict=True))

    def is_reachable(self, number: int) -> bool:
        """Whether a route leads from the robot to a site."""
        if number not in self._away:
            self.survey([number])
        return math.isfinite(self._away[number])

    def unreachable_reason(self, number: int, name: str) -> str:
        """Why no route leads to the site of an entity."""
        if number in self._reasons:
            return self._reasons[number]
        reason = infeasibility(self.graph, self.all[0], self.all[number]).partition(": ")[2]
        return f"{name} cannot be reached: {reason}"


def stand(item: Target) -> Pose | None:
    """The base pose for a target among no obstacles; None anywhere in its place."""
    if isinstance(item, Place):
        return None
    if isinstance(item, PlaceRegion):
        middle = item.outline.representative_point()
        return Pose.planar(middle.x, middle.y)
    if item.approach_pose is not None or item.pose is None:
        return item.approach_pose
    return item.pose._replace(z=item.pose.z - item.height)
