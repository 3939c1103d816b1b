"""Where a suction cup is tight, beside rays of trimesh."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from semmap.manipulation import extra
from semmap.manipulation.candidates import Grasp, grasp_candidates
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.generation import grasps_of_mesh, shape_grasps
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.suction import Cup
from semmap.manipulation.suction_grasps import heights
from tests.manipulation.grippers import SUCTION, Shape
from tests.manipulation.hollow_things import boxes, mug, plate

CUP = Cup(0.015, 60.0)


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Gripper:
    path = tmp_path_factory.mktemp("cup") / "one_cup.urdf"
    path.write_text(SUCTION)
    return read_gripper(path, cup=CUP)


def rays(mesh: trimesh.Trimesh, grasp: Grasp, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far the first hit from 3 cm behind is from the lip's plane at points (K, 2)."""
    corners = np.column_stack([at, np.full(len(at), -0.03)])
    starts = corners @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]
    ways = np.tile(grasp.pose[:3, 2], (len(at), 1))
    points, number, _ = mesh.ray.intersects_location(starts, ways, multiple_hits=False)
    found = np.full(len(at), np.inf)
    found[number] = np.linalg.norm(points - starts[number], axis=1) - 0.03
    return found


def check(mesh: trimesh.Trimesh, grasp: Grasp) -> None:
    """The ring bends within its give, all inside is near, and the way to it is free."""
    angle = np.linspace(0, 2 * np.pi, 41)[:-1] + 0.01
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    ring = rays(mesh, grasp, 0.99 * CUP.radius * circle)
    assert np.ptp(ring) < 1.2 * CUP.give
    assert abs(ring.min() + ring.max()) < CUP.give / 2, "the lip is on the surface"
    inside = np.concatenate(
        [rays(mesh, grasp, share * CUP.radius * circle) for share in (0.3, 0.7)]
    )
    assert inside.min() > ring.min() - CUP.room - 1e-3
    assert inside.max() < ring.max() + CUP.room + 1e-3
    stem = np.column_stack([0.9 * CUP.radius * circle, np.full(len(angle), -CUP.soft - 1e-3)])
    starts = stem @ grasp.pose[:3, :3].T + grasp.pre_grasp[:3, 3]
    ways = np.tile(grasp.pose[:3, 2], (len(angle), 1))
    hits, number, _ = mesh.ray.intersects_location(starts, ways, multiple_hits=False)
    gone = np.linalg.norm(hits - starts[number], axis=1)
    assert (gone > 0.1 - 1e-3).all(), "the stem touches nothing on its way"


@pytest.mark.parametrize("seed", range(4))
def test_cups_are_tight_on_boxes_at_random_and_their_way_is_free(seed: int, hand: Gripper) -> None:
    mesh = boxes(np.random.default_rng(seed))
    found = grasps_of_mesh(mesh, Shape("cuboid", (0.1, 0.1, 0.1), inliers=0.5), hand)
    assert len(found) > 0
    assert (np.diff(found.qualities) <= 0).all()
    for number in range(0, len(found), 8):
        check(mesh, found[number])


@pytest.mark.parametrize("made", [mug, plate])
def test_cups_are_tight_on_hollow_things(made: object, hand: Gripper) -> None:
    assert callable(made)
    mesh = made()
    found = grasps_of_mesh(mesh, Shape("cylinder", (0.1, 0.1), inliers=0.5), hand)
    for number in range(0, len(found), 4):
        check(mesh, found[number])


triangles = st.lists(
    st.tuples(*[st.tuples(*[st.floats(-0.1, 0.1)] * 3)] * 3).filter(
        lambda t: np.linalg.norm(np.cross(*(np.array(t[1:]) - t[0]))) > 1e-4
    ),
    min_size=1,
    max_size=8,
)


