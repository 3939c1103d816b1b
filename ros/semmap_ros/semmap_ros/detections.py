"""Detections that the node takes; it refuses a message with a fault, and stores nothing of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseArray
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from std_msgs.msg import Header

from semmap.belief.identify import Detection
from semmap_ros.optional import Detection3DArray

if TYPE_CHECKING:
    from semmap_ros.node import MapNode

AHEAD = 0.1
"""Seconds that the clock of a sender may be ahead."""


class MapDetections:
    """Stores detections by `semmap.Map.observe_objects`, one view each message.

    It takes ``~/detections``, whose classes are types of the map, and a topic of poses for each
    ``TOPIC=TYPE`` of the parameter `pose_arrays`.
    """

    def __init__(self, node: MapNode) -> None:
        self._node = node
        qos = qos_profile_sensor_data  # it takes messages of reliable senders, too
        if Detection3DArray is not None:
            take = partial(self._take, "~/detections", _detections)
            node.create_subscription(Detection3DArray, "~/detections", take, qos)
        for each in filter(None, node.value("pose_arrays")):
            topic, _, kind = each.partition("=")
            if not kind:
                raise ValueError(f"pose_arrays has {each!r}: give TOPIC=TYPE")
            take = partial(self._take, topic, partial(_poses, kind))
            node.create_subscription(PoseArray, topic, take, qos)

    def _take(self, topic: str, read: Any, message: Any) -> None:
        self._node.attempt(topic, lambda: self._store(message.header, read(message)))

    def _store(self, header: Header, found: Sequence[Detection]) -> None:
        age = self._age(header)
        height, agent = self._frame(header.frame_id)
        raised = [
            Detection(each.type, (each.point[0], each.point[1], each.point[2] + height), each.sides)
            for each in found
        ]
        at = datetime.now(UTC) - timedelta(seconds=age)
        self._node.map.observe_objects(raised, frame=agent, at=at)

    def _age(self, header: Header) -> float:
        """Seconds since the message's stamp, in the time of the node, which may be simulated."""
        stamp = Time.from_msg(header.stamp, self._node.get_clock().clock_type)
        age: float = (self._node.get_clock().now() - stamp).nanoseconds / 1e9
        oldest = self._node.value("oldest")
        if not -AHEAD < age <= oldest:
            raise ValueError(
                f"the stamp is {age:.1f} s ago: give one of the last {oldest:g} s, set the clocks"
            )
        return max(age, 0.0)

    def _frame(self, frame: str) -> tuple[float, str | None]:
        """The height of a frame in the map's, and the agent whose frame it is, else None."""
        name, _, agent = frame.partition("/")
        if agent and name == self._node.map.name:
            return 0.0, agent
        return self._node.topics.height_of(frame), None


def _poses(kind: str, message: PoseArray) -> list[Detection]:
    return [Detection(kind, _point(pose.position)) for pose in message.poses]


def _detections(message: Any) -> list[Detection]:
    """The most probable class of each detection, and its box, if it has a size."""
    found = []
    for each in message.detections:
        if each.header.frame_id not in ("", message.header.frame_id):
            raise ValueError(
                f"a detection is in {each.header.frame_id!r}, the others in "
                f"{message.header.frame_id!r}: send them by themselves"
            )
        if not each.results:
            raise ValueError("a detection has no hypothesis: give its class")
        scores = [result.hypothesis.score for result in each.results]
        if not all(0 <= score <= 1 for score in scores):
            raise ValueError(f"a detection has the scores {scores}: give numbers from 0 to 1")
        best = max(each.results, key=lambda result: result.hypothesis.score)
        size = each.bbox.size
        sides = (size.x, size.y, size.z)
        boxed = any(sides)
        point = each.bbox.center.position if boxed else best.pose.pose.position
        found.append(Detection(best.hypothesis.class_id, _point(point), sides if boxed else None))
    return found


def _point(point: Any) -> tuple[float, float, float]:
    found = (point.x, point.y, point.z)
    if not all(map(math.isfinite, found)):
        raise ValueError(f"a point is {found}: give finite metres")
    return found
