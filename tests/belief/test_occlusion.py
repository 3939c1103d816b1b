"""Beliefs with occlusion against Bayes' rule by enumeration of all placements."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.belief import occlusion
from semmap.belief.error import BeliefError
from semmap.belief.inference import infer
from semmap.belief.observation_columns import Observations
from semmap.belief.occlusion import infer_with_occlusion
from tests.belief.cases import looks_of, random_case
from tests.oracles.bayes import posterior

seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=150)
@given(seeds, st.floats(0, 1), st.floats(0.01, 0.99))
def test_agrees_with_the_sum_over_all_placements(seed: int, hides: float, hidden: float) -> None:
    random = np.random.default_rng(seed)
    case = random_case(random, *random.integers((1, 1, 0), (5, 5, 11)))
    found = infer_with_occlusion(*case, hides, hidden)
    behind = [hidden * float(share) for share in case.observations.share]
    expected = posterior(case.prior, looks_of(case), case.volume.tolist(), hides, behind)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(seeds)
def test_objects_of_one_size_do_not_hide_each_other(seed: int) -> None:
    case = random_case(np.random.default_rng(seed), 6, 8, 20, sizes=1)
    found = infer_with_occlusion(*case)
    np.testing.assert_array_equal(found, infer(*case[:3]))


@settings(max_examples=50)
@given(seeds)
def test_the_order_of_objects_and_places_does_not_matter(seed: int) -> None:
    random = np.random.default_rng(seed)
    case = random_case(random, 6, 7, 20)
    o, p = random.permutation(6), random.permutation(7)
    seen = case.observations
    moved = Observations(
        np.argsort(o)[seen.object],
        np.argsort(p)[seen.place],
        *(seen.age, seen.seen, seen.share, seen.hit, seen.false_alarm),
    )
    found = infer_with_occlusion(
        case.prior[o][:, p], moved, case.mobility[o], case.volume[o], hidden=0.4
    )
    expected = infer_with_occlusion(*case, hidden=0.4)
    np.testing.assert_allclose(found, expected[o][:, p], rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(seeds, st.integers(0, 300))
def test_beliefs_are_distributions(seed: int, looks: int) -> None:
    case = random_case(np.random.default_rng(seed), 4, 9, looks)
    belief = infer_with_occlusion(*case, hidden=1e-9)
    assert ((belief >= 0) & (belief <= 1)).all()
    assert np.abs(belief.sum(axis=1) - 1).max() <= 1e-12


def test_a_look_in_vain_rules_out_less_where_a_larger_object_stands() -> None:
    prior = [[0.5, 0.5], [1.0, 0.0]]
    in_vain = Observations([0], [0], [0.0], [False])
    surely, maybe, never = (
        infer_with_occlusion(prior, in_vain, [1, 1], [1, 2], hides, hidden=0.3)[0, 0]
        for hides in (1.0, 0.5, 0.0)
    )
    assert surely == pytest.approx(0.7 / (0.7 + 0.8))
    assert maybe == pytest.approx(0.5 / (0.5 + 0.8))
    assert never == pytest.approx(0.3 / (0.3 + 0.8))
    assert infer(prior, in_vain, [1, 1])[0, 0] == pytest.approx(0.3 / (0.3 + 0.8))


def test_places_far_apart_are_summed_apart() -> None:
    """12 pairs of places with 3 objects each are 12 small problems, not one of 24 places."""
    prior = np.kron(np.eye(12), np.full((3, 2), 0.5))
    looks = Observations(
        np.repeat(np.arange(36), 2),
        np.arange(72) // 6 * 2 + np.arange(72) % 2,
        [5.0] * 72,
        np.arange(72) % 5 == 0,
    )
    size = np.tile([1.0, 2.0, 3.0], 12)
    found = infer_with_occlusion(prior, looks, np.ones(36), size)
    for k in (0, 7):
        rows, columns = slice(3 * k, 3 * k + 3), slice(2 * k, 2 * k + 2)
        mine = looks.take(np.isin(looks.object, np.arange(36)[rows]))
        alone = infer_with_occlusion(
            prior[rows, columns],
            Observations(mine.object - 3 * k, mine.place - 2 * k, mine.age, mine.seen),
            np.ones(3),
            size[rows],
        )
        np.testing.assert_allclose(found[rows, columns], alone, rtol=0, atol=1e-13)


def test_an_object_that_is_seen_beside_a_larger_one_is_not_behind_it() -> None:
    """Six sightings of the coke do not argue that the cereal box is away from the table."""
    looks = Observations([0] * 6 + [1] * 4, [0] * 10, [0.0] * 10, [True] * 10)
    found = infer_with_occlusion([[0.5, 0.5]] * 2, looks, [1, 1], [6.6, 16.6])
    assert found[1, 0] > 0.98


def test_larger_objects_at_known_places_cost_nothing() -> None:
    """Each of 12 mugs is behind the box of its shelf or not; mugs do not hide each other."""
    shelves, mugs = 30, 12
    prior = np.vstack([np.eye(shelves), np.full((mugs, shelves), 1 / shelves)])
    looks = Observations(
        np.repeat(np.arange(shelves, shelves + mugs), 20),
        np.tile(np.arange(20), mugs),
        np.zeros(20 * mugs),
        np.zeros(20 * mugs, bool),
    )
    size = np.repeat([2.0, 1.0], [shelves, mugs])
    found = infer_with_occlusion(prior, looks, np.ones(shelves + mugs), size)
    weight = np.repeat([(0.5 * 0.7 + 0.5 * 0.3) / 0.8, 1.0], [20, 10])
    np.testing.assert_allclose(found[shelves:], [weight / weight.sum()] * mugs, rtol=1e-12)


@pytest.mark.parametrize(("objects", "places"), [(20, 40), (8, 12)])
def test_what_is_too_much_to_sum_is_refused(
    objects: int, places: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(occlusion, "CHOICES", 10_000)
    looks = Observations(
        np.repeat(np.arange(objects), places),
        np.tile(np.arange(places), objects),
        np.zeros(objects * places),
        np.zeros(objects * places, bool),
    )
    prior = np.full((objects, places), 1 / places)
    with pytest.raises(
        BeliefError, match=f"{objects} objects may hide each other at {places} places"
    ):
        infer_with_occlusion(prior, looks, np.ones(objects), np.arange(1, objects + 1))


@pytest.mark.parametrize(
    ("volume", "hides", "hidden", "text"),
    [
        ([1.0], 0.5, 0.3, r"volume has shape \(1,\): give one of 2"),
        ([1.0, 0.0], 0.5, 0.3, "volume of object 1 is 0: give a number above 0"),
        ([np.nan, 1.0], 0.5, 0.3, "volume of object 0 is nan"),
        ([1.0, 2.0], 1.1, 0.3, "hides is 1.1: give a probability"),
        ([1.0, 2.0], 0.5, 0.0, "hidden is 0.0: give a probability strictly between"),
        ([1.0, 2.0], 0.5, 1.0, "hidden is 1.0: give a probability strictly between"),
    ],
)
def test_what_is_no_volume_or_rate(
    volume: list[float], hides: float, hidden: float, text: str
) -> None:
    nothing = Observations([], [], [], [])
    with pytest.raises(BeliefError, match=text):
        infer_with_occlusion([[0.5, 0.5]] * 2, nothing, [1, 1], volume, hides, hidden)
