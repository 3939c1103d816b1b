"""The node and its peers in processes of their own, with real DDS on this machine alone."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import semmap
from tests.api.conftest import small_house
from tests.ros_python import ROS_PYTHON, WHY_NOT
from tests.worlds.conftest import hotel, house

__all__ = ["hotel", "house", "small_house"]

ROOT = Path(__file__).parents[2]

RunNode = Callable[..., AbstractContextManager[subprocess.Popen[str]]]


@pytest.fixture(scope="session")
def ros_python() -> str:
    """A Python with rclpy."""
    if not ROS_PYTHON:
        pytest.skip(WHY_NOT)
    return ROS_PYTHON


@pytest.fixture(scope="session")
def ros_environment() -> dict[str, str]:
    """A domain of this test process, on this machine alone; without the settings of a user."""
    return new_environment()


def new_environment() -> dict[str, str]:
    """The environment of a new domain of ROS 2, on this machine alone."""
    own = {k: v for k, v in os.environ.items() if not k.startswith(("ROS_", "RMW_", "FASTDDS_"))}
    return own | {
        "ROS_DOMAIN_ID": str(random.SystemRandom().randrange(1, 100)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONPATH": str(ROOT / "ros/semmap_ros"),
        "PYTHONUNBUFFERED": "1",
    }


class Peer:
    """Another process of the graph; see `tests/ros/peer.py`."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def __call__(self, operation: str, *arguments: Any) -> Any:
        """The result of an operation."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([operation, *arguments]), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())

    def listen(self, topic: str, kind: str, latched: bool = True) -> None:
        """Keep the messages of a topic from now on."""
        self("listen", topic, kind, latched)

    def take(self, topic: str, until: Callable[[Any], bool] = bool, seconds: float = 30) -> Any:
        """The first message that is as it should be; AssertionError if none comes."""
        return self.take_at(topic, until, seconds)[1]

    def take_at(
        self, topic: str, until: Callable[[Any], bool] = bool, seconds: float = 30
    ) -> tuple[float, Any]:
        """As `take`, with the time at which it came."""
        end, last = time.monotonic() + seconds, None
        while (left := end - time.monotonic()) > 0:
            found = self("take", topic, left)
            if found is not None and until(found[1]):
                return found[0], found[1]
            last = found or last
        raise AssertionError(f"{topic}: {seconds} s without such a message; the last: {last}")

    def call(self, service: str, kind: str, seconds: float = 30, **values: Any) -> Any:
        """The answer of a service."""
        found = self("call", service, kind, values, seconds)
        assert found is not None, f"{service} does not answer"
        return found


@pytest.fixture(scope="module")
def peer(ros_python: str, ros_environment: dict[str, str]) -> Iterator[Peer]:
    """A process that subscribes, publishes and calls services."""
    with run([ros_python, str(Path(__file__).parent / "peer.py")], ros_environment) as process:
        yield Peer(process)
        assert process.stdin is not None
        process.stdin.close()  # it ends
        process.wait(20)


@pytest.fixture(scope="module")
def run_node(ros_python: str, ros_environment: dict[str, str], tmp_path_factory: Any) -> RunNode:
    """Run the node on a map: its URL, its name, and further parameters."""
    folder = tmp_path_factory.mktemp("ros")

    @contextmanager
    def node(url: str, map: str, **parameters: Any) -> Iterator[subprocess.Popen[str]]:
        file = folder / "params.yaml"  # not on the command line, which others could read
        values = {"url": url, "map": map, "period": 0.2} | parameters
        file.write_text(json.dumps({"/semmap": {"ros__parameters": values}}))
        words = [ros_python, "-m", "semmap_ros", "--ros-args", "--params-file", str(file)]
        with run(words, ros_environment) as process:
            yield process

    return node


@contextmanager
def run(words: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Run a program until the end of the block."""
    pipe = subprocess.PIPE
    process = subprocess.Popen(words, env=environment, stdin=pipe, stdout=pipe, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()


def url_of(map: semmap.Map) -> str:
    """The URL of a map's database."""
    assert map.database.address is not None
    return map.database.address


def refused(diagnostics: dict[str, Any]) -> tuple[int, str]:
    """How many messages were refused, and why the last ones were."""
    (status,) = diagnostics["status"]
    values = {each["key"]: each["value"] for each in status["values"]}
    return int(values["refused"]), values["last refused"]


def in_map(frames: dict[str, Any], name: str) -> np.ndarray:
    """The pose of a frame in ``map`` as a matrix, by the frames above it."""
    found = np.eye(4)
    while name != "map":
        frame = frames[name]
        shift, turn = frame["transform"]["translation"], frame["transform"]["rotation"]
        found = matrix([*(shift[k] for k in "xyz"), *(turn[k] for k in "xyzw")]) @ found
        name = frame["header"]["frame_id"]
    return found


def matrix(pose: Any) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return made


def header(frame: str = "map", ago: float = 0.0) -> dict[str, Any]:
    at = time.time() - ago
    stamp = {"sec": int(at), "nanosec": int(at % 1 * 1e9)} if ago < at else {}
    return {"frame_id": frame, "stamp": stamp}


def position(x: float, y: float, z: float) -> dict[str, Any]:
    return {"position": {"x": float(x), "y": float(y), "z": float(z)}}


def detection(
    kind: str, point: Any, side: float = 0.08, score: float = 0.9, **more: Any
) -> dict[str, Any]:
    size = {"x": side, "y": side, "z": side}
    sure = {"hypothesis": {"class_id": kind, "score": score}}
    other = {"hypothesis": {"class_id": "dragon", "score": 0.1}}
    return {"results": [other, sure], "bbox": {"center": position(*point), "size": size}} | more
