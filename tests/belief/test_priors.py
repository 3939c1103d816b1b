"""Priors of types and histories."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap import Map
from semmap.belief.error import BeliefError
from semmap.belief.reader import read_columns
from semmap.belief.store.beliefs import where
from tests.belief.conftest import WEIGHTS
from tests.oracles.priors import make_prior
from tests.seen import seen_by


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.99), st.floats(0, 0.99))
def test_priors_are_distributions_on_the_places_that_fit(
    seed: int, elsewhere: float, history: float
) -> None:
    random = np.random.default_rng(seed)
    fits = random.random((6, 5)) < 0.5
    typical = random.random((6, 5)) * (random.random((6, 5)) < 0.5)
    stays = random.integers(0, 2, (6, 5)) * random.random((6, 5)) * fits
    prior = make_prior(fits, typical, stays, elsewhere, history)
    assert np.abs(prior.sum(axis=1) - 1).max() <= 1e-12
    assert not prior[:, :-1][~fits].any()
    placed = fits.any(axis=1)
    np.testing.assert_allclose(prior[placed, -1], elsewhere, atol=1e-12)
    assert (prior[~placed, -1] == 1).all()


def test_an_object_without_history_has_the_prior_of_its_type() -> None:
    fits, typical = np.ones((2, 2), bool), [[3.0, 1.0]] * 2
    prior = make_prior(fits, typical, [[0, 5], [0, 0]], elsewhere=0.0, history=0.4)
    np.testing.assert_allclose(prior[:, :2], [[0.6 * 0.75, 0.6 * 0.25 + 0.4], [0.75, 0.25]])


def test_the_map_has_the_same_priors(flat: Map) -> None:
    """Of a mug that stayed at three places, and of a taught type, found in refrigerators."""
    session = flat.connection
    for place in ("table", "counter"):
        flat["mug"].put_on(place)
    session.execute(
        "INSERT INTO taught_relation VALUES (current_map(), 'umbrella', 'found_in', 'refrigerator')"
    )
    columns = read_columns(seen_by(session), ["mug", "coke"])
    rows = {name: where(seen_by(session), name) for name in columns.objects}
    priors = {name: {row["place"]: row["prior"] for row in rows[name]} for name in rows}
    found = np.array([[priors[name][place] for place in columns.places] for name in priors])
    weight = np.array([WEIGHTS[place] for place in columns.places[:-1]])
    typical = np.tile(weight, (2, 1))
    typical[1, columns.places.index("fridge")] *= 4.0
    for place in ("kitchen", "table", "counter", "fridge"):  # the ontology has mugs in kitchens
        typical[0, columns.places.index(place)] *= 4.0
    stays = np.zeros((2, len(columns.places) - 1))
    for place, weight in (("bench", 0.125), ("table", 0.25), ("counter", 0.5)):
        stays[0, columns.places.index(place)] = weight
    expected = make_prior(columns.prior[:, :-1] > 0, typical, stays)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_an_object_that_fits_only_where_its_type_is_rare_is_there() -> None:
    prior = make_prior([[False, True, True]], [[5.0, 0.0, 0.0]], elsewhere=0.1)
    assert prior[0].tolist() == pytest.approx([0, 0.45, 0.45, 0.1])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"fits": [True]}, r"fits has shape \(1,\)"),
        ({"typical": [[1.0]]}, r"typical has shape \(1, 1\): give \(1, 2\)"),
        ({"typical": [[1.0, -1.0]]}, "typical of object 0 at place 1 is -1: give at least 0"),
        ({"stays": [[np.nan, 0.0]]}, "stays of object 0 at place 0 is nan"),
        ({"stays": [[0, 2]]}, "object 0 was at place 1, where it does not fit"),
        ({"elsewhere": 1.0}, "elsewhere is 1.0: give a probability"),
        ({"history": -0.1}, "history is -0.1: give a probability"),
    ],
)
def test_numbers_that_are_no_prior(arguments: dict[str, object], text: str) -> None:
    with pytest.raises(BeliefError, match=text):
        make_prior(**{"fits": [[True, False]], **arguments})
