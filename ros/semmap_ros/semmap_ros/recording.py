"""Record topics to an MCAP file, and play one: ``python -m semmap_ros.recording FILE``.

PyPI has no rosbag2. The files have what its storage `mcap` has: messages as they were sent, the
definitions of their types, and the QoS of their topics.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args

from semmap_ros.latched import LATCHED
from semmap_ros.optional import interface

OMITTED = {"/rosout", "/parameter_events"}
DISCOVERY = 0.5  # seconds between searches for topics
DEPTH = 100  # messages of a topic that wait

QOS = "offered_qos_profiles"
"""The metadata of a topic in which rosbag2 keeps its QoS."""

ENDLESS = {"sec": 9223372036, "nsec": 854775807}


class Recorder(Node):  # type: ignore[misc]
    """Writes the messages of topics as they come; by default those of all topics."""

    def __init__(self, writer: Any, topics: Sequence[str] = ()) -> None:
        super().__init__("semmap_recorder")
        self._writer, self._chosen = writer, {self.resolve_topic_name(t) for t in topics}
        self._schemas: dict[str, int] = {}
        self._seen: set[str] = set(OMITTED)
        self.count = 0
        self._find()
        self.create_timer(DISCOVERY, self._find)

    def _find(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            if topic not in self._seen and (not self._chosen or topic in self._chosen):
                self._listen(topic, kinds[0])

    def _listen(self, topic: str, kind: str) -> None:
        offered = [each.qos_profile for each in self.get_publishers_info_by_topic(topic)]
        if not offered:
            return  # nobody sends yet
        self._seen.add(topic)
        type_ = interface(kind)
        if type_ is None:
            self.get_logger().warning(f"{topic} is left out: this Python has no {kind}")
            return
        latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
        reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
        qos = QoSProfile(
            depth=DEPTH,
            durability=LATCHED.durability if latched else DurabilityPolicy.VOLATILE,
            reliability=LATCHED.reliability if reliable else ReliabilityPolicy.BEST_EFFORT,
        )
        if kind not in self._schemas:
            text = "\n".join(_definition(kind)).encode()
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
        profile = {QOS: _as_yaml(qos, offered[0].depth or DEPTH)}
        channel = self._writer.register_channel(topic, "cdr", self._schemas[kind], profile)

        def keep(message: bytes) -> None:
            now = time.time_ns()
            self._writer.add_message(channel, now, message, now)
            self.count += 1

        self.create_subscription(type_, topic, keep, qos, raw=True)


class Player(Node):  # type: ignore[misc]
    """Sends the messages of a recording at the times at which they came, or faster."""

    def __init__(self) -> None:
        super().__init__("semmap_player")
        self._publishers_of: dict[str, Any] = {}

    def play(self, reader: Any, rate: float = 1.0) -> int:
        """Send all messages; return how many."""
        for channel in reader.get_summary().channels.values():
            self._publisher(reader.get_summary().schemas[channel.schema_id].name, channel)
        begun, first, count = time.monotonic(), None, 0
        for _, channel, message in reader.iter_messages():
            first = message.log_time if first is None else first
            due = begun + (message.log_time - first) / 1e9 / rate
            time.sleep(max(0.0, due - time.monotonic()))
            if channel.topic in self._publishers_of:
                self._publishers_of[channel.topic].publish(message.data)
                count += 1
        return count

    def _publisher(self, kind: str, channel: Any) -> None:
        type_ = interface(kind)
        if type_ is None:
            self.get_logger().warning(f"{channel.topic} is left out: this Python has no {kind}")
            return
        profiles = yaml.safe_load(channel.metadata.get(QOS, "")) or [{}]
        latched = profiles[0].get("durability") in ("transient_local", 1)
        qos = LATCHED if latched else QoSProfile(depth=DEPTH)
        self._publishers_of[channel.topic] = self.create_publisher(type_, channel.topic, qos)


def _definition(kind: str) -> Iterator[str]:
    """The text of a message, and of those in it, as MCAP has them."""
    waiting, seen = [kind], {kind}
    while waiting:
        package, _, name = waiting.pop(0).split("/")
        text = _file(package, name).read_text()
        if (package, name) != (kind.split("/")[0], kind.split("/")[2]):
            yield "=" * 80
            yield f"MSG: {package}/{name}"
        yield text
        for field in interface(f"{package}/msg/{name}").get_fields_and_field_types().values():
            inner = field.removeprefix("sequence<").partition(">")[0].partition("[")[0]
            inner = inner.partition(",")[0]
            if "/" in inner:
                other = inner.replace("/", "/msg/")
                if other not in seen:
                    seen.add(other)
                    waiting.append(other)


def _file(package: str, name: str) -> Path:
    """The definition of a message, below the prefixes of ROS or, from PyPI, that of Python."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        file = Path(prefix, "share", package, "msg", f"{name}.msg")
        if file.is_file():
            return file
    raise FileNotFoundError(f"no {name}.msg of {package} below {prefixes}: source ROS's setup file")


def _as_yaml(qos: QoSProfile, depth: int) -> str:
    """A profile as rosbag2 writes it."""
    profile = {
        "history": "keep_last",
        "depth": depth,
        "reliability": qos.reliability.name.lower(),
        "durability": qos.durability.name.lower(),
        "deadline": ENDLESS,
        "lifespan": ENDLESS,
        "liveliness": "automatic",
        "liveliness_lease_duration": ENDLESS,
        "avoid_ros_namespace_conventions": False,
    }
    return yaml.safe_dump([profile], sort_keys=False)


def record(file: Path, topics: Sequence[str]) -> int:
    """Record until the program is interrupted; return how many messages were written."""
    from mcap.writer import Writer

    with file.open("xb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="semmap")
        node = Recorder(writer, topics)
        try:
            rclpy.spin(node)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        finally:
            node.destroy_node()
            writer.finish()  # type: ignore[no-untyped-call]
    return node.count


def play(file: Path, rate: float, stay: bool) -> int:
    """Play a recording; return how many messages were sent."""
    from mcap.reader import make_reader

    node = Player()
    try:
        with file.open("rb") as stream:
            time.sleep(DISCOVERY)
            count = node.play(make_reader(stream), rate)
        while stay:
            time.sleep(DISCOVERY)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        node.destroy_node()
    return count


def main(arguments: list[str] | None = None) -> int:
    """Record or play; the exit status is 1 where there is nothing."""
    words = sys.argv if arguments is None else arguments
    parser = argparse.ArgumentParser(description="Record topics to an MCAP file, or play one.")
    parser.add_argument("file", type=Path)
    parser.add_argument("topics", nargs="*", help="by default all")
    parser.add_argument("--play", action="store_true", help="send the messages of the file")
    parser.add_argument("--rate", type=float, default=1.0, help="how many times as fast")
    parser.add_argument("--stay", action="store_true", help="keep latched messages at its end")
    given = parser.parse_args(remove_ros_args(words)[1:])
    if given.rate <= 0:
        parser.error("--rate is above 0")
    if given.play and not given.file.is_file():
        parser.error(f"there is no file {given.file}")
    if not given.play and given.file.exists():
        parser.error(f"{given.file} exists: give another name")
    if find_spec("mcap") is None:
        parser.error("recordings need a library: pip install 'semmap[recordings]'")
    rclpy.init(args=words)
    try:
        if given.play:
            count = play(given.file, given.rate, given.stay)
        else:
            count = record(given.file, given.topics)
    finally:
        rclpy.try_shutdown()
    print(f"{count} messages")
    return 0 if count else 1


if __name__ == "__main__":
    sys.exit(main())
