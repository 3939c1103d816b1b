"""The closed form against Bayes' rule by enumeration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.belief.error import BeliefError
from semmap.belief.inference import infer
from semmap.belief.observation_columns import Observations
from semmap.belief.sighting_model import SightingModel
from tests.belief.cases import looks_of, random_case
from tests.oracles.bayes import posterior

seeds = st.integers(0, 2**32 - 1)
UNIFORM = np.full((1, 3), 1 / 3)


@settings(max_examples=200)
@given(seeds)
def test_agrees_with_the_sum_over_all_placements(seed: int) -> None:
    random = np.random.default_rng(seed)
    case = random_case(random, *random.integers((1, 1, 0), (4, 5, 9)))
    found = infer(case.prior, case.observations, case.mobility)
    np.testing.assert_allclose(found, posterior(case.prior, looks_of(case)), rtol=0, atol=1e-13)


@settings(max_examples=60)
@given(seeds, st.integers(0, 60))
def test_observations_one_by_one_lead_to_the_same_belief(seed: int, looks: int) -> None:
    random = np.random.default_rng(seed)
    case = random_case(random, 5, 8, looks)
    belief = case.prior
    for row in random.permutation(looks):
        belief = infer(belief, case.observations.take([row]), case.mobility)
    together = infer(case.prior, case.observations, case.mobility)
    np.testing.assert_allclose(belief, together, rtol=0, atol=1e-12)


@settings(max_examples=300)
@given(
    seeds,
    st.integers(0, 2000),
    st.floats(0, 1.7e308),
    st.floats(0, 1.7e308),
    st.sampled_from([0.0, 0.5, 1.0]),
)
def test_beliefs_are_distributions_however_old_and_many_the_observations(
    seed: int, looks: int, oldest: float, mobility: float, seen: float
) -> None:
    random = np.random.default_rng(seed)
    observations = Observations(
        random.integers(0, 3, looks),
        random.integers(0, 6, looks),
        random.random(looks) * oldest,
        random.random(looks) < seen,
        share=1 - random.random(looks),
    )
    belief = infer(random.dirichlet(np.ones(7), 3), observations, random.random(3) * mobility)
    assert ((belief >= 0) & (belief <= 1)).all()
    assert np.abs(belief.sum(axis=1) - 1).max() <= 1e-12


def test_a_place_that_is_ruled_out_stays_so() -> None:
    seen_there = Observations([0] * 50, [1] * 50, [0.0] * 50, [True] * 50)
    assert infer([[0.5, 0.0, 0.5]], seen_there, [1.0]).tolist() == [[0.5, 0, 0.5]]


def test_thousands_of_observations_neither_overflow_nor_underflow() -> None:
    many = np.zeros(5000, np.intp)
    sightings = Observations(many, many + 1, many, many == 0)
    assert infer(UNIFORM, sightings, [1.0]).tolist() == [[0, 1, 0]]
    everywhere = Observations(many[:4998], np.arange(4998) % 3, many[:4998], many[:4998] != 0)
    np.testing.assert_allclose(infer(UNIFORM, everywhere, [1.0]), UNIFORM, atol=1e-12)


def test_a_look_in_vain_moves_the_belief_elsewhere_by_the_share_that_it_showed() -> None:
    def after(share: float) -> float:
        look = Observations([0], [0], [0.0], [False], share=[share])
        return float(infer([[0.5, 0.5]], look, [1.0])[0, 0])

    assert after(1.0) == pytest.approx(0.3 / (0.3 + 0.8))
    assert after(0.5) == pytest.approx(0.65 / (0.65 + 0.9))
    assert after(1e-9) == pytest.approx(0.5)


def test_any_model_of_rates_can_be_used() -> None:
    class Perfect:
        def rates(self, age, mobility):
            return np.full(len(age), 0.99), np.full(len(age), 0.01)

    seen = Observations([0], [2], [3.0], [True])
    assert infer(UNIFORM, seen, [1.0], Perfect())[0, 2] == pytest.approx(0.99 / 1.01)


def test_detectors_with_rates_of_their_own_replace_those_of_the_model() -> None:
    seen = Observations(
        [0, 0], [0, 0], [1e9, 1e9], [True, True], hit=[np.nan, 0.9], false_alarm=[np.nan, 0.1]
    )
    weight = (0.6 / 0.3) * 9
    assert infer(UNIFORM, seen, [1.0])[0, 0] == pytest.approx(weight / (weight + 2))


def test_no_objects_and_no_observations() -> None:
    nothing = Observations([], [], [], [])
    assert infer(np.empty((0, 3)), nothing, []).shape == (0, 3)
    assert infer(UNIFORM, nothing, [1.0]).tolist() == UNIFORM.tolist()


@pytest.mark.parametrize(
    ("columns", "text"),
    [
        ({"age": [-2.0]}, "observation 0: age is -2: the observation is from the future"),
        ({"age": [np.nan]}, "observation 0: age is nan: give seconds"),
        ({"age": [np.inf]}, "observation 0: age is inf: give seconds"),
        ({"share": [0.0]}, r"observation 0: share is 0: give the visible share"),
        ({"share": [1.5]}, r"observation 0: share is 1.5: give the visible share"),
        ({"hit": [1.0]}, "observation 0: hit is 1: give a probability strictly between"),
        ({"false_alarm": [0.0]}, "observation 0: false_alarm is 0: give a probability"),
        ({"seen": [1]}, "seen is of type int64: give bool"),
        ({"place": [0.0]}, "place is of type float64: give"),
        ({"place": [0, 1]}, "columns of different lengths"),
        ({"place": [[0]]}, r"place has shape \(1, 1\)"),
    ],
)
def test_columns_that_are_no_observations(columns: dict[str, list[float]], text: str) -> None:
    row = {"object": [0], "place": [0], "age": [0.0], "seen": [True]}
    with pytest.raises(BeliefError, match=text):
        Observations(**{**row, **columns})


@pytest.mark.parametrize(
    ("prior", "mobility", "text"),
    [
        ([[0.5, 0.4]], [1.0], "prior of object 0 sums to 0.9"),
        ([[0.5, 0.5], [1.2, -0.2]], [1.0, 1.0], "object 1 sums to 1, its least entry is -0.2"),
        ([[np.nan, 1.0]], [1.0], "prior of object 0 sums to nan"),
        ([0.5, 0.5], [1.0], r"prior has shape \(2,\)"),
        ([[0.5, 0.5]], [], r"mobility has shape \(0,\): give one of 1 objects each"),
        ([[0.5, 0.5]], [-1.0], "mobility of object 0 is -1: give at least 0"),
        ([[0.5, 0.5]], [np.nan], "mobility of object 0 is nan"),
        ([[1.0]], [1.0], "observation 0: place is 1: the prior has places 0 to 0"),
    ],
)
def test_arrays_that_do_not_fit(prior: list[list[float]], mobility: list[float], text: str) -> None:
    with pytest.raises(BeliefError, match=text):
        infer(prior, Observations([0], [1], [0.0], [True]), mobility)


def test_a_model_whose_rates_leave_the_range_is_refused() -> None:
    class Printed:
        """The thesis's program with its sign as printed."""

        def rates(self, age, mobility):
            rise = 0.1 * np.exp(age * mobility / 10)
            return 0.6 + rise, 0.3 - rise

    late = Observations([0, 0], [0, 0], [0.0, 12.0], [True, True])
    with pytest.raises(BeliefError, match=r"P\(seen \| not there\) is -0.03.* at age 12 s"):
        infer(UNIFORM, late, [1.0], Printed())
    assert infer(UNIFORM, late.take([0]), [1.0], Printed())[0, 0] > 0.5
    assert SightingModel().rates(12.0, 1.0)[1] > 0
