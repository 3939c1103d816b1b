"""Sites: where the robot stands for the entities of a goal, and whether routes lead there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from planner.infeasibility import infeasibility
from planner.route_search import seconds_between
from planner.routing_graph import Endpoint, RoutingGraph
from planner.tasks.world import TaskObject, TaskWorld
from semmap.geometry.pose import Pose

__all__ = ["ApproachPoseOf", "Sites"]

ApproachPoseOf = Callable[[TaskObject], Pose | None]


class Sites:
    """Sites by number, in the order of their first use; the first is that of the robot.

    Parameters
    ----------
    approach_pose
        Returns the base pose for an object; by default its `approach_pose`, or else its own pose on
        the floor.
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
        self.approach_pose = approach_pose or _stand
        self.all: list[Endpoint] = []
        self._numbers: dict[tuple[str, Pose | None], int] = {}
        self._away: dict[int, float] = {}  # seconds from the robot, where queried
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
        return 0 if item.place is None else self.at(item.place, self.approach_pose(item))

    def of_floor(self, place: str) -> int:
        """The number of the site of a floor: at the first door of the place."""
        nodes = self.graph.nodes.get(place)
        return self.at(place, None if nodes is None else self.graph.poses[nodes[0]])

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
        reason = infeasibility(self.graph, self.all[0], self.all[number]).partition(": ")[2]
        return f"{name} cannot be reached: {reason}"


def _stand(item: TaskObject) -> Pose | None:
    if item.approach_pose is not None or item.pose is None:
        return item.approach_pose
    return item.pose._replace(z=item.pose.z - item.height)
