"""Costmaps follow the joints of the robot and the grid that it made of its scans."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import semmap
from navgrid.nav2 import as_occupancy
from tests.robot.robots import real_robot
from tests.ros.conftest import Peer, RunNode, header, refused, url_of

COSTS, GRIDS = "/semmap/ground_floor/costmap", "nav_msgs/msg/OccupancyGrid"
JOINTS, STATES = "/joint_states", "sensor_msgs/msg/JointState"
SCANNED = "/scanned"


@pytest.fixture(scope="module")
def robot() -> str:
    return str(real_robot("tiago"))


@pytest.fixture(scope="module")
def node(run_node: RunNode, small_house: semmap.Map, robot: str) -> Iterator[None]:
    inputs = {"joint_states": JOINTS, "scanned_grid": SCANNED}
    url = url_of(small_house)
    with run_node(url, "house", robot=robot, resolution=0.1, **inputs):
        yield


def cells(message: dict[str, Any]) -> np.ndarray:
    return np.array(message["data"]).reshape(message["info"]["height"], message["info"]["width"])


def expected(map: semmap.Map, robot: str, **options: Any) -> np.ndarray:
    return as_occupancy(map.costmap(robot, resolution=0.1, **options).master)


@pytest.mark.usefixtures("node")
def test_costmaps_are_of_the_posture_that_the_joints_have(
    peer: Peer, small_house: semmap.Map, robot: str
) -> None:
    peer.listen(COSTS, GRIDS)
    np.testing.assert_array_equal(cells(peer.take(COSTS, seconds=90)), expected(small_house, robot))
    posture = {"arm_2_joint": 0.5, "arm_1_joint": 1.6, "torso_lift_joint": 0.2}
    wheels = {"wheel_left_joint": 17.0}
    both = posture | wheels
    state = {"header": header(""), "name": [*both], "position": [*both.values()]}
    peer("send", JOINTS, STATES, state)
    now = cells(peer.take(COSTS, seconds=90))
    np.testing.assert_array_equal(now, expected(small_house, robot, posture=posture))
    wheels["wheel_left_joint"] += 3.0
    both = posture | wheels
    peer("send", JOINTS, STATES, state | {"position": [*both.values()]})
    with pytest.raises(AssertionError):
        peer.take(COSTS, seconds=5)


@pytest.mark.usefixtures("node")
def test_occupied_cells_of_a_scanned_grid_are_obstacles(peer: Peer) -> None:
    peer.listen(COSTS, GRIDS)
    before = peer.take(COSTS, seconds=90)
    free = cells(before) == 0
    row, column = (int(n) for n in np.argwhere(free)[len(np.argwhere(free)) // 2])
    origin = before["info"]["origin"]["position"]
    seen = np.full((4, 4), -1)
    seen[1:3, 1:3] = 100
    x, y = origin["x"] + 0.1 * (column - 1.5), origin["y"] + 0.1 * (row - 1.5)
    info = {"resolution": 0.1, "width": 4, "height": 4}
    info["origin"] = {"position": {"x": x, "y": y}, "orientation": {"w": 1.0}}
    message = {"header": header("map_ground_floor"), "info": info, "data": seen.ravel().tolist()}
    peer("send", SCANNED, GRIDS, message, True)
    after = cells(peer.take(COSTS, lambda m: cells(m)[row, column] == 100, seconds=90))
    changed = np.argwhere(after != cells(before))
    assert np.abs(changed - (row, column)).max() <= 20  # within the inflation
    assert (after >= cells(before)).all()


@pytest.mark.usefixtures("node")
@pytest.mark.parametrize(
    ("topic", "kind", "message", "reason"),
    [
        (JOINTS, STATES, {"name": ["arm_1_joint"], "position": []}, "1 joints have 0 positions"),
        (JOINTS, STATES, {"name": ["arm_1_joint"], "position": [float("nan")]}, "not finite"),
        (SCANNED, GRIDS, {"header": {"frame_id": "nowhere"}}, "frame 'nowhere' is not of the map"),
        (SCANNED, GRIDS, {"header": {"frame_id": "map"}}, "that of a storey"),
        (SCANNED, GRIDS, {"header": {"frame_id": "map_ground_floor"}}, "finite metres"),
    ],
)
def test_what_is_wrong_is_named_and_changes_nothing(
    topic: str, kind: str, message: dict[str, Any], reason: str, peer: Peer
) -> None:
    peer.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", latched=False)
    peer("send", topic, kind, message, topic == SCANNED)
    peer.take("/diagnostics", lambda array: reason in refused(array)[1])
