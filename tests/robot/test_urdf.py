"""Robots read, against frames multiplied out from their files and what is known on paper."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semmap.robot import Robot, RobotError, load_robot
from tests.robot.robots import BY_HAND, REAL, by_hand, real_robot


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return load_robot(by_hand(tmp_path))


def test_links_and_joints(robot: Robot) -> None:
    assert robot.base == "base_footprint"
    assert robot.links[:2] == ("base_footprint", "base_link")
    assert set(robot.meshes) == {"base_link", "wheel", "column", "upper", "lower", "head_link"}
    assert [j.name for j in robot.joints if j.moves] == ["roll", "lift", "shoulder", "pan", "elbow"]


def test_where_the_links_are(robot: Robot) -> None:
    boxes = {link: np.stack([p.min(0), p.max(0)]) for link, p in robot.hulls({}).items()}
    np.testing.assert_allclose(boxes["base_link"], [[-0.3, -0.2, 0.05], [0.3, 0.2, 0.35]])
    np.testing.assert_allclose(boxes["column"], [[-0.25, -0.05, 0.35], [-0.15, 0.05, 1.15]])
    np.testing.assert_allclose(
        boxes["upper"], [[-0.15, -0.03, 0.92], [0.25, 0.03, 0.98]], atol=1e-9
    )
    np.testing.assert_allclose(boxes["wheel"][:, 2], [0.0, 0.2], atol=1e-3)
    turned = robot.hulls({"shoulder": np.pi / 2, "lift": 0.1})["upper"]
    np.testing.assert_allclose(turned.min(0), [-0.18, 0.0, 1.02], atol=1e-9)


def chain(path: Path, state: dict[str, float], link: str, base: str) -> NDArray[np.float64]:
    """The frame of a link in that of another above it, multiplied out from the URDF's own text."""
    joints = {
        j.find("child").get("link"): j  # type: ignore[union-attr]
        for j in ElementTree.parse(path).getroot().findall("joint")
        if j.find("child") is not None
    }
    pose = np.eye(4)
    while link != base:
        joint = joints[link]
        pose = moved(joint, state, joints) @ pose
        parent = joint.find("parent")
        assert parent is not None
        link = parent.get("link") or ""
    return pose


def moved(
    joint: ElementTree.Element, state: dict[str, float], joints: dict[Any, ElementTree.Element]
) -> NDArray[np.float64]:
    """A joint's child in its parent."""

    def numbers(tag: str, name: str, default: str) -> NDArray[np.float64]:
        found = joint.find(tag)
        text = default if found is None else found.get(name, default)
        return np.array(text.split(), float)

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", numbers("origin", "rpy", "0 0 0")).as_matrix()
    pose[:3, 3] = numbers("origin", "xyz", "0 0 0")
    value = state.get(joint.get("name") or "", 0.0)
    mimic = joint.find("mimic")
    if mimic is not None:
        of = state.get(mimic.get("joint") or "", 0.0)
        value = float(mimic.get("multiplier", "1")) * of + float(mimic.get("offset", "0"))
    axis = numbers("axis", "xyz", "1 0 0")
    motion = np.eye(4)
    if joint.get("type") in ("revolute", "continuous"):
        motion[:3, :3] = Rotation.from_rotvec(value * axis / np.linalg.norm(axis)).as_matrix()
    elif joint.get("type") == "prismatic":
        motion[:3, 3] = value * axis
    return pose @ motion


@pytest.mark.parametrize("name", REAL)
def test_random_states_by_multiplied_frames(name: str) -> None:
    """An independent chain of frames, and meshes as trimesh loads them."""
    path = real_robot(name)
    robot = load_robot(path)
    random = np.random.default_rng(5)
    state = {
        j.name: float(random.uniform(max(j.limits[0], -1), min(j.limits[1], 1)))
        for j in robot.joints
        if j.moves and j.mimics is None
    }
    meshes, hulls = robot.link_meshes(state), robot.hulls(state)
    ground = min(p[:, 2].min() for p in robot.hulls({}).values())
    shifts = []
    for link, mesh in meshes.items():
        pose = chain(path, state, link, robot.base)
        wanted = robot.meshes[link].vertices @ pose[:3, :3].T + pose[:3, 3]
        off = mesh.vertices - wanted
        shifts.append(off[0])
        np.testing.assert_allclose(off, np.broadcast_to(off[0], off.shape), atol=1e-9)
        for side in (
            mesh.vertices.min(0) - hulls[link].min(0),
            mesh.vertices.max(0) - hulls[link].max(0),
        ):
            np.testing.assert_allclose(side, 0, atol=1e-9)
    lift = 0.0 if robot.base == "base_footprint" else shifts[0][2]
    np.testing.assert_allclose(shifts, np.tile([0, 0, lift], (len(shifts), 1)), atol=1e-9)
    assert abs(ground) < 0.01, "it stands on the ground"


