"""Recordings of ROS 2 as MCAP, by two writers that know nothing of semmap."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

TYPES = get_typestore(Stores.ROS2_HUMBLE)
Message = tuple[float, str, Any]
"""Seconds, topic, message."""


def bag(folder: Path, messages: Iterable[Message]) -> Path:
    """A folder as `ros2 bag record --storage mcap` writes it."""
    with BagWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics: dict[str, Any] = {}
        for seconds, topic, message in messages:
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            raw = TYPES.serialize_cdr(message, kind)
            writer.write(topics[topic], 1_700_000_000_000_000_000 + int(seconds * 1e9), raw)
    return folder


def mcap(file: Path, messages: Iterable[Message]) -> Path:
    """A single file by the writer of MCAP's makers."""
    with file.open("wb") as stream:
        writer, schemas = McapWriter(stream), dict[str, Any]()
        for seconds, topic, message in messages:
            kind = message.__msgtype__
            if kind not in schemas:
                text, _ = TYPES.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, text)
            time = 1_700_000_000_000_000_000 + int(seconds * 1e9)
            given = plain(asdict(message))
            writer.write_message(topic, schemas[kind], given, log_time=time, publish_time=time)
        writer.finish()
    return file


def plain(value: Any) -> Any:
    """A message with lists in place of arrays."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def make(kind: str, **fields: Any) -> Any:
    return TYPES.types[kind](**fields)


def header(frame: str, seconds: float = 0.0) -> Any:
    stamp = make("builtin_interfaces/msg/Time", sec=int(seconds), nanosec=int(seconds % 1 * 1e9))
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _parts(matrix: Any) -> tuple[dict[str, float], Any]:
    matrix = np.asarray(matrix, float)
    place = dict(zip("xyz", map(float, matrix[:3, 3]), strict=True))
    turn = map(float, Rotation.from_matrix(matrix[:3, :3]).as_quat())
    return place, make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True)))


def transforms(*each: tuple[str, str, Any]) -> Any:
    """A message of /tf: parent, child and matrix of each."""
    found = []
    for parent, child, matrix in each:
        place, turn = _parts(matrix)
        vector = make("geometry_msgs/msg/Vector3", **place)
        found.append(
            make(
                "geometry_msgs/msg/TransformStamped",
                header=header(parent),
                child_frame_id=child,
                transform=make("geometry_msgs/msg/Transform", translation=vector, rotation=turn),
            )
        )
    return make("tf2_msgs/msg/TFMessage", transforms=found)


def pose(frame: str, matrix: Any) -> Any:
    place, turn = _parts(matrix)
    point = make("geometry_msgs/msg/Point", **place)
    at = make("geometry_msgs/msg/Pose", position=point, orientation=turn)
    return make("geometry_msgs/msg/PoseStamped", header=header(frame), pose=at)


def image(frame: str, seconds: float, pixels: Any, encoding: str) -> Any:
    return make(
        "sensor_msgs/msg/Image",
        header=header(frame, seconds),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def camera_info(frame: str, fx: float, fy: float, cx: float, cy: float) -> Any:
    roi = make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0,
        y_offset=0,
        height=0,
        width=0,
        do_rectify=False,
    )
    return make(
        "sensor_msgs/msg/CameraInfo",
        header=header(frame),
        height=0,
        width=0,
        distortion_model="",
        d=np.zeros(0),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], float),
        r=np.eye(3).reshape(-1),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def joints(**positions: float) -> Any:
    return make(
        "sensor_msgs/msg/JointState",
        header=header(""),
        name=[*positions],
        position=np.array([*positions.values()]),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )
