"""Beliefs of objects that move, against the sum over all their paths."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.belief.error import BeliefError
from semmap.belief.inference import infer
from semmap.belief.motion import MotionModel, infer_with_motion
from semmap.belief.observation_columns import Observations
from semmap.belief.sighting_model import SightingModel
from tests.belief.cases import Case, looks_of, random_case

seeds = st.integers(0, 2**32 - 1)
NEW = SightingModel(seconds=1e300)
"""Sightings that do not lose value, as those of moving objects do not."""


def by_paths(case: Case, destinations: np.ndarray, seconds: float) -> np.ndarray:
    """Sum the weights of all sequences of places at the times of the looks, and now."""
    looks = looks_of(case._replace(mobility=case.mobility * 0))
    found = np.zeros(case.prior.shape)
    for o, (prior, goals, mobility) in enumerate(
        zip(case.prior, destinations, case.mobility, strict=True)
    ):
        mine = sorted(
            (-float(case.observations.age[i]), i) for i in range(len(looks)) if looks[i].object == o
        )
        times = [t for t, _ in mine] + [0.0]
        for path in itertools.product(range(len(prior)), repeat=len(times)):
            weight = float(prior[path[0]])
            for j, (a, b) in enumerate(itertools.pairwise(path)):
                keep = math.exp(-(times[j + 1] - times[j]) * mobility / seconds)
                weight *= keep * (a == b) + (1 - keep) * goals[b]
            for (_, i), p in zip(mine, path, strict=False):
                rate = looks[i].there if p == looks[i].place else looks[i].elsewhere
                weight *= rate if looks[i].seen else 1 - rate
            found[o, path[-1]] += weight
    return found / found.sum(axis=1, keepdims=True)


@settings(max_examples=100)
@given(seeds)
def test_agrees_with_the_sum_over_all_paths(seed: int) -> None:
    random = np.random.default_rng(seed)
    case = random_case(random, *random.integers((1, 1, 0), (4, 4, 7)))
    destinations = random.dirichlet(np.ones(case.prior.shape[1]), len(case.prior))
    found = infer_with_motion(*case[:3], MotionModel(40.0), destinations)
    np.testing.assert_allclose(found, by_paths(case, destinations, 40.0), rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(seeds)
def test_objects_that_do_not_move_have_the_belief_of_new_sightings(seed: int) -> None:
    case = random_case(np.random.default_rng(seed), 5, 6, 30)
    still = infer_with_motion(case.prior, case.observations, np.zeros(5))
    np.testing.assert_allclose(still, infer(*case[:3], NEW), rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(seeds, st.integers(2, 1000))
def test_many_steps_are_one(seed: int, steps: int) -> None:
    random = np.random.default_rng(seed)
    belief, goals = random.dirichlet(np.ones(5), 3), random.dirichlet(np.ones(5), 3)
    mobility, seconds = random.random(3), random.random(3) * 1000
    motion = MotionModel(500.0)
    once = motion.after(belief, goals, mobility, seconds)
    for _ in range(steps):
        belief = motion.after(belief, goals, mobility, seconds / steps)
    np.testing.assert_allclose(belief, once, rtol=0, atol=1e-12)


@settings(max_examples=100)
@given(seeds, st.integers(0, 200), st.floats(0, 1e308), st.floats(0, 1e308))
def test_beliefs_are_distributions(seed: int, looks: int, oldest: float, mobility: float) -> None:
    random = np.random.default_rng(seed)
    observations = Observations(
        random.integers(0, 3, looks),
        random.integers(0, 6, looks),
        random.random(looks) * oldest,
        random.random(looks) < 0.5,
    )
    prior = random.dirichlet(np.ones(7), 3)
    belief = infer_with_motion(prior, observations, random.random(3) * mobility)
    assert ((belief >= 0) & (belief <= 1)).all()
    assert np.abs(belief.sum(axis=1) - 1).max() <= 1e-12


def test_an_old_sighting_fades_into_the_destinations() -> None:
    def table(age: float) -> float:
        seen = Observations([0], [0], [age], [True])
        return float(infer_with_motion([[0.1, 0.9]], seen, [1.0], MotionModel(100.0))[0, 0])

    fresh = 0.1 * 3.5 / (0.1 * 3.5 + 0.9)
    assert table(0.0) == pytest.approx(fresh)
    assert table(100.0) == pytest.approx(0.1 + (fresh - 0.1) / math.e)
    assert table(1e6) == pytest.approx(0.1)


def test_numbers_that_are_no_motion() -> None:
    with pytest.raises(BeliefError, match="seconds is 0: give a number above 0"):
        MotionModel(0.0)
    nothing = Observations([], [], [], [])
    with pytest.raises(BeliefError, match=r"destinations have shape \(1, 3\)"):
        infer_with_motion([[0.5, 0.5]], nothing, [1.0], destinations=[[0.2, 0.3, 0.5]])
