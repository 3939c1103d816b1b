"""Another node, driven by lines of JSON: it subscribes, publishes and calls services.

Run by a Python that has rclpy. A line of standard input is ``[operation, arguments...]``, a line
of standard output its result. Messages are dictionaries; arrays of numbers are lists.
"""

from __future__ import annotations

import json
import re
import sys
import threading
import time
from importlib import import_module
from queue import Empty, SimpleQueue
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile


def interface(name: str) -> Any:
    """The class of a type such as ``nav_msgs/msg/Path``."""
    package, kind, own = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), own)


def plain(value: Any) -> Any:
    """A message as JSON has it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value) if len(value) > 1 else value[0]
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, list) else value


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a message."""
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        of = re.fullmatch(r"sequence<(\w+)/(\w+)>", types[name])
        if of is not None:
            made = interface(f"{of[1]}/msg/{of[2]}")
            setattr(message, name, [fill(made(), each) for each in value])
        elif isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


class Peer(Node):  # type: ignore[misc]
    """The node; operations are its methods."""

    def __init__(self) -> None:
        super().__init__("peer")
        self.queues: dict[str, SimpleQueue[Any]] = {}
        self.listeners: dict[str, Any] = {}
        self.senders: dict[str, Any] = {}
        self.servers: dict[str, Any] = {}

    def listen(self, topic: str, kind: str, latched: bool) -> None:
        """Keep the messages of a topic from now on."""
        queue = self.queues[topic] = SimpleQueue()
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=100, durability=durability)

        def keep(message: Any) -> None:
            queue.put((time.time(), message))

        if topic in self.listeners:
            self.destroy_subscription(self.listeners[topic])
        self.listeners[topic] = self.create_subscription(interface(kind), topic, keep, qos)

    def take(self, topic: str, seconds: float) -> Any:
        """The next message with the time at which it came; None if none comes."""
        try:
            at, message = self.queues[topic].get(timeout=seconds)
        except Empty:
            return None
        return [at, plain(message)]

    def call(self, service: str, kind: str, values: dict[str, Any], seconds: float) -> Any:
        """The answer of a service; None if there is none."""
        client = self.create_client(interface(kind), service)
        try:
            if not client.wait_for_service(seconds):
                return None
            answer = client.call(fill(interface(kind).Request(), values), timeout_sec=seconds)
            return plain(answer)
        finally:
            self.destroy_client(client)

    def send(self, topic: str, kind: str, values: dict[str, Any], latched: bool = False) -> None:
        """Publish a message when somebody listens."""
        if topic not in self.senders:
            durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            qos = QoSProfile(depth=10, durability=durability)
            self.senders[topic] = self.create_publisher(interface(kind), topic, qos)
            while not self.senders[topic].get_subscription_count():
                time.sleep(0.01)
            time.sleep(0.3)  # the other side, which is not reliable, has yet to hear of this one
        self.senders[topic].publish(fill(interface(kind)(), values))

    def serve(self, service: str, kind: str, values: dict[str, Any]) -> None:
        """Give the same answer to all requests, and keep them as messages of a topic."""
        queue = self.queues[service] = SimpleQueue()

        def answer(request: Any, made: Any) -> Any:
            queue.put((time.time(), request))
            return fill(made, values)

        if service in self.servers:
            self.destroy_service(self.servers[service])
        self.servers[service] = self.create_service(interface(kind), service, answer)

    def topics(self) -> dict[str, list[str]]:
        """The types of all topics."""
        return dict(self.get_topic_names_and_types())


def spin(node: Node) -> None:
    """Take messages until the end."""
    try:
        rclpy.spin(node)
    except ExternalShutdownException:
        return


def main() -> None:
    """Answer each line of standard input."""
    rclpy.init()
    peer = Peer()
    thread = threading.Thread(target=spin, args=(peer,))
    thread.start()
    try:
        for line in sys.stdin:
            operation, *arguments = json.loads(line)
            print(json.dumps(getattr(peer, operation)(*arguments)), flush=True)
    finally:  # else the process stays, and whoever asked waits for ever
        rclpy.shutdown()
        thread.join()


if __name__ == "__main__":
    main()
