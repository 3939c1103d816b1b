"""Robots read, against trimesh's own transforms and what is known on paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yourdfpy

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


@pytest.mark.parametrize("name", REAL)
def test_random_states_as_yourdfpy_places_whole_meshes(name: str) -> None:
    """A second engine: yourdfpy's own collision scene, with meshes and scales that it loads."""
    path = real_robot(name)
    robot = load_robot(path)
    other = yourdfpy.URDF.load(
        str(path), load_meshes=False, load_collision_meshes=False, filename_handler=lambda f: f
    )
    random = np.random.default_rng(5)
    state = {
        j.name: float(random.uniform(max(j.limits[0], -1), min(j.limits[1], 1)))
        for j in robot.joints
        if j.moves and j.mimics is None
    }
    other.update_cfg(state)
    meshes = robot.link_meshes(state)
    hulls = robot.hulls(state)
    ground = min(p[:, 2].min() for p in robot.hulls({}).values())
    shift = 0.0 if robot.base == "base_footprint" else None
    for link, mesh in meshes.items():
        pose = np.asarray(other.get_transform(link, robot.base))
        own = robot.meshes[link].vertices
        wanted = own @ pose[:3, :3].T + pose[:3, 3]
        if shift is None:
            shift = float(mesh.vertices[0, 2] - wanted[0, 2])
        np.testing.assert_allclose(mesh.vertices, wanted + np.array([0, 0, shift]), atol=1e-9)
        for side in (
            mesh.vertices.min(0) - hulls[link].min(0),
            mesh.vertices.max(0) - hulls[link].max(0),
        ):
            np.testing.assert_allclose(side, 0, atol=1e-9)
    assert abs(ground) < 0.01, "it stands on the ground"


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({"shoulde": 0.1}, "no joint shoulde that moves; it has roll"),
        ({"ground": 0.1}, "no joint ground"),
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
        ("<robot", "is no URDF"),
        ("<robot name='empty'><link name='a'/></robot>", "no link has geometry"),
        (BY_HAND.replace('<sphere radius="0.1"/>', '<mesh filename="package://none/head.stl"/>'),
         "link head_link: its mesh package://none/head.stl is not found"),
        (BY_HAND.replace('<sphere radius="0.1"/>', '<mesh filename="by_hand.urdf"/>'),
         "link head_link: by_hand.urdf cannot be read"),
    ],
)  # fmt: skip
def test_files_that_are_no_robot(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(RobotError, match=says):
        load_robot(by_hand(tmp_path, text))


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"is not there\. Name a URDF"):
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
