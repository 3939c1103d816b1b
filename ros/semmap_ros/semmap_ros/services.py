"""The services of the node: the grid of a storey, a path, and the operations that read."""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetMap, GetPlan
from std_msgs.msg import Header

from navgrid.grid import ROOT_FRAME
from semmap.api.operations import OPERATIONS, Right
from semmap.error import UnknownNameError
from semmap.server.calls import answered_at_once, offered
from semmap.suggestions import suggestion
from semmap_ros import messages
from semmap_ros.optional import Call

if TYPE_CHECKING:
    from semmap_ros.node import MapNode


READING: tuple[Right, ...] = ("reader",)

CALLS = {
    name: call
    for name, call in offered(answered_at_once(OPERATIONS), READING).items()
    if call.operation.result != "Picture"
}
"""The operations that only read and whose answers are JSON, by their names."""


class MapServices:
    """Answers while the node is active; else, and where a map refuses, the answer is empty."""

    def __init__(self, node: MapNode) -> None:
        self._node = node
        self._of_storeys: dict[str, Any] = {}
        node.create_service(GetPlan, "~/get_plan", self._get_plan)
        if Call is not None:
            node.create_service(Call, "~/call", self._call)

    def offer(self, storeys: set[str]) -> None:
        """Have a service ``get_map`` for each storey, given by its name in topics."""
        for storey in self._of_storeys.keys() - storeys:
            self._node.destroy_service(self._of_storeys.pop(storey))
        for storey in storeys - self._of_storeys.keys():
            self._of_storeys[storey] = self._node.create_service(
                GetMap, f"~/{storey}/get_map", partial(self._get_map, storey)
            )

    def _get_map(self, storey: str, _: GetMap.Request, answer: GetMap.Response) -> Any:
        def fill() -> None:
            answer.map = self._node.topics.grids[f"~/{storey}/grid"]

        self._node.attempt("get_map", fill)
        return answer

    def _get_plan(self, request: GetPlan.Request, answer: GetPlan.Response) -> Any:
        def fill() -> None:
            robot = self._node.value("robot") or None
            start, goal = self._point(request.start), self._point(request.goal)
            ways = self._node.map.route(start, goal, robot=robot).ways()
            points = [point for way in ways for point in way["points"]]
            stamp = self._node.get_clock().now().to_msg()
            head = Header(frame_id=ROOT_FRAME, stamp=stamp)
            answer.plan = messages.path_message(points, head)

        self._node.attempt("get_plan", fill)
        return answer

    def _call(self, request: Any, answer: Any) -> Any:
        def fill() -> None:
            if request.operation not in CALLS:
                near = suggestion(request.operation, CALLS, f"there are {', '.join(CALLS)}")
                raise UnknownNameError(f"there is no operation {request.operation}{near}")
            try:
                values = json.loads(request.arguments or "{}")
            except (ValueError, RecursionError) as error:
                raise ValueError(f"the arguments are no JSON: {error}") from None
            if not isinstance(values, dict):
                raise ValueError("the arguments are no JSON object: give them by their names")
            found = CALLS[request.operation](self._node.map, values)
            answer.answer = json.dumps(found)
            answer.done = True

        answer.problem = self._node.attempt("call", fill)
        return answer

    def _point(self, pose: PoseStamped) -> tuple[float, float, float]:
        """The point (x, y, z) of a pose in the map's frame."""
        at = pose.pose.position
        return at.x, at.y, at.z + self._node.topics.height_of(pose.header.frame_id)
