"""The frames, widths and postures of grippers, from URDF."""

from __future__ import annotations

import os

import numpy as np
import pytest
import trimesh

from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper_reader import find_grippers, kept_gripper, read_gripper
from tests.manipulation.grippers import BY_HAND, JAW, gripper_by_hand, real_gripper, urdf


def test_a_gripper_by_hand(tmp_path):
    gripper = gripper_by_hand(tmp_path)
    assert (gripper.kind, gripper.palm, gripper.is_symmetric) == ("parallel", "palm", True)
    assert gripper.opening == pytest.approx(0.1, abs=1e-9)
    assert gripper.depth == pytest.approx(0.05, abs=1e-9)
    np.testing.assert_allclose(gripper.frame[:3, 3], [0, 0, 0.05], atol=1e-9)
    np.testing.assert_allclose(gripper.frame[:3, 2], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(np.abs(gripper.frame[:3, 0]), [1, 0, 0], atol=1e-9)
    assert gripper.posture(0.04) == pytest.approx({"open_left": 0.02, "open_right": 0.02})


def test_a_gripper_is_read_once_until_its_file_changes(tmp_path):
    """Also by the palm that is stored of it, as a plan and its mission ask for it."""
    path = tmp_path / "hand.urdf"
    path.write_text(BY_HAND)
    kept = kept_gripper(path)
    assert kept_gripper(str(path)) is kept
    assert kept_gripper(path, kept.palm) is kept
    assert kept.opening == read_gripper(path).opening
    path.write_text(BY_HAND + "<!-- later -->")
    os.utime(path, (1, 1))
    assert kept_gripper(path, kept.palm) is not kept


@pytest.mark.parametrize(
    ("name", "kind", "opening", "approach"),
    [
        ("panda", "parallel", (0.079, 0.081), "panda_hand_tcp"),  # the data sheet: 80 mm
        ("pr2", "parallel", (0.085, 0.095), "r_gripper_tool_frame"),  # 86 to 90 mm
        ("tiago_pro", "parallel", (0.07, 0.09), None),
        ("allegro", "multi-finger", (0.1, 0.2), None),
        ("tiago", "multi-finger", (0.05, 0.1), "hand_grasping_frame"),
        ("stretch_wrist", "parallel", (0.2, 0.3), "link_grasp_center"),
        ("stretch_se3", "parallel", (0.12, 0.16), "link_grasp_center"),
    ],
)
def test_real_grippers(name, kind, opening, approach):
    gripper = real_gripper(name)
    assert gripper.kind == kind
    assert opening[0] < gripper.opening < opening[1]
    assert (np.diff(gripper.widths) < 0).all()
    if approach is not None:  # the maker's own frame of the tool lies between the fingers
        poses = gripper.robot.link_poses({}, [gripper.palm, approach])
        tool = np.linalg.inv(poses[gripper.palm] @ gripper.frame) @ poses[approach]
        assert np.linalg.norm(tool[:3, 3]) < 0.06


@pytest.mark.parametrize("name", ["panda", "pr2", "tiago_pro", "stretch_se3", "stretch_wrist"])
def test_a_plate_of_the_width_fits_between_the_fingers_and_a_thicker_one_does_not(name):
    """Rays across the opening meet the fingers at the width that the gripper states."""
    gripper = real_gripper(name)
    wide = min(gripper.opening, 0.08)  # further open, turned fingers are between the pads
    for width in (0.02, 0.05, wide):
        index = gripper.index(width)
        meshes = gripper.meshes(width)
        fingers: trimesh.Trimesh = trimesh.util.concatenate(
            [
                trimesh.Trimesh(meshes[k].vertices, meshes[k].faces)
                for finger in gripper.fingers
                for k in finger
                if k in meshes
            ]
        )
        height = np.linspace(-0.009, 0.009, 31) + gripper.reaches[index]
        starts = np.column_stack([np.zeros((31, 2)), height])
        across = 0.0
        for side in (1.0, -1.0):
            hits, _, _ = fingers.ray.intersects_location(starts, np.tile([side, 0, 0], (31, 1)))
            across += np.abs(hits[:, 0]).min()
        assert across == pytest.approx(gripper.widths[index], abs=0.006)


def test_a_box_around_the_whole_hand_is_not_a_part_of_it(tmp_path):
    """TIAGo's hand has a box for its safety, which is not seen and has the fingers inside."""
    hand = real_gripper("tiago")
    assert "hand_palm_link" in hand.links
    assert "hand_safety_box" not in hand.links
    assert 0.02 < hand.depth < 0.05
    box = '<geometry><box size="0.3 0.3 0.3"/></geometry>'
    around = f'<link name="around"><collision>{box}</collision></link>'
    joint = '<joint name="j" type="fixed"><parent link="palm"/><child link="around"/></joint>'
    closed = BY_HAND.replace("</robot>", f"{around}{joint}</robot>")
    hand = read_gripper(gripper_file(tmp_path, closed))
    assert "around" not in hand.links
    assert hand.depth == pytest.approx(0.05, abs=1e-9)
    seen = closed.replace(around, around.replace("</link>", f"<visual>{box}</visual></link>"))
    assert "around" in read_gripper(gripper_file(tmp_path, seen)).links


def test_both_grippers_of_a_robot_are_found_and_chosen_by_palm():
    names = [g.palm for g in find_grippers(real_gripper("pr2").robot)]
    assert names == ["r_gripper_palm_link", "l_gripper_palm_link"]
    assert read_gripper(urdf("pr2"), "l_gripper_palm_link").palm == "l_gripper_palm_link"


def test_postures_lead_to_the_widths():
    gripper = real_gripper("pr2")
    for width in (0.0, 0.03, 0.06):
        index = gripper.index(width)
        assert gripper.widths[index] >= width - 1e-9
        assert gripper.posture(gripper.widths[index]) == pytest.approx(gripper.postures[index])


def test_a_jaw_that_closes_on_a_fixed_one(tmp_path):
    gripper = read_gripper(gripper_file(tmp_path, JAW))
    assert (gripper.kind, gripper.palm, gripper.is_symmetric) == ("parallel", "mount", False)
    assert gripper.opening == pytest.approx(0.05, abs=1e-9)
    assert gripper.depth == pytest.approx(0.07, abs=2e-3)
    np.testing.assert_allclose(gripper.frame[:3, 3], [0, 0, 0.07], atol=1e-3)
    np.testing.assert_allclose(gripper.frame[:3, 2], [0, 0, 1], atol=1e-9)
    # A thing of 2 cm is taken 4 mm beside the fixed jaw, at x = -0.025 + 0.004 + 0.01.
    (held,) = gripper.pads_at(np.array([0.02])) @ gripper.frame[:3, :3].T + gripper.frame[:3, 3]
    np.testing.assert_allclose(held, [-0.011, 0, 0.07], atol=1e-3)
    np.testing.assert_allclose(gripper.pads_at(np.array([0.05])), 0, atol=1e-9)
    between = np.array([0.0, 0.0, 0.0])  # no hull of a slice fills the space between the jaws
    for link, pose, hull in zip(gripper.links, gripper.poses[0], gripper.hulls, strict=True):
        corners = hull @ pose[:3, :3].T + pose[:3, 3]
        inside = trimesh.convex.convex_hull(corners).contains([between])[0]
        assert not inside, link


@pytest.mark.parametrize(("name", "palm"), [("so100", "gripper"), ("z1", "gripperStator")])
def test_real_grippers_with_one_jaw(name, palm):
    gripper = real_gripper(name)
    assert gripper.palm == palm
    assert 0.04 < gripper.opening < 0.08
    assert (np.diff(gripper.widths) < 0).all()
    assert gripper.widths[-1] < 0.003
    meshes = [trimesh.Trimesh(m.vertices, m.faces) for m in gripper.meshes(1.0).values()]
    whole: trimesh.Trimesh = trimesh.util.concatenate(meshes)
    for width in (gripper.opening, gripper.opening / 2):  # the open jaws are beside what is there
        (held,) = gripper.pads_at(np.array([width]))
        met = whole.ray.intersects_location([held] * 2, [[1, 0, 0], [-1, 0, 0]])[0]
        assert np.linalg.norm(met - held, axis=1).min() > width / 2 - 0.004


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("alex", "LeftSakePalmLink: its fingers do not point the same way"),
        ("icub", r"chest: what moves on it opens 0\.62 m: no fingers"),
        ("kinova", "j2s6s200_link_finger_1, .* do not move"),
        ("laikago", "no link has two fingers that open"),  # legs are no jaws
    ],
)
def test_what_is_no_gripper_is_told_with_the_reason(name, why):
    with pytest.raises(ManipulationError, match=why):
        real_gripper(name)


