"""Percepts of a recording of ROS 2 in MCAP files: gazes, people, robots and labelled depth images.

Poses are those of topics, or of frames of /tf.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.sources.percepts import Gaze, People, PersonMotion, RobotState, Segmentation
from semmap.geometry.pose import Pose
from semmap.limits import UNPACKED

BUFFER = 10.0  # seconds for which a transform holds, as in the buffer of tf2
TOGETHER = 0.05  # seconds between the stamps of a depth image and of its labels, at most
STEADY = 1.0  # seconds between two poses of a person, at most, for a velocity

TRANSFORMS = ("/tf", "/tf_static")

SMALL = 8 * 2**20  # bytes that any recording may unpack to
SPLIT = "Record it again in smaller files."

KIND_OF_SOURCE = {
    "gaze": "gaze",
    "standing_people": "people",
    "personal_space": "people",
    "people": "image",
    "objects": "image",
    "robot_body": "robot",
}
"""The kind of percept of each installed source."""

Percept = Gaze | People | RobotState | Segmentation
Make = Callable[[datetime], Percept]
Matrix = NDArray[np.float64]

_TYPES = {
    "transforms": ("tf2_msgs/msg/TFMessage",),
    "pose": (
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "nav_msgs/msg/Odometry",
    ),
    "joints": ("sensor_msgs/msg/JointState",),
    "image": ("sensor_msgs/msg/Image",),
    "camera_info": ("sensor_msgs/msg/CameraInfo",),
}
_PIXELS = {
    "32FC1": "f4",
    "16UC1": "u2",
    "mono16": "u2",
    "8UC1": "u1",
    "mono8": "u1",
    "32SC1": "i4",
}


class McapPercepts:
    """The percepts of a recording, an MCAP file or a folder of them, in the order of their times.

    The kinds are keys of `_KINDS`; `options` are those of the kind, and `frame`, in which the map
    is. Raises LookupError: the libraries that read MCAP are not installed. Raises ValueError: there
    is no such recording, it is damaged, lacks a topic or a frame, or an option is wrong.
    """

    def __init__(self, path: Path, kind: str, options: Mapping[str, Any]) -> None:
        if kind not in _KINDS:
            raise ValueError(f"kind is {kind!r}: give one of {', '.join(_KINDS)}")
        self._path, self._kind = path, kind
        self._options = dict(options)
        self._frame = str(self._options.pop("frame", "map"))
        self._files = _files(path)
        self._topics = self._read_topics()
        frames, _ = self._begin()
        if next(iter(self), None) is None:
            raise ValueError(f"{path} has no {kind}: {self._missing(frames)}")

    def __iter__(self) -> Iterator[tuple[float, Make]]:
        """Yield seconds after the first message of the recording, and what makes the percept."""
        frames, read = self._begin()
        first = None
        wanted = {*read.topics, *TRANSFORMS}
        for time, topic, message in self._messages(None):
            first = time if first is None else first
            if topic not in wanted:
                continue
            try:
                if topic in TRANSFORMS:
                    frames.add(message(), time, static=topic == "/tf_static")
                    made = read.on_transforms(frames, time)
                else:
                    made = read.on_message(topic, message(), frames, time)
            except AttributeError as error:  # the recording itself defines its types
                raise ValueError(f"{self._path}: a message of {topic}: {error}") from None
            if made is not None:
                yield time - first, made

    def _begin(self) -> tuple[_Frames, _Reader]:
        try:
            read = _KINDS[self._kind](**self._options)
        except TypeError as error:
            raise ValueError(f"{self._path}: the options are wrong: {error}") from None
        for topic, what in read.topics.items():
            self._check(topic, what)
        return _Frames(self._frame), read

    def _check(self, topic: str, what: str) -> None:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(self._topics.items()))
        if topic not in self._topics:
            if what == "joints":
                return  # a robot may have none
            raise ValueError(f"{self._path} has no topic {topic}; it has {there or 'none'}")
        if self._topics[topic] not in _TYPES[what]:
            raise ValueError(
                f"{self._path}: {topic} is of the type {self._topics[topic]}, not "
                f"{' or '.join(_TYPES[what])}; name another topic: {there}"
            )

    def _missing(self, frames: _Frames) -> str:
        for time, topic, message in self._messages(TRANSFORMS):
            frames.add(message(), time, static=topic == "/tf_static")
        known = ", ".join(sorted({*frames.transforms, *(t[0] for t in frames.transforms.values())}))
        return (
            f"none of its poses is connected to the frame {self._frame}; the frames of /tf are "
            f"{known or 'none'}; name frames or topics by the options, and the map's frame by frame"
        )

    def _read_topics(self) -> dict[str, str]:
        """The type of each topic."""
        found = {}
        for file in self._files:
            with file.open("rb") as stream:
                reader = _guarded(file, partial(_library("mcap.reader").make_reader, stream))
                summary = _guarded(file, reader.get_summary)
            if summary is None:
                raise ValueError(f"{file} has no summary; repair it: mcap recover")
            _check_size(file, summary.chunk_indexes)
            for channel in summary.channels.values():
                schema = summary.schemas.get(channel.schema_id)
                found[channel.topic] = "unknown" if schema is None else schema.name
                if channel.message_encoding != "cdr":
                    found[channel.topic] += f", encoded as {channel.message_encoding}"
        return found

    def _messages(
        self, topics: Iterable[str] | None
    ) -> Iterator[tuple[float, str, Callable[[], Any]]]:
        """Yield time, topic and decoder of each message."""
        make_reader = _library("mcap.reader").make_reader
        decoder = _library("mcap_ros2.decoder").DecoderFactory
        chosen = None if topics is None else [*topics]
        for file in self._files:
            decoders = decoder()
            with file.open("rb") as stream:
                messages = iter(make_reader(stream).iter_messages(topics=chosen))
                while (each := _guarded(file, partial(next, messages, None))) is not None:
                    _, channel, message = each
                    decode = partial(_decoded, file, decoders, *each)
                    yield message.log_time / 1e9, channel.topic, decode


def _check_size(file: Path, chunks: Iterable[Any]) -> None:
    """Refuse a recording that unpacks to far more than its size: it would take minutes to read."""
    refused = partial(_refusal, file)
    claimed = sum(chunk.uncompressed_size for chunk in chunks)
    UNPACKED.check((claimed - SMALL) / max(file.stat().st_size, 1), refused, SPLIT, "unpacks to")
    with file.open("rb") as stream:
        for chunk in chunks:
            if chunk.compression != "lz4":
                continue  # zstd stops at what the chunk claims
            start = chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size
            _guarded(file, partial(stream.seek, start))
            packed = _guarded(file, partial(stream.read, chunk.compressed_size))
            unpacked = _library("lz4.frame").LZ4FrameDecompressor()
            whole = _guarded(
                file, partial(unpacked.decompress, packed, chunk.uncompressed_size + 1)
            )
            if len(whole) != chunk.uncompressed_size or not unpacked.eof:
                raise ValueError(f"{file}: a chunk is not of the size that it claims: record again")


def _refusal(file: Path, problem: str, fix: str) -> Exception:
    return ValueError(f"{file}: {problem}. {fix}")


def _decoded(file: Path, decoders: Any, schema: Any, channel: Any, message: Any) -> Any:
    decode = _guarded(file, partial(decoders.decoder_for, channel.message_encoding, schema))
    if decode is None:
        raise ValueError(
            f"{file}: {channel.topic} is not a topic of ROS 2 (encoded as "
            f"{channel.message_encoding})"
        )
    return _guarded(file, partial(decode, message.data))


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise LookupError(
            f"MCAP cannot be read ({error}); install the extra: pip install 'semmap[recordings]'"
        ) from None


def _files(path: Path) -> list[Path]:
    found = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if not found or not found[0].is_file():
        raise ValueError(f"there is no MCAP recording {path}: give a file, or a folder of .mcap")
    return found


def _guarded(file: Path, read: Callable[[], Any]) -> Any:
    """Return what a library reads; its errors name the file."""
    try:
        return read()
    except Exception as error:  # the libraries raise many kinds on damaged bytes
        raise ValueError(
            f"{file} is not a whole MCAP file ({error or type(error).__name__}); if its recording "
            "was cut off, repair it: mcap recover"
        ) from None


@dataclass
class _Frames:
    """The newest transform of each frame to its parent."""

    fixed: str
    transforms: dict[str, tuple[str, Matrix, float]] = field(default_factory=dict)

    def add(self, message: Any, time: float, *, static: bool) -> None:
        for each in message.transforms:
            t, r = each.transform.translation, each.transform.rotation
            matrix = _matrix(t.x, t.y, t.z, r)
            until = np.inf if static else time + BUFFER
            child = each.child_frame_id.lstrip("/")
            self.transforms[child] = (each.header.frame_id.lstrip("/"), matrix, until)

    def pose(self, frame: str, time: float) -> Matrix | None:
        """The pose of a frame in the fixed one; None if they are not connected."""
        found, seen = np.eye(4), set()
        frame = frame.lstrip("/")
        while frame != self.fixed:
            if frame in seen or frame not in self.transforms:
                return None
            seen.add(frame)
            parent, matrix, until = self.transforms[frame]
            if time > until:
                return None
            found, frame = matrix @ found, parent
        return found

    def of_message(self, message: Any, pose: Any, time: float) -> Matrix | None:
        """A stamped pose in the fixed frame."""
        frame = self.pose(message.header.frame_id, time)
        at = pose.position
        return None if frame is None else frame @ _matrix(at.x, at.y, at.z, pose.orientation)


def _matrix(x: float, y: float, z: float, q: Any) -> Matrix:
    try:
        return np.asarray(Pose(x, y, z, q.x, q.y, q.z, q.w).matrix, np.float64)
    except ValueError as error:
        raise ValueError(f"a pose in the recording is wrong: {error}") from None


class _PosesReader(ABC):
    """A percept whenever a pose of named agents changes, of topics (begin with /) or frames."""

    def __init__(self, agents: Mapping[str, str], prefix: str = "") -> None:
        if not isinstance(agents, Mapping):
            raise ValueError(f"agents is {agents!r}: give NAME: /topic or NAME: frame")
        self._names = {str(where): str(name) for name, where in agents.items()}
        self._prefix = prefix
        # Topics beside those of transforms, with what they have: a key of `_TYPES`.
        self.topics = {where: "pose" for where in self._names if where.startswith("/")}
        self._now: dict[str, tuple[Matrix, float]] = {}

    def on_transforms(self, frames: _Frames, time: float) -> Make | None:
        named = {f: n for f, n in self._names.items() if not f.startswith("/")}
        if not self._names:
            there = (f for f in frames.transforms if f.startswith(self._prefix))
            named = {f: f.removeprefix(self._prefix) for f in there}
        changed = False
        for frame, name in named.items():
            pose, before = frames.pose(frame, time), self._now.get(name)
            if pose is None:
                changed |= self._now.pop(name, None) is not None
            elif before is None or not np.array_equal(before[0], pose):
                self._now[name], changed = (pose, time), True
        return self._percept() if changed else None

    def on_message(self, topic: str, message: Any, frames: _Frames, time: float) -> Make | None:
        pose = frames.of_message(message, getattr(message.pose, "pose", message.pose), time)
        if pose is None:
            return None
        self._now[self._names[topic]] = (pose, time)
        return self._percept()

    @abstractmethod
    def _percept(self) -> Make | None: ...


class _GazeReader(_PosesReader):
    """Gazes; by default, those of the frames gaze_NAME, as in ROS4HRI (REP 155)."""

    def __init__(self, agents: Mapping[str, str] | None = None) -> None:
        super().__init__(agents or {}, "gaze_")

    def _percept(self) -> Make:
        poses = {name: pose for name, (pose, _) in self._now.items()}
        return lambda when: Gaze(poses, when)


class _PeopleReader(_PosesReader):
    """People, who stand on the floor; by default, those of the frames body_NAME (REP 155)."""

    def __init__(self, agents: Mapping[str, str] | None = None, floor: float = 0.0) -> None:
        super().__init__(agents or {}, "body_")
        self._floor = float(floor)
        self._before: dict[str, tuple[Matrix, float]] = {}

    def _percept(self) -> Make:
        people = {name: self._motion(name, *now) for name, now in self._now.items()}
        self._before = dict(self._now)
        return lambda when: People(people, when)

    def _motion(self, name: str, pose: Matrix, time: float) -> PersonMotion:
        velocity = np.zeros(2)
        former, since = self._before.get(name, (pose, time))
        if 0 < time - since <= STEADY:
            velocity = (pose[:2, 3] - former[:2, 3]) / (time - since)
        x, y = map(float, pose[:2, 3])
        yaw = float(np.arctan2(pose[1, 0], pose[0, 0]))
        return PersonMotion(x, y, yaw, float(velocity[0]), float(velocity[1]), self._floor)


class _RobotReader(_PosesReader):
    """A robot's base, and the positions of its joints."""

    def __init__(self, base: str = "base_link", joints: str = "/joint_states") -> None:
        super().__init__({"robot": base})
        self._joints_topic, self._joints = joints, dict[str, float]()
        self.topics = {**self.topics, joints: "joints"}

    def on_message(self, topic: str, message: Any, frames: _Frames, time: float) -> Make | None:
        if topic == self._joints_topic:
            self._joints.update(zip(message.name, map(float, message.position), strict=False))
            return self._percept()
        return super().on_message(topic, message, frames, time)

    def _percept(self) -> Make | None:
        if "robot" not in self._now:
            return None
        (pose, _), joints = self._now["robot"], dict(self._joints)
        return lambda when: RobotState(pose, when, joints)