def test_units_of_collada(tmp_path: Path) -> None:
    """A box of 200 x 300 x 400 in millimetres, whatever axis its file calls up."""
    dae = trimesh.creation.box((200, 300, 400)).export(file_type="dae").decode()
    assert "<asset>" in dae
    for asset, name in (("", "plain"), ("<up_axis>Y_UP</up_axis>", "turned")):
        unit = f'<unit meter="0.001" name="millimeter"/>{asset}'
        file = re.sub(r"<unit[^>]*/>|<up_axis>[^<]*</up_axis>", "", dae)
        (tmp_path / f"{name}.dae").write_text(file.replace("<asset>", f"<asset>{unit}"))
        text = (
            f'<robot name="r"><link name="base_link"><visual><geometry><mesh filename="{name}.dae"'
            ' scale="1 2 1"/></geometry></visual></link></robot>'
        )
        (robot,) = [load_robot(by_hand(tmp_path, text))]
        np.testing.assert_allclose(
            np.ptp(robot.meshes["base_link"].vertices, axis=0), (0.2, 0.6, 0.4), atol=1e-9
        )


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({"shoulde": 0.1}, "no movable joint shoulde; it has roll"),
        ({"ground": 0.1}, "no movable joint ground"),
        ({"shoulder": 2.0}, "from -1.6 to 1.6, not to 2"),
        ({"lift": -0.1}, "from 0 to 0.4"),
    ],
)
def test_states_that_it_cannot_take(robot: Robot, state: dict[str, float], says: str) -> None:
    with pytest.raises(RobotError, match=says):
        robot.hulls(state)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "is not a usable URDF"),
        ("<robot name='empty'><link name='a'/></robot>", "no link has geometry"),
        (
            BY_HAND.replace('<sphere radius="0.1"/>', '<mesh filename="package://none/head.stl"/>'),
            "link head_link: its mesh package://none/head.stl is not found",
        ),
        (
            BY_HAND.replace('<sphere radius="0.1"/>', '<mesh filename="by_hand.urdf"/>'),
            "link head_link: by_hand.urdf: cannot be read",
        ),
    ],
)
def test_files_that_are_no_robot(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(RobotError, match=says):
        load_robot(by_hand(tmp_path, text))


HEAD = '<sphere radius="0.1"/>'


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            '<origin xyz="0 0 0.2"/>',
            '<origin xyz="1e308 0 0"/>',
            r"joint ground: its origin xyz reaches 1e\+308 m, the limit is 10,000 m",
        ),
        ('<origin xyz="0.2 0 0"/>', '<origin xyz="0.2 0 -1e308"/>', "link upper: its origin xyz"),
        ('<origin xyz="0.2 0 0"/>', '<origin xyz="0.2 0 nan"/>', "link upper: its origin xyz is"),
        ('<origin xyz="0.2 0 0"/>', '<origin rpy="0 inf 0"/>', "link upper: its origin rpy is"),
        ('size="0.1 0.1 0.8"', 'size="0.1 0.1"', r"link column: its box size is .*3 finite"),
        ('size="0.1 0.1 0.8"', 'size="0.1 0.1 -1"', "link column: its box size .* at least 0"),
        ('size="0.1 0.1 0.8"', 'size="0.1 0.1 1e300"', "link column: its box size reaches"),
        (HEAD, '<sphere radius="nan"/>', "link head_link: its sphere radius is nan"),
        (HEAD, '<sphere radius="-1"/>', "link head_link: its sphere radius is -1"),
        (HEAD, '<cylinder radius="1e9" length="1"/>', "its cylinder radius and length reaches"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "joint elbow: its axis has no length"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', "joint elbow: its axis is"),
        ('lower="-1" upper="1"', 'lower="1" upper="-1"', "joint pan: its limits are 1 and -1"),
        ('lower="-1" upper="1"', 'lower="nan" upper="1"', "joint pan: its limits are nan and 1"),
        ('lower="0" upper="0.4"', 'lower="1e300" upper="1e301"', "lift: its position at rest"),
        (
            '<axis xyz="0 1 0"/>',
            '<axis xyz="0 1 0"/><mimic joint="lift" multiplier="1e308"/>',
            "joint elbow: its mimic reaches",
        ),
        ("<robot ", "<!DOCTYPE robot [<!ENTITY a 'b'>]><robot ", "declares a document type"),
        (
            "</robot>",
            "".join(f"<link name='l{i}'/>" for i in range(1000)) + "</robot>",
            "has 1,007 links, the limit is 500 links.*SEMMAP_MAX_LINKS raises the limit",
        ),
    ],
)
def test_numbers_and_sizes_of_no_robot(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in BY_HAND
    with pytest.raises(RobotError, match=says):
        load_robot(by_hand(tmp_path, BY_HAND.replace(old, new, 1)))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "latin-1"])