def test_why_a_jaw_does_not_open_is_told(tmp_path):
    still = JAW.replace('<limit lower="0" upper="0.05" effort="20" velocity="1"/>', "")
    with pytest.raises(ManipulationError, match="mount: nothing opens on it"):
        read_gripper(gripper_file(tmp_path, still))
    apart = JAW.replace('xyz="-0.02 0 0"', 'xyz="0.1 0 0"')
    with pytest.raises(ManipulationError, match="mount: its jaws do not meet"):
        read_gripper(gripper_file(tmp_path, apart), "mount")


def test_no_fingers(tmp_path):
    with pytest.raises(ManipulationError, match="no link has two fingers that open"):
        read_gripper(urdf("ur5"))
    with pytest.raises(ManipulationError, match="link right does not have two fingers"):
        read_gripper(gripper_file(tmp_path, BY_HAND), "right")
    shut = BY_HAND.replace('upper="0.05"', 'upper="0.001"')
    with pytest.raises(ManipulationError, match="whose finger joints have limits"):
        read_gripper(gripper_file(tmp_path, shut))


@pytest.mark.parametrize("gap", [0.0, 0.06, 0.15])
@pytest.mark.parametrize("limit", ['<limit lower="0" upper="0" effort="20" velocity="1"/>', ""])
def test_fingers_without_limits_open_from_where_they_touch(tmp_path, gap, limit):
    """Plates that slide, drawn with a gap: closed they touch, and each opens by 4 cm, or is so."""
    text = BY_HAND.replace('<limit lower="0" upper="0.05" effort="20" velocity="1"/>', limit)
    for side, sign in (("left", ""), ("right", "-")):
        drawn = f'<child link="{side}"/><origin xyz="{sign}{gap / 2} 0 0"/>'
        text = text.replace(f'<child link="{side}"/>', drawn)
    gripper = read_gripper(gripper_file(tmp_path, text))
    assert gripper.is_assumed
    assert gripper.opening == pytest.approx(max(0.08, gap), abs=1e-6)
    assert gripper.widths[-1] == pytest.approx(0, abs=0.003)
    np.testing.assert_allclose(gripper.frame[:3, 2], [0, 0, 1], atol=1e-9)
    assert not gripper_by_hand(tmp_path).is_assumed


def gripper_file(folder, text):
    path = folder / "gripper.urdf"
    path.write_text(text)
    return path
