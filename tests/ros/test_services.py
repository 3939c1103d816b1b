"""Operations that other nodes call, fields and labels: all is as in Python."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import semmap
from tests.ros.conftest import Peer, RunNode, url_of

BALLS = "SELECT ?v WHERE { ?v :occupiedBy 'ball' } STORE :occupiedBy"


@pytest.fixture(scope="module")
def house(run_node: RunNode, small_house: semmap.Map) -> Iterator[semmap.Map]:
    small_house.fields.query(BALLS, keep="balls")
    with run_node(url_of(small_house), "house", fields=["balls"]):
        yield small_house


def call(peer: Peer, operation: str, **arguments: Any) -> Any:
    kind = "semmap_ros_interfaces/srv/Call"
    given = {"operation": operation, "arguments": json.dumps(arguments)}
    return peer.call("/semmap/call", kind, **given)


def test_operations_answer_as_their_methods_do(peer: Peer, house: semmap.Map) -> None:
    def answer(operation: str, **arguments: Any) -> Any:
        found = call(peer, operation, **arguments)
        assert (found["done"], found["problem"]) == (True, "")
        return json.loads(found["answer"])

    balls = [each.name for each in house.find("ball")]
    assert [row["name"] for row in answer("find", type="ball")] == balls
    bed = house["Bed_01_001"]
    (room,) = answer("find", type="room", near=[bed.pose.x, bed.pose.y, 0.5], within=0)
    assert room["name"] == bed.room.name
    way = answer("route", start="bedroom", goal="kitchen")
    assert way["seconds"] == pytest.approx(house.route("bedroom", "kitchen").seconds)
    where = answer("where", name="Ball_01_001")
    known = house.where("Ball_01_001")
    assert {row["place"]: row["probability"] for row in where["belief"]} == pytest.approx(
        dict(known), rel=1e-3
    )
    plan = answer("plan", goal="found(Ball_01_001)", start="bedroom")
    assert plan["seconds"] == pytest.approx(
        house.plan("found(Ball_01_001)", start="bedroom").seconds, rel=1e-3
    )


@pytest.mark.parametrize(
    ("operation", "arguments", "said"),
    [
        ("fnd", "{}", "did you mean find?"),
        ("find", "{", "no JSON"),
        ("find", "[1]", "no JSON object"),
        ("find", '{"colour": "red"}', "no argument colour"),
        ("describe", '{"name": "Bal_01_001"}', "Ball_01_001"),
        ("observe", '{"name": "Ball_01_001", "place": "kitchen"}', "no operation observe"),
        ("drop_map", "{}", "no operation drop_map"),
        ("route", '{"start": "bedroom", "goal": "/etc/passwd"}', "passwd"),
        ("find", "[" * 100_000, "no JSON"),
    ],
)
@pytest.mark.usefixtures("house")
def test_what_is_refused_has_a_reason(
    peer: Peer, operation: str, arguments: str, said: str
) -> None:
    kind = "semmap_ros_interfaces/srv/Call"
    found = peer.call("/semmap/call", kind, operation=operation, arguments=arguments)
    assert not found["done"]
    assert found["answer"] == ""
    assert said in found["problem"]


def test_a_stored_field_is_a_cloud_of_the_middles_of_its_voxels(
    peer: Peer, house: semmap.Map
) -> None:
    peer.listen("/semmap/fields/balls", "sensor_msgs/msg/PointCloud2")
    cloud = peer.take("/semmap/fields/balls")
    assert cloud["header"]["frame_id"] == "map"
    assert [(f["name"], f["offset"]) for f in cloud["fields"]][:3] == [("x", 0), ("y", 4), ("z", 8)]
    table = np.frombuffer(bytes(cloud["data"]), "<f4").reshape(cloud["width"], -1)
    assert cloud["point_step"] == 4 * table.shape[1]
    known = house.fields.query("SELECT ?v WHERE { ?v :occupiedBy 'ball' }").rows
    assert len(known) > 10
    points = np.array([voxel for (voxel,) in known])
    np.testing.assert_allclose(sorted(table[:, :3].tolist()), sorted(points.tolist()), atol=1e-5)


@pytest.mark.usefixtures("house")
def test_labels_are_all_types(peer: Peer, house: semmap.Map) -> None:
    peer.listen("/semmap/labels", "vision_msgs/msg/LabelInfo")
    classes = peer.take("/semmap/labels")["class_map"]
    known = {name for (name,) in house.sql("SELECT name FROM semantic_type")}
    assert {each["class_name"] for each in classes} == known
    assert len({each["class_id"] for each in classes}) == len(classes) == len(known)
