"""Sites: where the robot stands for the entities of a goal, and whether routes lead there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
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

ApproachPosesOf = Callable[[Target], Iterable[Pose]]
"""Returns the base poses for a target, the best first; a NoRouteError says why there is none."""


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
        approach_poses: ApproachPosesOf | None,
    ) -> None:
        self.graph, self.world = graph, world
        self.approach_poses = approach_poses or stand
        self.all: list[Endpoint] = []
        self._numbers: dict[tuple[str, Pose | None], int] = {}
        self._away: dict[int, float] = {}  # seconds from the robot, where queried
        self._first: dict[tuple[str, str], tuple[int, Iterator[Pose]]] = {}  # and other poses
        self._found: dict[tuple[str, str], int] = {}  # sites of targets and places
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
        """The number of a target's best site in a place: the first one that routes lead to."""
        key = (target.name, place)
        if key not in self._found:
            self._found[key], others = self._begin(target, place, otherwise)
            if not self.is_reachable(self._found[key]):
                found = (self.at(place, self._on_floor(target, pose)) for pose in others)
                with suppress(NoRouteError):
                    self._found[key] = next(filter(self.is_reachable, found), self._found[key])
        return self._found[key]

    def _begin(
        self, target: Target, place: str, otherwise: Pose | None
    ) -> tuple[int, Iterator[Pose]]:
        """The number of the first site of a target in a place, and the poses of others."""
        key = (target.name, place)
        if key not in self._first:
            poses: Iterator[Pose] = iter(())
            try:
                poses = iter(self.approach_poses(target))
                pose = next(poses, otherwise)
                number = self.at(place, self._on_floor(target, pose))
            except NoRouteError as error:
                number = len(self.all)
                self.all.append(self.graph.endpoint(place, otherwise))
                self._away[number], self._reasons[number] = math.inf, str(error)
            self._first[key] = number, poses
        return self._first[key]

    def _on_floor(self, target: Target, pose: Pose | None) -> Pose | None:
        if isinstance(target, PlaceRegion) and pose is not None:
            return pose._replace(z=self.graph.topology.places[target.places[0]].floor)
        return pose

    def survey(self, items: Iterable[TaskObject]) -> None:
        """Compute the travel times from the robot to many objects at once."""
        self._measure(
            self._begin(item, item.place, item.pose)[0] for item in items if item.place is not None
        )

    def _measure(self, numbers: Iterable[int]) -> None:
        new = [n for n in dict.fromkeys(numbers) if n not in self._away]
        if new:
            took = seconds_between(self.graph, self.all[:1], [self.all[n] for n in new])[0]
            self._away.update(zip(new, took.tolist(), strict=True))

    def is_reachable(self, number: int) -> bool:
        """Whether a route leads from the robot to a site."""
        if number not in self._away:
            self._measure([number])
        return math.isfinite(self._away[number])

    def unreachable_reason(self, number: int, name: str) -> str:
        """Why no route leads to the site of an entity."""
        if number in self._reasons:
            return self._reasons[number]
        reason = infeasibility(self.graph, self.all[0], self.all[number]).partition(": ")[2]
        return f"{name} cannot be reached: {reason}"


def stand(item: Target) -> list[Pose]:
    """The base pose for a target among no obstacles; none anywhere in its place."""
    if isinstance(item, Place):
        return []
    if isinstance(item, PlaceRegion):
        middle = item.outline.representative_point()
        return [Pose.planar(middle.x, middle.y)]
    if item.approach_pose is not None:
        return [item.approach_pose]
    return [] if item.pose is None else [item.pose._replace(z=item.pose.z - item.height)]
