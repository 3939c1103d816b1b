"""The services of the node: the grid of a storey, and a path between two poses."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetMap, GetPlan

from semmap_ros import messages

if TYPE_CHECKING:
    from semmap_ros.node import MapNode

REFUSED = (LookupError, ValueError)
"""What a map raises where it has no answer; the message says why."""


class MapServices:
    """Answers while the node is active; else, and where a map refuses, the answer is empty."""

    def __init__(self, node: MapNode) -> None:
        self._node = node
        self._of_storeys: dict[str, Any] = {}
        node.create_service(GetPlan, "~/get_plan", self._get_plan)

    def offer(self, storeys: set[str]) -> None:
        """Have a service ``get_map`` for each storey, given by its name in topics."""
        for storey in self._of_storeys.keys() - storeys:
            self._node.destroy_service(self._of_storeys.pop(storey))
        for storey in storeys - self._of_storeys.keys():
            self._of_storeys[storey] = self._node.create_service(
                GetMap, f"~/{storey}/get_map", partial(self._get_map, storey)
            )

    def _get_map(self, storey: str, _: GetMap.Request, answer: GetMap.Response) -> Any:
        if self._node.is_active:
            answer.map = self._node.topics.grids[f"~/{storey}/grid"]
        return answer

    def _get_plan(self, request: GetPlan.Request, answer: GetPlan.Response) -> Any:
        node = self._node
        try:
            if not node.is_active:
                raise ValueError(f"the node is {node.state}: activate it first")
            start, goal = (self._point(each) for each in (request.start, request.goal))
            ways = node.map.route(start, goal, robot=node.value("robot") or None).ways()
        except REFUSED as error:
            node.refuse(f"get_plan: {error}")
            return answer
        points = [point for way in ways for point in way["points"]]
        answer.plan = messages.path_message(points, node.get_clock().now().to_msg())
        return answer

    def _point(self, pose: PoseStamped) -> tuple[float, float, float]:
        """The point (x, y, z) of a pose in the map's frame."""
        at = pose.pose.position
        return at.x, at.y, at.z + self._node.topics.height_of(pose.header.frame_id)
