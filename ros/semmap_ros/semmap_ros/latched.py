"""Topics whose last message late subscribers get, too."""

from __future__ import annotations

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
        self._kept: set[str] = set()

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message, which is kept in place of the former one."""
        if topic not in self._publishers:
            made = self._node.create_publisher(type(message), topic, LATCHED)
            self._publishers[topic] = made
        self._publishers[topic].publish(message)
        self.keep(topic)

    def keep(self, topic: str) -> None:
        """Let a topic keep its last message."""
        self._kept.add(topic)

    def begin(self) -> None:
        """Begin a round, in which each topic that stays is published or kept."""
        self._kept = set()

    def end_others(self) -> None:
        """End the topics that are not of this round; nobody gets their last messages any more."""
        for topic in self._publishers.keys() - self._kept:
            self._node.destroy_publisher(self._publishers.pop(topic))
