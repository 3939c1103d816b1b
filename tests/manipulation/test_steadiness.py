"""How steadily grasps hold an object as it stands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from semmap.geometry.pose import Pose
from semmap.manipulation.steadiness import HOLD, steadiness, steady_rows
from tests.manipulation.grippers import Shape

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