def test_a_robot_that_is_not_utf_8(tmp_path: Path, encoding: str) -> None:
    """20,000 links in UTF-16 passed the limit, and took more than a minute."""
    path = tmp_path / "robot.urdf"
    links = "".join(f"<link name='é{i}'/>" for i in range(20_000))
    text = f'<?xml version="1.0" encoding="{encoding}"?><robot name="r">{links}</robot>'
    path.write_bytes(text.encode(encoding))
    with pytest.raises(RobotError, match=r"robot.urdf: file: is not UTF-8. Save it as UTF-8"):
        load_robot(path)


def test_a_link_that_hangs_on_no_joint(tmp_path: Path) -> None:
    loose = '<link name="loose"><collision><geometry><box size="1 1 1"/></geometry></collision>'
    text = BY_HAND.replace("</robot>", f"{loose}</link></robot>")
    with pytest.raises(RobotError, match="link loose: no joint joins it to base_footprint"):
        load_robot(by_hand(tmp_path, text))


@pytest.mark.parametrize("scale", ["1 2", "nan", "1e308 1 1"])
def test_scales_of_no_mesh(tmp_path: Path, scale: str) -> None:
    trimesh.creation.box().export(tmp_path / "box.stl")
    mesh = f'<mesh filename="box.stl" scale="{scale}"/>'
    with pytest.raises(RobotError, match="link head_link: its mesh scale"):
        load_robot(by_hand(tmp_path, BY_HAND.replace(HEAD, mesh)))


def test_a_state_is_finite(tmp_path: Path) -> None:
    robot = load_robot(by_hand(tmp_path))
    with pytest.raises(RobotError, match="joint roll goes from -inf to inf, not to inf"):
        robot.hulls({"roll": np.inf})
    free = BY_HAND.replace('<limit lower="0" upper="0.4" effort="1" velocity="1"/>', "")
    robot = load_robot(by_hand(tmp_path, free))
    robot.hulls({"lift": 100.0, "roll": 1e300})
    with pytest.raises(RobotError, match=r"joint lift is moved by 1e\+200 m: give at most 10000"):
        robot.hulls({"lift": 1e200})


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"does not exist\. Name a URDF"):
        load_robot(tmp_path / "robot.urdf")


def test_meshes_beside_the_file_and_in_packages(tmp_path: Path) -> None:
    import trimesh

    package = tmp_path / "my_robot"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    trimesh.creation.box(extents=(100, 200, 300)).export(package / "meshes" / "ball.stl")
    said = '<mesh filename="package://my_robot/meshes/ball.stl" scale="0.001 0.001 0.001"/>'
    text = BY_HAND.replace('<sphere radius="0.1"/>', said)
    robot = load_robot(by_hand(package / "urdf", text))
    np.testing.assert_allclose(np.ptp(robot.meshes["head_link"].vertices, axis=0), [0.1, 0.2, 0.3])
    near = BY_HAND.replace('<sphere radius="0.1"/>', '<mesh filename="../meshes/ball.stl"/>')
    robot = load_robot(by_hand(package / "urdf", near))
    assert np.ptp(robot.meshes["head_link"].vertices) == pytest.approx(300)


@pytest.mark.parametrize("name", ["tiago", "pr2"])
def test_transforms_of_joints_lead_to_the_poses_of_links(name):
    robot = load_robot(real_robot(name))
    random = np.random.default_rng(3)
    state = {
        j.name: float(random.uniform(max(j.limits[0], -3), min(j.limits[1], 3)))
        for j in robot.joints
        if j.mimics is None and j.type in ("revolute", "prismatic", "continuous")
    }
    expected = robot.link_poses(state, robot.links)
    poses = {robot.links[0]: expected[robot.links[0]]}
    for joint in robot.joints:
        poses[joint.child] = poses[joint.parent] @ robot.transform(joint, state)
        np.testing.assert_allclose(poses[joint.child], expected[joint.child], atol=1e-9)
