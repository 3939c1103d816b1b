"""Suction cups in URDFs, with the names that real files use."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from semmap.manipulation.arm import Arm
from semmap.manipulation.carrying import folded_posture
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper_reader import find_grippers, read_gripper, stated_cup
from semmap.manipulation.suction import Cup
from semmap.robot.error import RobotError
from tests.manipulation.grippers import BY_HAND, SUCTION, urdf

CHAIN = """<robot name="arm">
  <link name="base"><collision><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>
  <link name="fore"><collision><origin xyz="0.15 0 0"/><geometry><box size="0.3 0.04 0.04"/></geometry></collision></link>
  <link name="left_vacuum_body"><visual><origin xyz="0.04 0 0"/><geometry><box size="0.08 0.06 0.06"/></geometry></visual></link>
  <link name="left_suction_cup"><visual><origin rpy="0 1.5707963 0"/><geometry><cylinder radius="0.012" length="0.015"/></geometry></visual></link>
  <link name="left_suction_tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="fore"/><origin xyz="0 0 0.25"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="fore"/><child link="left_vacuum_body"/><origin xyz="0.3 0 0"/></joint>
  <joint name="cup" type="fixed"><parent link="left_vacuum_body"/><child link="left_suction_cup"/><origin xyz="0.0875 0 0"/></joint>
  <joint name="tip" type="fixed"><parent link="left_suction_cup"/><child link="left_suction_tip"/><origin xyz="0.0075 0 0"/></joint>
</robot>
"""  # noqa: E501
"""A level arm; body and cup before it lead on along x, and the cup's frame is in its middle."""


