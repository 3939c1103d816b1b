"""Detections that other nodes send: stored in the map, or refused with nothing stored."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

import semmap
from tests.ros.conftest import Peer, RunNode, detection, header, position, refused, url_of
from tests.waiting import wait_until

TOPIC, DETECTIONS = "/semmap/detections", "vision_msgs/msg/Detection3DArray"
BANANAS, POSES = "/tracker/bananas", "geometry_msgs/msg/PoseArray"
TABLE = "KitchenTable_01_001"


@pytest.fixture(scope="module")
def house(run_node: RunNode, small_house: semmap.Map) -> Iterator[semmap.Map]:
    small_house.add_agent("rover", pose=(3.0, 1.0, 0.0, 0.0))
    with run_node(url_of(small_house), "house", pose_arrays=[f"{BANANAS}=banana"], oldest=60.0):
        yield small_house


def on_table(house: semmap.Map, dx: float = 0.0) -> tuple[float, float, float]:
    """A point 4 cm above the table."""
    low, high = house[TABLE].mesh.bounds
    x, y = (low + high)[:2] / 2
    return x + dx, y, high[2] + 0.04


def test_a_detection_becomes_an_object_and_a_marker(peer: Peer, house: semmap.Map) -> None:
    peer.listen("/semmap/markers", "visualization_msgs/msg/MarkerArray")
    point = on_table(house)
    found = [detection("apple", point)]
    peer("send", TOPIC, DETECTIONS, {"header": header(ago=1.0), "detections": found})
    (apple,) = wait_until(lambda: house.find("apple"))
    assert apple.mesh.bounds.mean(axis=0) == pytest.approx(point, abs=0.02)
    assert apple.holder.name == TABLE
    shown = peer.take("/semmap/markers", lambda a: apple.name in [m["text"] for m in a["markers"]])
    assert shown is not None


def test_poses_are_of_the_type_of_their_topic(peer: Peer, house: semmap.Map) -> None:
    """In the frame of an agent, which heads for y: (1, 0) there is (0, 1) in the map."""
    house["rover"].move_to(*on_table(house, 0.2)[:2], 0.0, math.pi / 2)
    x, y, z = on_table(house, 0.2)
    peer("send", BANANAS, POSES, {"header": header("house/rover"), "poses": [position(0.1, 0, z)]})
    (banana,) = wait_until(lambda: house.find("banana"))
    assert banana.pose[:2] == pytest.approx((x, y + 0.1), abs=0.02)


def state(house: semmap.Map) -> list[tuple[Any, ...]]:
    return [
        *house.execute("SELECT count(*) FROM observation"),
        *house.execute("SELECT id, name FROM entity ORDER BY id"),
        *house.execute("SELECT entity_id, pose FROM world ORDER BY entity_id"),
    ]


GOOD = 0.08
"""The side of an apple; an entry that is a number is an apple with this side on the table."""

GARBAGE: list[tuple[dict[str, Any], list[Any], str]] = [
    (header(), [detection("apple", (math.nan, 0, 1))], "give finite metres"),
    (header(), [detection("apple", (math.inf, 0, 1))], "give finite metres"),
    (header(), [-0.1], "above 0"),
    (header(), [math.nan], "above 0"),
    (header("odom"), [GOOD], "frame 'odom' is not of the map"),
    (header("other/rover"), [GOOD], "frame 'other/rover' is not of the map"),
    (header("house/nobody"), [GOOD], "nobody"),
    (header(""), [GOOD], "frame '' is not of the map"),
    (header(), [detection("unicorn", (1, 1, 1))], "unicorn"),
    (header(), [detection("", (1, 1, 1))], "type"),
    (header(), [detection("living_room", (1, 1, 1))], "living_room"),
    (header(), [GOOD, detection("unicorn", (1, 1, 1))], "unicorn"),
    (header(), [detection("apple", (1, 1, 1), results=[])], "no hypothesis"),
    (header(), [detection("apple", (500, 1, 1))], "where no place has room"),
    (header(), [detection("apple", (1, 1, 1), score=math.nan)], "from 0 to 1"),
    (header(), [detection("apple", (1, 1, 1), score=7.0)], "from 0 to 1"),
    (header(), [detection("apple", (1, 1, 1), header=header("map_x"))], "by themselves"),
]


@pytest.mark.parametrize("number", range(len(GARBAGE)))
def test_garbage_is_named_in_the_diagnostics_and_nothing_is_stored(
    peer: Peer, house: semmap.Map, number: int
) -> None:
    head, given, said = GARBAGE[number]
    head = head | header(head["frame_id"])  # of now
    point = on_table(house)
    found = [d if isinstance(d, dict) else detection("apple", point, d) for d in given]
    check_refused(peer, house, {"header": head, "detections": found}, said)


@pytest.mark.parametrize("ago", [1000.0, -60.0, 1e12])
def test_old_future_and_absent_stamps_are_refused(
    peer: Peer, house: semmap.Map, ago: float
) -> None:
    found = [detection("apple", on_table(house))]
    message = {"header": header(ago=ago), "detections": found}
    check_refused(peer, house, message, "the stamp is ")


def check_refused(peer: Peer, house: semmap.Map, message: Any, said: str) -> None:
    peer.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", latched=False)
    before, count = state(house), refused(peer.take("/diagnostics"))[0]
    peer("send", TOPIC, DETECTIONS, message)
    told = peer.take("/diagnostics", lambda array: refused(array)[0] == count + 1)
    assert said in refused(told)[1].split(" | ")[-1]
    assert told["status"][0]["level"] == 0
    assert state(house) == before
