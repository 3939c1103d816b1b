"""Suction cups in simulation: tight or not, and which weights they hold."""

from __future__ import annotations

import numpy as np
import pytest

from semmap.geometry.mesh import Mesh
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.evaluation import mismatch, rest_mismatch
from semmap.manipulation.generation import shape_grasps
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.suction import Cup, heaviest
from semmap.manipulation.trial import HEIGHT, SHAKE, Trial, body_of
from tests.manipulation.grippers import SUCTION, Shape

CUP = Cup(0.015, 60.0)
BOOK = Shape("cuboid", (0.2, 0.15, 0.03))


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Gripper:
    path = tmp_path_factory.mktemp("cup") / "one_cup.urdf"
    path.write_text(SUCTION)
    return read_gripper(path, cup=CUP)


def standing(height: float) -> np.ndarray:
    pose = np.eye(4)
    pose[2, 3] = height / 2 + 5e-4
    return pose


def from_above(x: float, height: float) -> Grasp:
    """The cup on the top of a thing, beside its middle."""
    pose = np.array([[1.0, 0, 0, x], [0, -1, 0, 0], [0, 0, -1, height / 2], [0, 0, 0, 1]])
    before = pose.copy()
    before[2, 3] += 0.1
    return Grasp(pose, before, None, "top", "top x 90 0 cup", 0.5, {}, {})


def trial(hand: Gripper, mass: float, shape: Shape = BOOK, friction: float = 0.5) -> Trial:
    body = body_of(solid_of(*shape[:2]), mass=mass, friction=friction)
    return Trial(hand, body, standing(shape.size[-1]))


def test_a_book_that_lies_is_lifted_and_held(hand: Gripper) -> None:
    best = next(g for g in shape_grasps(BOOK, hand) if g.approach == "top")
    outcome = trial(hand, 0.4).run(best)
    assert mismatch(outcome) is None
    assert outcome.lifted == pytest.approx(HEIGHT, abs=0.01)
    assert (outcome.grip, outcome.width) == (hand.opening, hand.opening)


@pytest.mark.parametrize("aside", [0.0, 0.02, 0.05])
def test_what_hangs_is_held_up_to_the_heaviest_weight(
    aside: float, hand: Gripper, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a shake, and lifted slowly enough that it weighs at most a third more."""
    monkeypatch.setattr("semmap.manipulation.trial.SWAY", 0.0)
    lever = np.array([[-aside, 0, BOOK.size[2] / 2]])
    most = float(heaviest(CUP, np.array([[0.0, 0, 1]]), lever, 0.5)[0])
    for share, holds in ((0.7, True), (1.1, False)):
        outcome = trial(hand, share * most / 9.81).run(from_above(aside, BOOK.size[2]))
        assert (outcome.lifted > 0.9 * HEIGHT) == holds, (share, most)
        assert (mismatch(outcome) is None) == holds


def test_the_load_that_the_lip_feels_is_the_weight_at_its_lever(
    hand: Gripper, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semmap.manipulation.trial.SWAY", 0.0)
    made = trial(hand, 0.3)
    made.run(from_above(0.03, BOOK.size[2]))
    assert made.vacuum is not None
    force, moment = made.vacuum.load
    assert force == pytest.approx([0, 0, 0.3 * 9.81], abs=0.05)
    assert moment == pytest.approx([0, 0.3 * 9.81 * 0.03, 0], abs=2e-3)
    assert SHAKE > 0


def test_where_the_lip_is_not_tight_nothing_is_lifted(hand: Gripper) -> None:
    narrow = Shape("cuboid", (0.02, 0.2, 0.05))
    outcome = trial(hand, 0.1, narrow).run(from_above(0.0, 0.05))
    assert mismatch(outcome) == "missed"
    beside = trial(hand, 0.1).run(from_above(0.095, BOOK.size[2]))
    assert mismatch(beside) == "missed", "half of the lip is beside the book"
    ball = body_of(solid_of("sphere", (0.02,)), mass=0.05)
    low = np.eye(4)
    low[2, 3] = 0.0205
    assert mismatch(Trial(hand, ball, low).run(from_above(0.0, 0.04))) == "missed"


def test_little_friction_does_not_hold_a_box_by_its_side(hand: Gripper) -> None:
    shape = Shape("cuboid", (0.08, 0.08, 0.1))
    grasp = next(
        g for g in shape_grasps(shape, hand) if g.approach == "side" and abs(g.pose[2, 3]) < 0.02
    )
    assert mismatch(trial(hand, 0.25, shape, friction=0.5).run(grasp)) is None
    assert mismatch(trial(hand, 0.25, shape, friction=0.02).run(grasp)) == "dropped"


def test_a_mesh_with_a_hole_is_not_held_above_it(hand: Gripper) -> None:
    parts = [
        solid_of("cuboid", (0.05, 0.12, 0.02)).mesh(),
        solid_of("cuboid", (0.05, 0.12, 0.02)).mesh(),
    ]
    vertices = np.concatenate([parts[0].vertices, parts[1].vertices])
    vertices[:, 0] += np.repeat([-0.03, 0.03], len(parts[0].vertices))
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices)])
    halves = Mesh(vertices, faces.astype(np.int32))
    made = Trial(hand, body_of(halves, mass=0.1), standing(0.02))
    assert mismatch(made.run(from_above(0.0, 0.02))) == "missed"
    assert mismatch(made.run(from_above(0.03, 0.02))) is None


def test_a_book_is_put_down_and_let_go(hand: Gripper) -> None:
    grasp = from_above(0.01, BOOK.size[2])
    before, after = grasp.pose.copy(), grasp.pre_grasp
    before[2, 3] += 0.1
    made = trial(hand, 0.4)
    rest = made.put(grasp, before, after)
    assert rest.lifted > HEIGHT / 2
    assert rest_mismatch(rest) is None
    assert made.vacuum is not None
    assert not made.vacuum.holds
    assert made.run(grasp) == made.run(grasp), "a trial keeps nothing of the one before"
