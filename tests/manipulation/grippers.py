"""Grippers of the tests: real ones where their packages are installed, and one by hand."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import read_gripper
from tests.robot.robots import installed_file

REAL = {
    "panda": "panda_description/urdf/panda.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
    "tiago_pro": "tiago_pro_description/robots/tiago_pro.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "allegro": "allegro_hand_description/urdf/allegro_right_hand.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "alex": "alex_description/urdf/alex_sake_hands.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "laikago": "laikago_description/urdf/laikago.urdf",
}

BY_HAND = """<robot name="two_plates">
  <link name="palm"><collision><origin xyz="0 0 -0.02"/><geometry><box size="0.14 0.04 0.04"/></geometry></collision></link>
  <link name="left"><collision><origin xyz="0.005 0 0.03"/><geometry><box size="0.01 0.02 0.06"/></geometry></collision></link>
  <link name="right"><collision><origin xyz="-0.005 0 0.03"/><geometry><box size="0.01 0.02 0.06"/></geometry></collision></link>
  <joint name="open_left" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="1 0 0"/><limit lower="0" upper="0.05" effort="20" velocity="1"/></joint>
  <joint name="open_right" type="prismatic"><parent link="palm"/><child link="right"/><axis xyz="-1 0 0"/><limit lower="0" upper="0.05" effort="20" velocity="1"/></joint>
</robot>
"""  # noqa: E501
"""Two plates of 6 cm that open to 10 cm; the pads' middle is 5 cm above the palm."""


JAW = """<robot name="one_jaw">
  <link name="mount">
    <collision><origin xyz="0 0 -0.02"/><geometry><box size="0.08 0.03 0.04"/></geometry></collision>
    <collision><origin xyz="-0.03 0 0.04"/><geometry><box size="0.01 0.02 0.08"/></geometry></collision>
  </link>
  <link name="jaw"><collision><origin xyz="0 0 0.04"/><geometry><box size="0.01 0.02 0.08"/></geometry></collision></link>
  <joint name="slide" type="prismatic"><parent link="mount"/><child link="jaw"/><origin xyz="-0.02 0 0"/><axis xyz="1 0 0"/><limit lower="0" upper="0.05" effort="20" velocity="1"/></joint>
</robot>
"""  # noqa: E501
"""A plate that slides from a fixed one, up to 5 cm away; both reach 8 cm above the mount."""


SUCTION = """<robot name="one_cup">
  <link name="flange"><collision><origin xyz="0 0 0.03"/><geometry><box size="0.06 0.06 0.06"/></geometry></collision></link>
  <link name="suction_cup"><collision><origin xyz="0 0 0.03"/><geometry><cylinder radius="0.015" length="0.06"/></geometry></collision></link>
  <joint name="mount" type="fixed"><parent link="flange"/><child link="suction_cup"/><origin xyz="0 0 0.06"/></joint>
</robot>
"""  # noqa: E501
"""A cup of 30 mm, whose lip is 12 cm before the flange and 6 cm before the box on it."""


class Shape(NamedTuple):
    kind: str
    size: tuple[float, ...]
    pose: NDArray[np.float64] = np.eye(4)
    inliers: float = 1.0


STRETCH = {
    "stretch_se3": "SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf",
    "stretch_arm": "RE2V0/stretch_description_RE2V0_tool_stretch_gripper.urdf",
    "stretch_wrist": "RE2V0/stretch_description_RE2V0_tool_stretch_dex_wrist.urdf",
}


def urdf(name: str) -> Path:
    if name in STRETCH:
        return installed_file("hello-robot-stretch-urdf", STRETCH[name])
    return installed_file("example-robot-data", REAL[name])


@functools.cache
def real_gripper(name: str) -> Gripper:
    return read_gripper(urdf(name))


def gripper_by_hand(folder: Path) -> Gripper:
    path = folder / "two_plates.urdf"
    path.write_text(BY_HAND)
    return read_gripper(path)
