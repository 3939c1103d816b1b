"""Priors of types and histories."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.belief.error import BeliefError
from semmap.belief.priors import make_prior


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.99), st.floats(1e-6, 1e6))
def test_priors_are_distributions_on_the_places_that_fit(
    seed: int, elsewhere: float, strength: float
) -> None:
    random = np.random.default_rng(seed)
    fits = random.random((6, 5)) < 0.5
    typical = random.random((6, 5)) * (random.random((6, 5)) < 0.5)
    counts = random.integers(0, 9, (6, 5)) * fits
    prior = make_prior(fits, typical, counts, elsewhere, strength)
    assert np.abs(prior.sum(axis=1) - 1).max() <= 1e-12
    assert not prior[:, :-1][~fits].any()
    placed = fits.any(axis=1)
    np.testing.assert_allclose(prior[placed, -1], elsewhere, atol=1e-12)
    assert (prior[~placed, -1] == 1).all()


def test_the_history_outweighs_the_type_as_it_grows() -> None:
    """The posterior mean of a Dirichlet prior, by the rule of succession with weights."""
    fits, typical = np.ones((1, 2), bool), [[3.0, 1.0]]
    for stays in (0, 1, 10, 1000):
        prior = make_prior(fits, typical, [[0, stays]], elsewhere=0.0, strength=2.0)
        assert prior[0, 1] == pytest.approx((2 * 0.25 + stays) / (2 + stays))


def test_an_object_that_fits_only_where_its_type_is_rare_is_there() -> None:
    prior = make_prior([[False, True, True]], [[5.0, 0.0, 0.0]], elsewhere=0.1)
    assert prior[0].tolist() == pytest.approx([0, 0.45, 0.45, 0.1])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"fits": [True]}, r"fits has shape \(1,\)"),
        ({"typical": [[1.0]]}, r"typical has shape \(1, 1\): give \(1, 2\)"),
        ({"typical": [[1.0, -1.0]]}, "typical of object 0 at place 1 is -1: give at least 0"),
        ({"counts": [[np.nan, 0.0]]}, "counts of object 0 at place 0 is nan"),
        ({"counts": [[0, 2]]}, "object 0 was at place 1, where it does not fit"),
        ({"elsewhere": 1.0}, "elsewhere is 1.0: give a probability"),
        ({"strength": 0.0}, "strength is 0.0: give a number above 0"),
    ],
)
def test_numbers_that_are_no_prior(arguments: dict[str, object], text: str) -> None:
    with pytest.raises(BeliefError, match=text):
        make_prior(**{"fits": [[True, False]], **arguments})