class _ImageReader:
    """Depth images with the labels of their pixels; the camera's pose is that of its frame."""

    def __init__(
        self,
        names: Mapping[Any, str],
        depth: str = "/camera/depth/image_rect_raw",
        labels: str = "/camera/labels",
        camera_info: str = "/camera/depth/camera_info",
    ) -> None:
        self._names = {int(number): str(name) for number, name in names.items()}
        self._what = {depth: "depth", labels: "labels", camera_info: "info"}
        self.topics = {depth: "image", labels: "image", camera_info: "camera_info"}
        self._newest: dict[str, Any] = {}

    def on_transforms(self, frames: _Frames, time: float) -> Make | None:
        return None

    def on_message(self, topic: str, message: Any, frames: _Frames, time: float) -> Make | None:
        self._newest[self._what[topic]] = message
        if len(self._newest) < len(self._what):
            return None
        depth, labels, info = (self._newest[each] for each in self._what.values())
        pose = frames.pose(depth.header.frame_id, time)
        if pose is None or abs(_stamp(depth) - _stamp(labels)) > TOGETHER:
            return None
        del self._newest["depth"], self._newest["labels"]
        camera = (info.k[0], info.k[4], info.k[2], info.k[5])
        names = self._names

        def make(when: datetime) -> Segmentation:
            metres = _pixels(depth).astype(np.float32)
            if depth.encoding in ("16UC1", "mono16"):
                metres /= 1000
            numbers = _pixels(labels).astype(np.int32)
            if metres.shape != numbers.shape:
                raise ValueError(
                    f"the depth image has {metres.shape} pixels, its labels {numbers.shape}: "
                    "record labels of the depth image"
                )
            return Segmentation(metres, numbers, names, camera, pose, when)

        return make


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec / 1e9)


def _pixels(image: Any) -> NDArray[Any]:
    """(height, width): the values of an image."""
    if image.encoding not in _PIXELS:
        raise ValueError(
            f"an image has the encoding {image.encoding}, not one of {', '.join(_PIXELS)}"
        )
    kind = np.dtype(_PIXELS[image.encoding]).newbyteorder(">" if image.is_bigendian else "<")
    rows = np.frombuffer(bytes(image.data), np.uint8)[: image.height * image.step]
    rows = rows.reshape(image.height, image.step)[:, : image.width * kind.itemsize]
    return np.ascontiguousarray(rows).view(kind)


_Reader = _PosesReader | _ImageReader

_KINDS: dict[str, Callable[..., _Reader]] = {
    "gaze": _GazeReader,
    "people": _PeopleReader,
    "robot": _RobotReader,
    "image": _ImageReader,
}
