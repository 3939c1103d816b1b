"""The cameras of real robots, judged by the limits in their URDF; and of one by hand."""

import re
from xml.etree.ElementTree import parse

import numpy as np
import pytest

from semmap.robot import load_robot
from semmap.robot.camera_reach import camera_reach
from tests.robot.robots import BY_HAND, by_hand, real_robot

HEAD = """
  <link name="{camera}"/>
  <joint name="tilt" type="{type}"><parent link="head_link"/><child link="{camera}"/>
    <origin xyz="0.1 0 0.05"/><axis xyz="{axis}"/><limit lower="-0.4" upper="0.8" effort="1" velocity="1"/></joint>
</robot>
"""  # noqa: E501


@pytest.mark.parametrize(
    ("name", "lift", "pan"),
    [
        ("tiago", "torso_lift_joint", "head_1_joint"),
        ("pr2", "torso_lift_joint", "head_pan_joint"),
        ("stretch", None, "joint_head_pan"),
    ],
)
def test_the_head_cameras_of_real_robots(name, lift, pan):
    path = real_robot(name)
    reach = camera_reach(load_robot(path))
    limits = {
        joint.get("name"): [float(joint.find("limit").get(end)) for end in ("lower", "upper")]
        for joint in parse(path).getroot().iterfind("joint")
        if joint.find("limit") is not None and joint.find("limit").get("lower") is not None
    }
    if lift is None:
        assert len(reach.heights) == 1
    else:
        assert np.ptp(reach.heights) == pytest.approx(np.ptp(limits[lift]), abs=0.02)
    assert reach.pan == pytest.approx(min(map(abs, limits[pan])), abs=0.1)
    assert 1.0 < reach.heights[0] < 1.4
    assert reach.pitches[0] <= -0.2
    assert reach.pitches[-1] >= 0.9


def test_a_camera_by_hand_is_where_its_joints_say(tmp_path):
    text = BY_HAND.replace("</robot>", HEAD.format(camera="camera", type="revolute", axis="0 1 0"))
    reach = camera_reach(load_robot(by_hand(tmp_path, text)))
    low = 0.2 + 0.55 + 0.5 + 0.05
    assert reach.link == "camera"
    assert reach.heights == pytest.approx((low, low + 0.2, low + 0.4))
    assert (reach.pitches[0], reach.pitches[-1]) == pytest.approx((-0.3, 0.8), abs=0.03)
    assert reach.pan == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("camera", "type_", "axis"),
    [
        ("face", "fixed", "0 1 0"),  # its name is not that of a camera
        ("camera", "revolute", "0.7 0.7 0.2"),  # neither pans nor tilts
        ("camera", "prismatic", "1 0 0"),
        ("camera", "revolute", "0 0 1"),  # a second joint that pans: as of an arm
        ("camera_optical_frame", "revolute", "0 1 0"),  # its z axis looks upwards
    ],
)
def test_what_no_head_carries_is_no_camera_of_a_search(tmp_path, camera, type_, axis):
    text = BY_HAND.replace("</robot>", HEAD.format(camera=camera, type=type_, axis=axis))
    assert camera_reach(load_robot(by_hand(tmp_path, text))) is None


def test_a_tilt_without_limits_and_a_higher_link_that_does_not_turn(tmp_path):
    head = HEAD.format(camera="camera", type="revolute", axis="0 1 0")
    free = re.sub(r'<limit lower="-0.4".*?/>', "", head)
    reach = camera_reach(load_robot(by_hand(tmp_path, BY_HAND.replace("</robot>", free))))
    assert (reach.link, len(reach.pitches)) == ("camera", 1)
    speaker = HEAD.format(camera="stereo_speaker", type="fixed", axis="0 1 0")
    speaker = speaker.replace('"tilt"', '"on_top"').replace("0.1 0 0.05", "0 0 0.8")
    speaker = speaker.replace('link="head_link"', 'link="column"')
    text = BY_HAND.replace("</robot>", head.replace("</robot>", speaker))
    assert camera_reach(load_robot(by_hand(tmp_path, text))).link == "camera"


def test_a_robot_without_camera_has_none(tmp_path):
    assert camera_reach(load_robot(by_hand(tmp_path))) is None
