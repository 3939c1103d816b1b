"""Arms open a drawer and a door from the command line; yourdfpy follows hand and part."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yourdfpy
from numpy.typing import NDArray

import semmap as package
from semmap.geometry.pose import Pose
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.manipulation.cabinets import Cabinet
from tests.manipulation.grippers import real_gripper, urdf

HEIGHT = 0.55
"""Metres from the floor to the bottom of a cabinet."""

DRAWER = Cabinet("drawer", "bar", 0.4, 0.2, 0.4, 0.02, 1, 0.25, 0.045, 0.007, 0.14, apart=True)
DOOR = Cabinet("door", "bar", 0.35, 0.4, 0.3, 0.02, -1, 1.2, 0.045, 0.007, 0.14)
READY = '{"panda_joint2": -0.6, "panda_joint4": -2.2, "panda_joint6": 1.6, "panda_joint7": 0.8}'


class Kitchen(NamedTuple):
    url: str
    folder: Path


@pytest.fixture(scope="module")
def kitchen(make_database: MakeDatabase, tmp_path_factory: pytest.TempPathFactory) -> Kitchen:
    """A drawer and a door, each in a map of its name, and two robots."""
    url = make_database().render_as_string(hide_password=False)
    folder = tmp_path_factory.mktemp("cabinets")
    with package.connect(url) as db:
        for robot in ("tiago", "panda"):
            db.add_manipulator(urdf(robot), robot)
        for cabinet in (DRAWER, DOOR):
            path = folder / f"{cabinet.kind}.urdf"
            db.import_file(cabinet.write(path), map=cabinet.kind)
            db.map(cabinet.kind)["cabinet"].move_to(0, 0, HEIGHT)
    return Kitchen(url, folder)


def planned(kitchen: Kitchen, *words: str) -> dict[str, Any]:
    told = semmap(kitchen.url, *words, "--plan", "--json")
    assert told.exit_code == 0, told.stderr
    assert "positions, planned in" in told.stderr
    (row,) = json.loads(told.stdout)
    return row


def grasps_of(row: dict[str, Any], robot: str, base: Pose, key: str) -> list[NDArray[np.float64]]:
    """Poses of the grasp frame in the map along positions of a row, by yourdfpy."""
    model = yourdfpy.URDF.load(
        str(urdf(robot)), load_meshes=False, filename_handler=lambda file: file
    )
    gripper, found = real_gripper(robot), []
    for position in row[key]:
        model.update_cfg(dict(zip(row["joints"], position, strict=True)))
        palm = np.asarray(model.get_transform(gripper.palm, gripper.robot.base))
        found.append(base.matrix @ palm @ gripper.frame)
    return found


def shares_led(
    kitchen: Kitchen, cabinet: Cabinet, hands: list[NDArray[np.float64]], begin: float = 0
) -> list[float]:
    """The share of its way at which the part has the hand where it was taken, for each pose.

    It was taken at the share `begin`.
    """
    robot = yourdfpy.URDF.load(str(kitchen.folder / f"{cabinet.kind}.urdf"), load_meshes=False)
    stands = Pose(z=HEIGHT).matrix
    every = np.linspace(0, 1, 401)
    parts = []
    for share in every:
        robot.update_cfg({"moves": share * cabinet.travel})
        parts.append(stands @ robot.get_transform(cabinet.kind, "cabinet"))
    held = np.linalg.inv(parts[round(400 * begin)]) @ hands[0]
    ways = np.array([part @ held for part in parts])
    found = []
    for hand in hands:
        away = np.abs(ways - hand).max(axis=(1, 2))
        assert away.min() < 6e-3  # 2 mm and 0.01 rad of inverse kinematics
        found.append(float(every[away.argmin()]))
    return found


def test_a_tiago_pulls_a_drawer_by_its_handle(kitchen: Kitchen) -> None:
    words = ("open", "handle", "--robot", "tiago", "--base", "-1.05,0,0", "--map", "drawer")
    row = planned(kitchen, *words)
    assert row["entity"] == "drawer"
    base = Pose.planar(-1.05, 0, 0)
    hands = grasps_of(row, "tiago", base, "open_positions")
    shares = shares_led(kitchen, DRAWER, hands)
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == pytest.approx((0, 1), abs=0.03)
    assert row["back_positions"]


def test_a_panda_opens_a_door_along_its_arc(kitchen: Kitchen) -> None:
    base = (-0.85, -0.2, 0, 0.3)
    given = ",".join(map(str, base))
    words = ("open", "door", "--robot", "panda", "--base", given, "--state", READY)
    row = planned(kitchen, *words, "--map", "door")
    hands = grasps_of(row, "panda", Pose.planar(*base), "open_positions")
    shares = shares_led(kitchen, DOOR, hands)
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == pytest.approx((0, 1), abs=0.03)
    again = semmap(kitchen.url, *words, "--plan", "--map", "door")
    assert "stored before" in again.stderr


def test_a_panda_pushes_an_open_door_to(kitchen: Kitchen) -> None:
    robot = yourdfpy.URDF.load(str(kitchen.folder / "door.urdf"), load_meshes=False)
    robot.update_cfg({"moves": 0.5 * DOOR.travel})
    ajar = robot.get_transform("door", "cabinet")
    with package.connect(kitchen.url) as db:
        db.import_file(kitchen.folder / "door.urdf", map="ajar")
        db.map("ajar")["cabinet"].move_to(0, 0, HEIGHT)
        yaw = float(np.arctan2(ajar[1, 0], ajar[0, 0]))
        db.map("ajar")["door"].move_to(ajar[0, 3], ajar[1, 3], HEIGHT + ajar[2, 3], yaw=yaw)
    base = (-0.85, -0.2, 0, 0.3)
    given = ",".join(map(str, base))
    words = ("turn", "door", "--robot", "panda", "--base", given, "--state", READY)
    row = planned(kitchen, *words, "--map", "ajar")
    assert row["travel"] == pytest.approx(-0.5 * DOOR.travel, abs=1e-3)
    assert "back_positions" not in row
    assert row["to_pre_push"][-1] == pytest.approx(row["approach_positions"][0], abs=0.1)
    hands = grasps_of(row, "panda", Pose.planar(*base), "turn_positions")
    shares = shares_led(kitchen, DOOR, hands, begin=0.5)
    assert shares == sorted(shares, reverse=True)
    assert (shares[0], shares[-1]) == pytest.approx((0.5, 0), abs=0.03)


def test_from_afar_no_handle_is_reached(kitchen: Kitchen) -> None:
    told = semmap(
        kitchen.url, "open", "door", "--robot", "panda", "--base", "-4,0,0", "--map", "door"
    )
    assert told.exit_code == 1
    assert "the arm at (-4, 0) reaches none of" in told.stderr