def file_of(folder: Path, text: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(text)
    return path


def test_the_lip_is_the_far_end_of_the_link_that_is_named_so(tmp_path: Path) -> None:
    gripper = read_gripper(file_of(tmp_path, CHAIN))
    assert (gripper.kind, gripper.palm) == ("suction", "left_suction_cup")
    assert gripper.cup is not None
    assert gripper.cup.radius == pytest.approx(0.012, rel=0.01)
    assert gripper.cup.force == pytest.approx(60e3 * math.pi * 0.012**2, rel=0.02)
    assert gripper.opening == 2 * gripper.cup.radius
    assert gripper.depth == pytest.approx(0.015)
    assert gripper.frame[:3, 3] == pytest.approx([0.0075, 0, 0], abs=1e-6)
    assert gripper.frame[:3, 2] == pytest.approx([1, 0, 0])
    assert gripper.frame[:3, :3] @ gripper.frame[:3, :3].T == pytest.approx(np.eye(3))
    assert set(gripper.links) == {"fore", "left_vacuum_body", "left_suction_cup"}
    assert gripper.up == pytest.approx(gripper.frame[2, :3]), "its arm does not tilt it"
    assert (gripper.joints, gripper.posture(0.01), gripper.index(0.01)) == ((), {}, 0)
    assert gripper.swept_volume == 0


def test_what_is_soft_is_not_among_the_stiff_hulls(tmp_path: Path) -> None:
    gripper = read_gripper(file_of(tmp_path, CHAIN))
    assert gripper.cup is not None
    for hull, pose in zip(gripper.stiff_hulls, gripper.poses[0], strict=True):
        ahead = (hull @ pose[:3, :3].T + pose[:3, 3])[:, 2]
        assert ahead.max() <= -gripper.cup.soft + 1e-9
    longest = max(
        (h @ p[:3, :3].T + p[:3, 3])[:, 2].min()
        for h, p in zip(gripper.stiff_hulls, gripper.poses[0], strict=True)
    )
    assert longest == pytest.approx(-0.015), "the rest of the cup is a part of it"
    at = gripper.links.index("left_suction_cup")
    ahead = gripper.hulls[at] @ gripper.poses[0, at][:3, :3].T + gripper.poses[0, at][:3, 3]
    assert ahead[:, 2].max() == pytest.approx(0, abs=1e-6)


def test_a_cup_shorter_than_what_is_soft_is_hard_where_it_begins(tmp_path: Path) -> None:
    gripper = read_gripper(file_of(tmp_path, CHAIN), None, Cup(0.05, 30))
    at = gripper.links.index("left_suction_cup")
    ahead = gripper.stiff_hulls[at] @ gripper.poses[0, at][:3, :3].T + gripper.poses[0, at][:3, 3]
    assert ahead[:, 2].min() == pytest.approx(-0.015)
    assert ahead[:, 2].max() == pytest.approx(-0.014)
    assert gripper.margins == {"left_suction_tip"}, "which has no mesh"


def test_a_part_beside_the_cup_that_leads_beyond_it_stays_hard(tmp_path: Path) -> None:
    box = '<origin xyz="0.05 0.1 0"/><geometry><box size="0.2 0.01 0.01"/></geometry>'
    rod = f"<collision>{box}</collision>"
    text = CHAIN.replace(
        '<link name="left_suction_tip"/>', f'<link name="left_suction_tip">{rod}</link>'
    )
    gripper = read_gripper(file_of(tmp_path, text), "left_suction_cup", Cup(0.012, 30))
    at = gripper.links.index("left_suction_tip")
    ahead = gripper.stiff_hulls[at] @ gripper.poses[0, at][:3, :3].T + gripper.poses[0, at][:3, 3]
    assert ahead[:, 2].max() == pytest.approx(0.15)


def test_gazebo_tells_which_link_is_a_cup(tmp_path: Path) -> None:
    plain = CHAIN.replace("suction", "rubber").replace("vacuum", "pump")
    with pytest.raises(ManipulationError, match="no link has two fingers"):
        read_gripper(file_of(tmp_path, plain))
    for told in (
        "<bodyName>left_rubber_cup</bodyName>",
        "<link_name>arm::left_rubber_cup</link_name>",
    ):
        plugin = f'<plugin name="v" filename="libgazebo_ros_vacuum_gripper.so">{told}</plugin>'
        gripper = read_gripper(
            file_of(tmp_path, plain.replace("</robot>", f"<gazebo>{plugin}</gazebo></robot>"))
        )
        assert (gripper.kind, gripper.palm) == ("suction", "left_rubber_cup")


def test_what_gazebo_tells_is_read_as_the_robot_is(tmp_path: Path) -> None:
    """A prefix without a namespace, and an encoding that is not that of the bytes."""
    plain = SUCTION.replace("suction_cup", "céramique")
    plugin = '<plugin filename="libvacuum_gripper.so"><bodyName>céramique</bodyName></plugin>'
    told = plain.replace("</robot>", f"<gazebo>{plugin}</gazebo></robot>")
    text = told.replace('<link name="flange">', '<xacro:property name="a"/><link name="flange">')
    for head in ("", '<?xml version="1.0" encoding="iso-8859-1"?>'):
        path = tmp_path / "robot.urdf"
        path.write_text(head + text, "utf-8")
        gripper = read_gripper(path)
        assert gripper.kind == "suction"
        assert gripper.palm in gripper.robot.links
    path.write_bytes(text.encode("iso-8859-1"))
    with pytest.raises(RobotError, match="is not UTF-8"):
        read_gripper(path)


def test_cups_that_only_gazebo_tells_are_found_and_carried(tmp_path: Path) -> None:
    plain = CHAIN.replace("suction", "rubber").replace("vacuum", "pump")
    other = re.sub('name="(?!arm)', 'name="other_', plain)
    other = re.sub('link="', 'link="other_', other)
    links = other.split('<robot name="arm">')[1].replace("</robot>", "")
    join = '<joint name="beside" type="fixed"><parent link="base"/><child link="other_base"/><origin xyz="0 0.8 0"/></joint>'  # noqa: E501
    names = ("left_rubber_cup", "other_left_rubber_cup")
    plugins = "".join(
        f'<plugin filename="libgazebo_ros_vacuum_gripper.so"><link_name>{k}</link_name></plugin>'
        for k in names
    )
    end = f"{links}{join}<gazebo>{plugins}</gazebo></robot>"
    gripper = read_gripper(file_of(tmp_path, plain.replace("</robot>", end)))
    assert {each.palm for each in find_grippers(gripper.robot)} == set(names)
    assert set(folded_posture(gripper)) == {"shoulder", "other_shoulder"}


def test_a_frame_of_a_tool_is_a_cup_where_that_is_stated(tmp_path: Path) -> None:
    text = CHAIN.replace('<link name="left_suction_tip"/>', '<link name="tool0"/>')
    text = text.replace('<child link="left_suction_tip"/>', '<child link="tool0"/>')
    gripper = read_gripper(file_of(tmp_path, text), "tool0", Cup(0.02, 50))
    assert gripper.cup == Cup(0.02, 50)
    assert gripper.frame[:3, 2] == pytest.approx([0, 0, 1])
    assert gripper.frame[:3, 3] == pytest.approx([0, 0, 0])
    real = read_gripper(urdf("ur5"), "tool0", Cup(0.02, 50))
    arm = Arm(real)
    assert len(arm.joints) == 6
    assert real.up is None


def test_fingers_come_before_a_cup_that_is_not_meant(tmp_path: Path) -> None:
    cup = '<link name="suction_cup"><visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.01" length="0.02"/></geometry></visual></link><joint name="c" type="fixed"><parent link="palm"/><child link="suction_cup"/><origin xyz="0.2 0 0"/></joint></robot>'  # noqa: E501
    path = file_of(tmp_path, BY_HAND.replace("</robot>", cup))
    assert read_gripper(path).kind == "parallel"
    assert read_gripper(path, "suction_cup").kind == "suction"
    assert read_gripper(path, "suction_cup").palm == "suction_cup"
    assert [each.kind for each in find_grippers(read_gripper(path).robot)] == ["parallel"]


def test_an_arm_with_a_cup_is_carried(tmp_path: Path) -> None:
    gripper = read_gripper(file_of(tmp_path, CHAIN))
    assert [each.palm for each in find_grippers(gripper.robot)] == ["left_suction_cup"]
    assert set(folded_posture(gripper)) == {"shoulder"}


def test_a_force_alone_belongs_to_the_cup_of_the_file(tmp_path: Path) -> None:
    path = file_of(tmp_path, SUCTION)
    assert stated_cup(path, None, None, None) is None
    assert stated_cup(path, None, 0.01, None) == Cup.of(0.01)
    cup = stated_cup(path, None, None, 12.0)
    assert cup is not None
    assert (cup.force, round(cup.radius, 3)) == (12.0, 0.015)
    with pytest.raises(ManipulationError, match="has fingers, so force=12 says nothing"):
        stated_cup(file_of(tmp_path, BY_HAND), None, None, 12.0)


def test_what_cannot_be_a_cup_is_refused_with_what_to_do(tmp_path: Path) -> None:
    bare = re.sub('(?<="suction_cup">).*(?=</link>)', "", SUCTION)
    with pytest.raises(
        ManipulationError, match=r"suction_cup: has no mesh.*state it with suction="
    ):
        read_gripper(file_of(tmp_path, bare))
    wide = SUCTION.replace('radius="0.015"', 'radius="0.3"')
    with pytest.raises(ManipulationError, match=r"ends 0\.6 m wide"):
        read_gripper(file_of(tmp_path, wide))
    with pytest.raises(ManipulationError, match="there is no link flang; did you mean flange"):
        read_gripper(file_of(tmp_path, SUCTION), "flang", Cup(0.01, 5))
    with pytest.raises(ManipulationError, match="no link is named as a suction cup: palm=LINK"):
        read_gripper(file_of(tmp_path, BY_HAND), None, Cup(0.01, 5))
