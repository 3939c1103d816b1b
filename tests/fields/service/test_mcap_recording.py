"""Recordings of ROS 2 in MCAP, written by two other programs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from semmap.fields.service.mcap_recording import McapPercepts
from semmap.fields.service.percept_feeds import make_feed
from semmap.fields.sources.manager import EndOfPercepts
from semmap.fields.sources.percepts import Gaze, People, RobotState, Segmentation
from semmap.geometry.pose import Pose
from tests.fields.service.ros_recordings import (
    Message,
    bag,
    camera_info,
    image,
    joints,
    mcap,
    pose,
    transforms,
)

NOW = datetime(2026, 1, 1, tzinfo=UTC)
Writer = Callable[[Path, Iterable[Message]], Path]
ROOT = Pose.planar(1, 2, 0.5).matrix
HEAD = Pose.planar(0, 0, -0.2, 1.5).matrix
LOOK = Pose(0.1, 0, 0, 0, 0.5**0.5, 0, 0.5**0.5).matrix


@pytest.fixture(params=[bag, mcap])
def write(request: pytest.FixtureRequest) -> Writer:
    return request.param  # type: ignore[no-any-return]


def percepts(path: Path, kind: str, **options: Any) -> list[tuple[float, Any]]:
    return [(after, made(NOW)) for after, made in McapPercepts(path, kind, options)]


def test_gazes_are_frames_of_people(write: Writer, tmp_path: Path) -> None:
    """Chains of transforms; the head moves the gaze that is fixed to it."""
    path = write(
        tmp_path / "walk",
        [
            (0.0, "/tf_static", transforms(("head", "gaze_anna", LOOK))),
            (0.5, "/tf", transforms(("odom", "head", HEAD))),
            (1.0, "/tf", transforms(("map", "odom", ROOT))),
            (1.5, "/tf", transforms(("map", "odom", ROOT))),
            (2.0, "/tf", transforms(("odom", "head", ROOT))),
            (2.5, "/tf", transforms(("map", "wheel", ROOT))),
            (13.0, "/tf", transforms(("map", "odom", ROOT))),
        ],
    )
    found = percepts(path, "gaze")
    assert [after for after, _ in found] == [1.0, 2.0, 13.0], "connected; moved; too old"
    assert all(isinstance(each, Gaze) and each.time == NOW for _, each in found)
    for (_, each), head in zip(found, (HEAD, ROOT), strict=False):
        np.testing.assert_allclose(each.poses["anna"], ROOT @ head @ LOOK, atol=1e-12)
    assert found[2][1].poses == {}


def test_people_are_poses_of_topics(write: Writer, tmp_path: Path) -> None:
    path = write(
        tmp_path / "walk",
        [
            (0.0, "/tf_static", transforms(("map", "laser", ROOT))),
            (0.1, "/other", joints(arm=1.0)),
            (0.5, "/anna", pose("laser", Pose.planar(3, 0, 0.25).matrix)),
            (1.0, "/anna", pose("laser", Pose.planar(3.5, 0, 0.25).matrix)),
            (3.0, "/ben", pose("map", Pose.planar(7, 8, 0).matrix)),
        ],
    )
    found = percepts(path, "people", agents={"anna": "/anna", "ben": "/ben"}, floor=0.3)
    assert [after for after, _ in found] == [0.5, 1.0, 3.0]
    first, second, third = (each.people for _, each in found if isinstance(each, People))
    ahead = np.array([np.cos(0.5), np.sin(0.5)])
    anna = first["anna"]
    np.testing.assert_allclose((anna.x, anna.y), (1, 2) + 3 * ahead)
    assert (anna.yaw, anna.z, anna.vx, anna.vy) == (pytest.approx(0.75), 0.3, 0, 0)
    np.testing.assert_allclose((second["anna"].vx, second["anna"].vy), ahead)
    assert (third["ben"].x, third["ben"].y) == (7, 8)
    assert third["anna"].x == second["anna"].x


def test_robots_have_joints(write: Writer, tmp_path: Path) -> None:
    path = write(
        tmp_path / "walk",
        [
            (0.0, "/joint_states", joints(arm=0.25, head=1.0)),
            (1.0, "/tf", transforms(("map", "base_link", ROOT))),
            (2.0, "/joint_states", joints(arm=0.5)),
        ],
    )
    (_, first), (_, second) = percepts(path, "robot")
    assert isinstance(first, RobotState)
    np.testing.assert_allclose(first.pose, ROOT, atol=1e-12)
    assert (first.joints, second.joints) == ({"arm": 0.25, "head": 1}, {"arm": 0.5, "head": 1})


@pytest.mark.parametrize("encoding", ["32FC1", "16UC1"])
def test_depth_images_have_labels(write: Writer, tmp_path: Path, encoding: str) -> None:
    depth, labels = np.array([[1.0, 2.5, 0.0]] * 2), np.array([[0, 3, 3]] * 2, np.uint8)
    kept = depth.astype(np.float32) if encoding == "32FC1" else (depth * 1000).astype(np.uint16)
    path = write(
        tmp_path / "look",
        [
            (0.0, "/tf_static", transforms(("map", "lens", ROOT))),
            (0.0, "/camera/depth/camera_info", camera_info("lens", 500, 501, 1.5, 1)),
            (1.0, "/camera/depth/image_rect_raw", image("lens", 1.0, kept, encoding)),
            (1.1, "/camera/labels", image("lens", 1.0, labels, "mono8")),
            (2.0, "/camera/depth/image_rect_raw", image("lens", 2.0, kept, encoding)),
            (2.1, "/camera/labels", image("lens", 1.5, labels, "mono8")),
        ],
    )
    ((after, seen),) = percepts(path, "image", names={3: "mug"})
    assert after == pytest.approx(1.1)
    assert isinstance(seen, Segmentation)
    np.testing.assert_allclose(seen.depth, depth)
    np.testing.assert_array_equal(seen.labels, labels)
    assert (seen.names, seen.intrinsics) == ({3: "mug"}, (500, 501, 1.5, 1))
    np.testing.assert_allclose(seen.pose, ROOT, atol=1e-12)


def test_a_feed_keeps_the_pace(tmp_path: Path) -> None:
    path = mcap(tmp_path / "walk.mcap", [(s, "/anna", pose("map", ROOT)) for s in (0, 4, 100)])
    given = {"mcap": str(path), "agents": {"anna": "/anna"}, "speed": 10}
    begin = datetime.now(UTC) - timedelta(seconds=0.5)
    feed = make_feed(given, "bodies", begin, source="standing_people")
    seen = feed()
    assert isinstance(seen, People)
    assert seen.time == begin + timedelta(seconds=0.4)
    feed = make_feed(given, "bodies", begin - timedelta(minutes=1), source="standing_people")
    assert feed() is not None
    with pytest.raises(EndOfPercepts):
        feed()


def test_wrong_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = mcap(
        tmp_path / "walk.mcap",
        [(0, "/anna", pose("laser", ROOT)), (1, "/tf", transforms(("odom", "gaze_anna", ROOT)))],
    )
    for kind, options, message in (
        ("gaze", {}, "connected to the frame map; the frames of /tf are gaze_anna, odom"),
        ("people", {"agents": {"a": "/ann"}}, r"no topic /ann; it has /anna \(geometry_msgs"),
        ("people", {"agents": {"a": "/tf"}}, "/tf is of the type tf2_msgs/msg/TFMessage, not"),
        ("people", {"agents": ["a"]}, "give NAME: /topic"),
        ("image", {}, "options are wrong: .*names"),
        ("robot", {"bse": "x"}, "options are wrong: .*bse"),
        ("smell", {}, "kind is 'smell': give one of gaze, people, robot, image"),
    ):
        with pytest.raises(ValueError, match=message):
            McapPercepts(path, kind, options)
    assert percepts(path, "gaze", frame="odom")
    whole = path.read_bytes()
    for broken in (b"", b"{}", whole[: len(whole) // 2], whole[:-20]):
        (tmp_path / "broken.mcap").write_bytes(broken)
        with pytest.raises(ValueError, match=r"broken\.mcap is not a whole MCAP file"):
            McapPercepts(tmp_path / "broken.mcap", "gaze", {})
    with pytest.raises(ValueError, match="there is no MCAP recording"):
        McapPercepts(tmp_path / "none.mcap", "gaze", {})
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    with pytest.raises(LookupError, match=r"semmap\[recordings\]"):
        McapPercepts(path, "gaze", {})


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_a_recording_that_unpacks_to_far_more_than_its_size_is_refused(
    tmp_path: Path, packing: str
) -> None:
    """49 kB of zeros kept the reader busy for over 100 s."""
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        compression = CompressionType[packing.upper()]
        writer = McapWriter(stream, chunk_size=2**25, compression=compression)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        channel = writer.register_channel("/tf", "cdr", schema)
        for number in range(64):
            writer.add_message(channel, number, bytes(2**20), number)
        writer.finish()
    assert path.stat().st_size < 300_000
    began = time.monotonic()
    with pytest.raises(ValueError, match=r"unpacks to .* times its size"):
        McapPercepts(path, "gaze", {})
    assert time.monotonic() - began < 5.0


def test_a_chunk_that_claims_to_be_small_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "liar.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=2**25, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")
        channel = writer.register_channel("/tf", "cdr", schema)
        writer.add_message(channel, 0, bytes(2**22), 0)
        writer.finish()
    content = path.read_bytes()
    with path.open("rb") as stream:
        (chunk,) = make_reader(stream).get_summary().chunk_indexes
    claimed = chunk.uncompressed_size.to_bytes(8, "little")
    assert content.count(claimed) >= 2  # in the chunk, and in its index
    end = chunk.chunk_start_offset + chunk.chunk_length
    packed = slice(end - chunk.compressed_size, end)
    lie = bytearray(content.replace(claimed, (1000).to_bytes(8, "little")))
    lie[packed] = content[packed]
    path.write_bytes(lie)
    with pytest.raises(ValueError, match=r"not of the size that it claims"):
        McapPercepts(path, "gaze", {})
    lie[packed] = bytes(chunk.compressed_size)
    path.write_bytes(lie)
    with pytest.raises(ValueError, match=r"not a whole MCAP"):
        McapPercepts(path, "gaze", {})


@pytest.mark.parametrize(
    ("definition", "says"),
    [
        (b"==== a=1", "not a whole MCAP"),
        (b"uint8 number", "a message of /tf: .* has no attribute 'transforms'"),
    ],
)
def test_a_recording_with_a_wrong_definition_is_refused(
    tmp_path: Path, definition: bytes, says: str
) -> None:
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start()
        schema = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", definition)
        channel = writer.register_channel("/tf", "cdr", schema)
        writer.add_message(channel, 0, bytes(8), 0)
        writer.finish()
    with pytest.raises(ValueError, match=says):
        McapPercepts(path, "gaze", {})
