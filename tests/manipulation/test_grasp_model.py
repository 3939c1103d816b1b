"""The model of grasps beside SciPy's minimum and samples, and features beside geometry by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import expit, logit
from scipy.stats import multivariate_normal

from semmap.arrays import Floats
from semmap.manipulation.grasp_model import (
    SPREAD,
    SUCCEEDS,
    TEMPER,
    GraspModel,
    grasp_features,
    pads_on,
)
from semmap.manipulation.solids import solid_of


def outcomes(seed: int, count: int) -> tuple[Floats, Floats, Floats, Floats]:
    random = np.random.default_rng(seed)
    features = np.column_stack([np.ones(count), random.normal(size=(count, 3))])
    attempts = random.uniform(0.1, 3, count)
    successes = attempts * (random.random(count) < expit(features @ [0.5, 2.0, -1.0, 0.0]))
    return features, random.uniform(0.1, 1, count), attempts, successes


def log_posterior(
    weights: Floats, features: Floats, qualities: Floats, attempts: Floats, successes: Floats
) -> float:
    odds = SUCCEEDS + TEMPER * logit(np.clip(qualities, 0.02, 0.98)) + features @ weights
    likelihood = successes @ odds - attempts @ np.logaddexp(0, odds)
    return float(likelihood - weights @ weights / (2 * SPREAD**2))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60))
def test_weights_are_at_the_maximum_that_scipy_finds(seed: int, count: int) -> None:
    known = outcomes(seed, count)
    model = GraspModel.learn(*known)
    found = minimize(lambda w: -log_posterior(w, *known), np.zeros(4), method="BFGS")
    np.testing.assert_allclose(model.weights, found.x, atol=2e-3)


def test_the_covariance_is_that_of_the_curvature() -> None:
    known = outcomes(4, 40)
    model = GraspModel.learn(*known)
    step, precision = 1e-3, np.zeros((4, 4))
    for i, j in np.ndindex(4, 4):
        a, b = step * np.eye(4)[i], step * np.eye(4)[j]
        corners = [
            sign * log_posterior(model.weights + way, *known)
            for sign, way in ((1, a + b), (-1, a - b), (-1, b - a), (1, -a - b))
        ]
        precision[i, j] = -sum(corners) / (4 * step**2)
    np.testing.assert_allclose(np.linalg.inv(model.covariance), precision, rtol=1e-3, atol=1e-3)


def test_expectations_are_means_over_the_posterior() -> None:
    features, qualities, attempts, successes = outcomes(9, 30)
    model = GraspModel.learn(features, qualities, attempts, successes)
    drawn = multivariate_normal(model.weights, model.covariance, seed=1).rvs(40_000)
    before = SUCCEEDS + TEMPER * logit(np.clip(qualities, 0.02, 0.98))
    means = expit(before + drawn @ features.T).mean(axis=0)
    np.testing.assert_allclose(model.expected(features, qualities), means, atol=0.03)


def test_many_outcomes_outweigh_the_prior() -> None:
    random = np.random.default_rng(0)
    features = np.column_stack([np.ones(40_000), random.normal(size=40_000)])
    share = expit(features @ [0.4, -1.2])
    model = GraspModel.learn(features, np.full(40_000, 0.5), np.ones(40_000), share)
    np.testing.assert_allclose(model.weights, [0.4 - SUCCEEDS, -1.2], atol=0.01)


def grasp_at(place: tuple[float, float, float], approach: tuple[float, float, float]) -> Floats:
    """A grasp that closes along x."""
    pose = np.eye(4)
    z = np.array(approach)
    pose[:3, :3] = np.column_stack([[1.0, 0, 0], np.cross(z, [1.0, 0, 0]), z])
    pose[:3, 3] = place
    return pose


def test_features_of_a_block_by_hand() -> None:
    block = solid_of("cuboid", (0.04, 0.06, 0.2))
    from_above = grasp_at((0.01, 0.0, 0.05), (0, 0, -1))
    from_beside = grasp_at((0.0, 0.02, 0.0), (0, -1, 0))
    poses = np.stack([from_above, from_beside])
    found = grasp_features(block, np.array([0, 0, 1.0]), poses, np.full(2, 0.04), 0.08, 0.1)
    diagonal = np.sqrt(0.02**2 + 0.03**2 + 0.1**2)
    expected = [
        [1, 0.5, 0, 0.5, 0.05 / diagonal, 1, 0.5, 0.5, 1],
        [1, 0, 2 / 3, 0, 0.02 / diagonal, 1, 0.5, 0.1, 0],
    ]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(("beside", "part"), [(0.0, 1.0), (0.03, 0.6), (0.05, 0.0)])
def test_the_part_of_the_pads_on_a_block(beside: float, part: float) -> None:
    """Of five rows of points 4 mm apart, the middle one is at the edge of the block."""
    block = solid_of("cuboid", (0.04, 0.06, 0.2))
    assert pads_on(block, grasp_at((0, beside, 0), (0, 0, -1))[None])[0] == part


def test_features_do_not_depend_on_the_size_where_all_is_in_proportion() -> None:
    """A gripper and an object that are twice as large: equal but for the pads, of one size."""
    poses = np.stack([grasp_at((0.0, 0.01, 0.03), (0, 0, -1))])
    larger = poses.copy()
    larger[:, :3, 3] *= 2
    up = np.array([0, 0, 1.0])
    one = grasp_features(solid_of("cylinder", (0.03, 0.1)), up, poses, np.array([0.05]), 0.08, 0.04)
    two = grasp_features(solid_of("cylinder", (0.06, 0.2)), up, larger, np.array([0.1]), 0.16, 0.08)
    np.testing.assert_allclose(one, two, atol=1e-12)
