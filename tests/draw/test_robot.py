"""A robot's parts as pictures, each in its colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from semmap.draw.palette import PART_COLOURS
from semmap.draw.robot import footprints_picture, parts_picture, robot_views
from semmap.geometry.pose import Pose
from semmap.robot import load_robot, robot_parts
from tests.robot.robots import by_hand


def shades(path: Path, colour: str) -> int:
    """Pixels of a colour's hue, lit or not."""
    pixels = np.asarray(Image.open(path).convert("RGB"), float) / 255
    wanted = np.array(to_rgb(colour))
    length = np.linalg.norm(pixels, axis=-1) * np.linalg.norm(wanted)
    return int(((pixels @ wanted) / np.maximum(length, 1e-9) > 0.985).sum())


def test_parts_are_drawn_in_their_colours(tmp_path: Path) -> None:
    robot = load_robot(by_hand(tmp_path))
    parts, meshes = robot_parts(robot, {}), robot.link_meshes({})
    picture = parts_picture(parts, meshes, tmp_path / "parts.png")
    for colour in PART_COLOURS[: len(parts)]:
        assert shades(picture, colour) > 150, colour
    picture = footprints_picture(parts, tmp_path / "footprints.png", "footprints")
    for colour in PART_COLOURS[: len(parts)]:
        assert shades(picture, colour) > 50, colour


def test_a_robot_is_drawn_at_its_pose(tmp_path: Path) -> None:
    robot = load_robot(by_hand(tmp_path))
    parts, meshes = robot_parts(robot, {}), robot.link_meshes({})
    base = robot_views(parts, meshes, Pose.planar(3, 4, np.pi / 2, 7.0))[0]
    assert base.mesh is not None
    low, high = base.mesh.bounds
    np.testing.assert_allclose((low + high)[:2] / 2, [3, 4], atol=0.05)
    assert abs(low[2] - 7.0) < 1e-3
