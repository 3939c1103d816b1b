"""Trials in simulation, and what is learned from them."""

from __future__ import annotations

import numpy as np
import pytest

from semmap.geometry.mesh import Mesh
from semmap.manipulation.candidates import grasp_candidates
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import learn_grasp, mismatch, rest_mismatch
from semmap.manipulation.pushing import push_candidates
from semmap.manipulation.solids import solid_of
from semmap.manipulation.trial import HEIGHT, Trial, body_of
from tests.manipulation.grippers import Shape, real_gripper


def standing(height):
    pose = np.eye(4)
    pose[2, 3] = height / 2 + 5e-4
    return pose


def grasp_of(grasps, family):
    return next(g for g in grasps if g.family == family)


@pytest.mark.parametrize("name", ["panda", "pr2", "tiago_pro"])
def test_a_can_is_lifted_and_held(name):
    gripper = real_gripper(name)
    shape = Shape("cylinder", (0.03, 0.12))
    body = body_of(solid_of(*shape[:2]), mass=0.2)
    grasp = grasp_of(grasp_candidates(shape, gripper), "side r 0 0 own")
    outcome = Trial(gripper, body, standing(0.12)).run(grasp)
    assert mismatch(outcome) is None
    assert outcome.lifted == pytest.approx(HEIGHT, abs=0.01)
    assert 0.045 < outcome.width < 0.062


def test_trials_of_equal_grasps_are_equal():
    gripper = real_gripper("panda")
    shape = Shape("cuboid", (0.05, 0.05, 0.1))
    trial = Trial(gripper, body_of(solid_of(*shape[:2])), standing(0.1))
    grasp = grasp_candidates(shape, gripper)[0]
    assert trial.run(grasp) == trial.run(grasp)


def test_what_friction_cannot_hold_is_not_lifted():
    """Two pads with at most 25 N together hold 25 N x friction: 2.5 kg at 1.0, not 3 kg at 0.5."""
    gripper = real_gripper("panda")
    shape = Shape("cuboid", (0.05, 0.05, 0.1))
    solid, grasps = solid_of(*shape[:2]), grasp_candidates(shape, gripper)
    grasp = grasp_of(grasps, "side x 0 0 own")
    heavy = Trial(gripper, body_of(solid, mass=3.0, friction=0.3), standing(0.1)).run(grasp)
    assert mismatch(heavy) in ("missed", "dropped")
    light = Trial(gripper, body_of(solid, mass=0.3, friction=0.8), standing(0.1)).run(grasp)
    assert mismatch(light) is None


def test_what_is_beside_the_fingers_is_missed_and_what_is_hit_is_pushed():
    gripper = real_gripper("panda")
    shape = Shape("cuboid", (0.03, 0.03, 0.1))
    trial = Trial(gripper, body_of(solid_of(*shape[:2]), mass=0.1), standing(0.1))
    grasp = grasp_of(grasp_candidates(shape, gripper), "side x 0 0 own")
    beside = np.eye(4)
    beside[2, 3] = 0.2
    assert mismatch(trial.run(grasp, error=beside)) == "missed"
    under_a_finger = np.eye(4)
    under_a_finger[:3, 3] = 0.045 * grasp.pose[:3, 0]
    assert mismatch(trial.run(grasp, error=under_a_finger)) == "pushed"


@pytest.mark.parametrize("way", [-1, 1])
def test_trial_and_error_moves_the_grasp_to_the_heavy_end(way):
    gripper = real_gripper("panda")
    shape = Shape("cuboid", (0.24, 0.04, 0.05))
    body = body_of(solid_of(*shape[:2]), mass=0.5, friction=0.5, offset=(0.07 * way, 0, 0))
    at = standing(0.05)
    trial = Trial(gripper, body, at)
    centred = [g for g in grasp_candidates(shape, gripper) if g.family == "top y 90 0 own"]
    down = lambda g: (at @ g.pose)[:3, :3].T @ [0, 0, -1]  # noqa: E731
    attempts = learn_grasp(centred, trial.run, down)
    assert attempts[0].cause in ("turned", "dropped", "missed")
    learned = attempts[-1]
    assert learned.cause is None
    assert learned.grasp.pose[0, 3] * way > 0.02
    assert learned.grasp.shift == pytest.approx(learned.correction)
    assert mismatch(trial.run(learned.grasp)) is None  # at once


def test_a_mesh_without_a_volume():
    sheet = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]), np.array([[0, 1, 2], [1, 3, 2]])
    )
    with pytest.raises(ManipulationError, match="its mesh has no volume; give a mesh of a solid"):
        body_of(sheet)
    with pytest.raises(ManipulationError, match="its mesh has no volume"):
        body_of(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)))
    cube = solid_of("cuboid", (0.1, 0.1, 0.1)).mesh()
    body = body_of(cube, density=500)
    assert body.mass == pytest.approx(0.5)
    np.testing.assert_allclose(body.centre, 0, atol=1e-12)
    with pytest.raises(ManipulationError, match="mass -1 kg"):
        body_of(cube, mass=-1.0)


@pytest.mark.parametrize("name", ["panda", "pr2"])
def test_what_is_put_down_rests_where_it_stood(name):
    gripper = real_gripper(name)
    shape = Shape("cylinder", (0.03, 0.12))
    grasp = grasp_of(grasp_candidates(shape, gripper), "side r 0 0 own")
    above = np.eye(4)
    above[2, 3] = 0.1
    trial = Trial(gripper, body_of(solid_of(*shape[:2]), mass=0.2), standing(0.12))
    rest = trial.put(grasp, above @ grasp.pose, grasp.pre_grasp)
    assert rest.lifted == pytest.approx(HEIGHT, abs=0.01)
    assert rest_mismatch(rest) is None
    # A retreat to the side takes the object along, or over.
    aside = grasp.pose.copy()
    aside[:3, 3] += 0.1 * grasp.pose[:3, 0]
    assert rest_mismatch(trial.put(grasp, above @ grasp.pose, aside)) is not None


def test_a_push_moves_along_its_direction_and_topples_what_is_pushed_at_its_top():
    gripper = real_gripper("panda")
    solid, model = solid_of("cuboid", (0.04, 0.04, 0.2)), standing(0.2)
    trial = Trial(gripper, body_of(solid, mass=0.3, friction=0.7), model)
    turned = np.array([[0, -1, 0, 2.0], [1, 0, 0, 3], [0, 0, 1, 0.7], [0, 0, 0, 1]]) @ model
    for height, cause in ((0.1, None), (0.9, "toppled")):
        for push in push_candidates(solid.mesh().vertices, turned, gripper, height=height)[:2]:
            rest = trial.push(push, turned)
            # the frame of the trial is not turned
            x, y = push.direction
            way = np.array([y, -x, 0]) * push.distance
            assert rest_mismatch(rest, way, 0.03) == cause
            if cause is None:
                assert rest.moved == pytest.approx(way, abs=0.02)
                assert rest_mismatch(rest, -way, 0.03) == "strayed"
