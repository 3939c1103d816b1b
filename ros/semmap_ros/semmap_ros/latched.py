"""Topics whose last message late subscribers get, too."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LATCHED = QoSProfile(
    depth=1,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    reliability=ReliabilityPolicy.RELIABLE,
)


class LatchedTopics:
    """The latched topics of a node; a publisher is made for the first message on its topic."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publishers: dict[str, Any] = {}

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message, which is kept in place of the former one."""
        if topic not in self._publishers:
            made = self._node.create_publisher(type(message), topic, LATCHED)
            self._publishers[topic] = made
        self._publishers[topic].publish(message)

    def withdraw_others(self, topics: Iterable[str] = ()) -> None:
        """End all topics but these, so that nobody gets their last messages any more."""
        for topic in self._publishers.keys() - {*topics}:
            self._node.destroy_publisher(self._publishers.pop(topic))
