"""Parts, intervals and footprints: on paper, by brute force, and of real robots."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.robot import Part, Robot, RobotError, footprint_string, load_robot, robot_parts
from tests.robot.robots import REAL, by_hand, real_robot


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(by_hand(tmp_path_factory.mktemp("robot")))


def by_name(parts: list[Part]) -> dict[str, Part]:
    return {part.name: part for part in parts}


def test_the_robot_on_paper(robot: Robot) -> None:
    parts = by_name(robot_parts(robot, {}))
    assert list(parts) == ["base", "torso", "arm", "head"]
    assert parts["base"].interval == pytest.approx((0.0, 0.35), abs=1e-3)
    assert parts["base"].inscribed_radius == pytest.approx(0.2)
    assert parts["base"].circumscribed_radius == pytest.approx(np.hypot(0.3, 0.2))
    assert parts["torso"].interval == pytest.approx((0.35, 1.15))
    assert parts["torso"].inscribed_radius == 0, "the origin is not above the column"
    assert parts["torso"].circumscribed_radius == pytest.approx(np.hypot(0.25, 0.05))
    assert parts["arm"].interval == pytest.approx((0.92, 0.98))
    assert parts["arm"].circumscribed_radius == pytest.approx(np.hypot(0.55, 0.02))


def test_changed_joints_change_what_they_move_and_nothing_else(robot: Robot) -> None:
    still, moved = (by_name(robot_parts(robot, s)) for s in ({}, {"elbow": 1.0}))
    assert moved["arm"].interval[0] == pytest.approx(0.95 - 0.3 * np.sin(1.0) - 0.02 * np.cos(1.0))
    assert moved["arm"].circumscribed_radius < still["arm"].circumscribed_radius
    for name in ("base", "torso", "head"):
        assert moved[name].interval == still[name].interval
        assert np.array_equal(moved[name].footprint, still[name].footprint)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 0.4), st.floats(-1.6, 1.6), st.floats(-1.6, 1.6), st.floats(-3, 3))
def test_footprints_by_brute_force(
    robot: Robot, lift: float, shoulder: float, elbow: float, roll: float
) -> None:
    """Every vertex of every mesh; shapely's hull and distances."""
    state = {"lift": lift, "shoulder": shoulder, "elbow": elbow, "roll": roll}
    meshes = robot.link_meshes(state)
    for part in robot_parts(robot, state):
        points = np.concatenate([meshes[li].vertices for li in part.links if li in meshes])
        hull = shapely.MultiPoint(points[:, :2]).convex_hull
        own = shapely.Polygon(part.footprint)
        assert own.symmetric_difference(hull).area < 1e-9
        assert own.exterior.is_ccw
        assert part.interval == pytest.approx((points[:, 2].min(), points[:, 2].max()))
        far = shapely.hausdorff_distance(shapely.Point(0, 0), shapely.MultiPoint(points[:, :2]))
        assert part.circumscribed_radius == pytest.approx(far)
        origin = shapely.Point(0, 0)
        inside = hull.exterior.distance(origin) if hull.contains(origin) else 0
        assert part.inscribed_radius == pytest.approx(inside)


HEIGHT = {"tiago": (1.0, 1.2), "pr2": (1.2, 1.5), "stretch": (1.3, 1.5)}
NAMES = {
    "tiago": ["base", "torso", "head", "arm"],
    "pr2": ["base", "torso", "head", "right_arm", "left_arm"],
    "stretch": ["base", "torso", "head", "arm"],
}
LIFT = {
    "tiago": ("torso_lift_joint", 0.3),
    "pr2": ("torso_lift_joint", 0.3),
    "stretch": ("joint_lift", 0.9),
}


@pytest.mark.parametrize("name", REAL)
def test_real_robots(name: str) -> None:
    robot = load_robot(real_robot(name))
    parts = by_name(robot_parts(robot, {}))
    assert list(parts) == NAMES[name]
    assert abs(parts["base"].interval[0]) < 0.01
    low, high = HEIGHT[name]
    assert low < max(p.interval[1] for p in parts.values()) < high
    assert 0.1 < parts["base"].circumscribed_radius < 0.5
    assert parts["base"].inscribed_radius > 0
    joint, by = LIFT[name]
    lifted = by_name(robot_parts(robot, {joint: by}))
    arm = next(n for n in parts if n.endswith("arm"))
    for end in (0, 1):
        assert lifted[arm].interval[end] == pytest.approx(parts[arm].interval[end] + by, abs=1e-6)
    assert lifted["base"].interval == parts["base"].interval
    grouped = {link for part in parts.values() for link in part.links}
    assert set(robot.meshes) <= grouped
    assert sum(len(p.links) for p in parts.values()) == len(grouped), "each link once"


def test_groups_by_file(robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "parts.yaml"
    file.write_text('base: [base_link, "whe?l"]\narm: [upper, "low*"]\n')
    parts = by_name(robot_parts(robot, {}, file))
    assert {n: p.links for n, p in parts.items()} == {
        "base": ("base_link", "wheel"),
        "arm": ("upper", "lower"),
        "rest": ("column", "head_link"),
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("base: [base_lnk]", "no link base_lnk; did you mean base_link"),
        ("base: base_link", "give \\[link, ...\\]"),
        ("base: {links: [base_link], by: inscribed}", "give \\[link, ...\\]"),
        ("base: {links: [base_link]}", "give .link"),
        ("[", "cannot be read"),
        ("- base", "give parts as name"),
        ("base: [base_footprint]", "no link of part base has geometry"),
    ],
)
def test_groups_that_do_not_fit(robot: Robot, tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "parts.yaml"
    file.write_text(text)
    with pytest.raises(RobotError, match=says):
        robot_parts(robot, {}, file)


def test_a_robot_without_geometry_has_no_parts(robot: Robot) -> None:
    bare = Robot("bare", robot.base, robot.joints, {}, robot._urdf)
    with pytest.raises(RobotError, match="bare: no link has geometry"):
        robot_parts(bare, {})


@pytest.mark.parametrize("name", ["by_hand", *REAL])
def test_footprints_as_nav2_takes_them(robot: Robot, name: str) -> None:
    """Few corners, and none of the real footprint left out."""
    robot = robot if name == "by_hand" else load_robot(real_robot(name))
    for part in robot_parts(robot, {}):
        said = shapely.Polygon(ast.literal_eval(footprint_string(part)))
        real = shapely.Polygon(part.footprint)
        assert said.is_valid
        assert len(said.exterior.coords) < 60
        assert real.difference(said.buffer(1e-3)).area < 1e-9
        assert said.hausdorff_distance(real) < 0.02