@settings(deadline=None)
@given(triangles, st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_heights_are_those_of_rays(
    corners: list[tuple[tuple[float, ...], ...]], x: float, y: float
) -> None:
    given_ = np.array(corners)
    faces = np.arange(3 * len(given_)).reshape(-1, 3)
    mesh = trimesh.Trimesh(given_.reshape(-1, 3), faces, process=False)
    start, way = np.array([[x, y, -1.0]]), np.array([[0.0, 0, 1]])
    met = mesh.ray.intersects_location(start, way)[0]
    expected = met[:, 2].min() if len(met) else math.inf
    (found,) = heights(given_, start[:, :2])
    if found != expected and not abs(found - expected) < 1e-6:
        # at an edge, rounding decides: a ray 1 µm aside agrees
        near = start[:, :2] + 1e-6 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        assert any(
            math.isinf(z) == math.isinf(expected) or abs(z - expected) < 1e-4
            for z in heights(given_, near)
        )


def test_a_flat_thing_is_held_above_its_middle_first(hand: Gripper) -> None:
    book = shape_grasps(Shape("cuboid", (0.2, 0.15, 0.02)), hand)
    assert {str(each) for each in book.approaches} == {"top", "bottom"}, "its sides are too low"
    best = book[0].pose[:3, 3]
    assert np.hypot(*best[:2]) < 0.01
    assert abs(best[2]) == pytest.approx(0.01)
    assert len(book) > 200
    assert book[0].width is None
    four = [book[i].pose[:3, 0] for i in range(4)]
    assert np.linalg.matrix_rank(np.array(four), tol=0.1) == 2
    assert np.abs(np.sum(four, axis=0)).max() < 1e-9, "turns of a quarter each"


def test_round_things_are_held_where_they_are_round_enough(hand: Gripper) -> None:
    """R - sqrt(R² - r²) is less than 3 mm from R = 39 mm on; the end is flat."""
    can = shape_grasps(Shape("cylinder", (0.033, 0.1)), hand)
    assert {str(each) for each in can.approaches} == {"top", "bottom"}
    wide = shape_grasps(Shape("cylinder", (0.05, 0.1)), hand)
    assert "side" in wide.approaches
    side = wide[np.flatnonzero(wide.approaches == "side")][0]
    bend = 0.05 - math.sqrt(0.05**2 - 0.015**2)
    assert np.hypot(*side.pose[:2, 3]) == pytest.approx(0.05 - bend / 2, abs=3e-4)
    assert len(shape_grasps(Shape("sphere", (0.02,)), hand)) == 0, "too far inside of the cup"
    ball = shape_grasps(Shape("sphere", (0.05,)), hand)
    assert len(ball) > 100
    for number in range(0, len(ball), 16):
        assert ball[number].pose[:3, 2] @ ball[number].pose[:3, 3] < -0.04, "towards its middle"


def test_grasps_that_nothing_checks_are_refused(
    hand: Gripper, monkeypatch: pytest.MonkeyPatch
) -> None:
    extra.library.cache_clear()
    monkeypatch.setitem(sys.modules, "fcl", None)
    with pytest.raises(ManipulationError, match="fcl is not installed; install the extra"):
        shape_grasps(Shape("cuboid", (0.2, 0.15, 0.02)), hand)


def test_no_cup_is_on_a_hole(hand: Gripper) -> None:
    board = trimesh.creation.box((0.12, 0.12, 0.01))
    hole = trimesh.creation.cylinder(0.012, 0.1, sections=48)
    found = grasps_of_mesh(board.difference(hole), Shape("cuboid", (0.12, 0.12, 0.01)), hand)
    away = np.hypot(found.poses[:, 0, 3], found.poses[:, 1, 3])
    assert len(found) > 0
    assert away.min() > 0.012 + 0.015 - 1e-3
    sieve = trimesh.creation.box((0.12, 0.12, 0.004))
    for x in np.arange(-0.05, 0.06, 0.02):
        for y in np.arange(-0.05, 0.06, 0.02):
            each = trimesh.creation.cylinder(0.005, 0.1, sections=16)
            each.apply_translation((x, y, 0))
            sieve = sieve.difference(each)
    assert len(grasps_of_mesh(sieve, Shape("cuboid", (0.12, 0.12, 0.004)), hand)) == 0


def test_nothing_is_held_from_the_inside_of_what_is_closed(hand: Gripper) -> None:
    chest = shape_grasps(Shape("cuboid", (0.6, 0.6, 0.6)), hand)
    out = np.einsum("ni,ni->n", chest.poses[:, :3, 2], chest.poses[:, :3, 3])
    assert (out < -0.29).all()


def test_the_closed_form_of_fingers_refuses_a_cup(hand: Gripper) -> None:
    with pytest.raises(ManipulationError, match="is a suction cup, which closes on nothing"):
        grasp_candidates(Shape("cuboid", (0.05, 0.05, 0.05)), hand)


def test_what_stands_beside_the_cup_on_its_hand_is_in_the_way(tmp_path: Path) -> None:
    """A rod that leads 2 cm beyond the lip: the cup holds only what is narrow enough beside it."""
    rod = (
        '<link name="rod"><collision><origin xyz="0.025 0 0.11"/><geometry>'
        '<box size="0.004 0.004 0.06"/></geometry></collision></link><joint name="beside" '
        'type="fixed"><parent link="flange"/><child link="rod"/></joint></robot>'
    )
    path = tmp_path / "rod.urdf"
    path.write_text(SUCTION.replace("</robot>", rod))
    gripper = read_gripper(path, cup=CUP)
    found = shape_grasps(Shape("cuboid", (0.2, 0.2, 0.02)), gripper)
    assert len(found) > 0
    beside = found.poses[:, :3, 3] + 0.025 * found.poses[:, :3, 0]
    assert (np.abs(beside[:, :2]).max(axis=1) > 0.098).all(), "beside the edge of the plate"
