"""How steadily grasps hold an object as it stands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from semmap.geometry.pose import Pose
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.steadiness import HOLD, steadiness, steady_rows, unsteady
from semmap.manipulation.suction import Cup
from tests.manipulation.grippers import SUCTION, Shape

BAR = Shape("cuboid", (0.6, 0.03, 0.03))
"""A bar along x, whose centre of mass is its origin."""


def row(x: float, z: float = 0.0, across: bool = True, **values: Any) -> dict[str, Any]:
    """A grasp from above at (x, 0, z) of a bar as its model, closing across or along it."""
    pose = np.eye(4)
    pose[:3, :3] = (
        [[0, 1, 0], [1, 0, 0], [0, 0, -1]] if across else [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
    )
    pose[:3, 3] = x, 0, z
    there = Pose.from_matrix(pose)
    given: dict[str, Any] = {"attempts": 0, "successes": 0, "shift": None, "expected": 0.8}
    return {"pose": there, "model_pose": there, "width": 0.03} | given | values


@pytest.mark.parametrize(
    ("grasp", "share"),
    [
        (row(0.0), 1),
        (row(0.0, 0.2), 1),  # it hangs straight below
        (row(HOLD), 1 / 2),
        (row(2 * HOLD), 1 / 5),
        (row(2 * HOLD, across=False), 1),  # the weight turns it about no axis that slips
    ],
)
def test_what_hangs_beside_the_pads_turns(grasp: dict[str, Any], share: float) -> None:
    assert steadiness([grasp], BAR) == pytest.approx([share])


def test_only_the_stance_in_the_map_matters() -> None:
    """A bar that stands on its end is held at its end as steadily as in its middle."""
    upright = np.eye(4)
    upright[:3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    end = row(0.25)
    stands = end | {"pose": Pose.from_matrix(upright @ end["model_pose"].matrix)}
    assert steadiness([end], BAR)[0] < 0.03
    assert steadiness([stands], BAR) == pytest.approx([1])


def test_outcomes_and_moves_aside_say_more() -> None:
    rows = [
        row(0.25),  # 25 cm beside the centre: it holds nothing
        row(0.25, successes=1, attempts=1, expected=0.9),
        row(0.25, shift=[0.0, 0.03, 0.0]),
        row(0.25, shift=[0.0, 0.0, 0.015]),  # it only reaches further
        row(HOLD, attempts=2, successes=1, expected=(1 + 2 * 0.8) / 4),
    ]
    found = steady_rows(rows, BAR)
    assert [each["model_pose"].x for each in found] == [0.25, 0.25, HOLD]
    assert all(0 <= each["expected"] <= 1 for each in found)
    assert found[1]["expected"] == 0.8
    assert found[2]["expected"] == pytest.approx((1 + 2 * 0.4) / 4)  # half of the quality
    assert [each["quality"] for each in found] == pytest.approx([0.85, 0.8, 0.8])


def test_what_a_cup_holds_of_an_object_counts_by_its_weight(tmp_path: Path) -> None:
    """From above, V / (1 + 2 d / r) at d beside the middle; at most half of it is steady."""
    path = tmp_path / "one_cup.urdf"
    path.write_text(SUCTION)
    hand = read_gripper(path, cup=Cup(0.015, 60.0))
    plate = Shape("cuboid", (0.2, 0.2, 0.02))
    rows = [row(x, 0.01) for x in (0.0, 0.015, 0.03, 0.06)]
    held = 60 / np.array([1, 3, 5, 9])
    for mass in (0.2, 0.5, 1.0, 3.0):
        share = held / (mass * 9.81)
        expected = np.where(share < 1, 0, np.minimum(share / 2, 1))
        assert steadiness(rows, plate, hand, mass) == pytest.approx(expected)
    assumed = steadiness(rows, plate, hand, 500 * 0.2 * 0.2 * 0.02)
    assert steadiness(rows, plate, hand) == pytest.approx(assumed)
    lost = row(0.0, 0.01) | {"pose": None}
    assert steadiness([lost, *rows], plate, hand, 3.0) == pytest.approx([1, *expected])
    kept = steady_rows(rows, plate, hand, 1.0)
    assert [each["model_pose"].x for each in kept] == [0.0, 0.015, 0.03]
    assert "is too heavy for the suction cup of 60 N at 4 grasps" in unsteady("plate", 4, hand)
