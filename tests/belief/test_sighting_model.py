"""The rates of sightings, against the numbers that the thesis prints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.belief.error import BeliefError
from semmap.belief.sighting_model import SightingModel

numbers = st.floats(0, allow_nan=False, allow_infinity=False)


@given(numbers, numbers)
def test_rates_stay_between_those_of_new_and_of_old_sightings(age: float, mobility: float) -> None:
    there, elsewhere = SightingModel().rates(age, mobility)
    assert 0.6 <= there <= 0.7
    assert 0.2 - 1e-15 <= elsewhere <= 0.3


def test_rates_fall_with_age_times_mobility() -> None:
    there, elsewhere = SightingModel().rates([0.0, 10.0, 5.0, 1e9], [1.0, 1.0, 2.0, 0.0])
    fall = [1, math.exp(-1), math.exp(-1), 1]
    np.testing.assert_allclose(there, [0.6 + 0.1 * f for f in fall], rtol=1e-15)
    np.testing.assert_allclose(elsewhere, [0.3 - 0.1 * f for f in fall], rtol=1e-15)


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ({"there": 0.9}, r"P\(seen \| there\) is up to 1 .* choose there, elsewhere and change"),
        ({"elsewhere": 0.1}, r"P\(seen \| not there\) from 0:"),
        ({"there": 0.2, "elsewhere": 0.4}, "there is 0.2, below elsewhere, which is 0.4"),
        ({"change": -0.1}, "change is -0.1: give at least 0"),
        ({"seconds": 0}, "seconds is 0: give more than 0"),
        ({"there": math.nan}, "there is nan: give a number"),
    ],
)
def test_numbers_that_are_no_rates(numbers: dict[str, float], text: str) -> None:
    with pytest.raises(BeliefError, match=text):
        SightingModel(**numbers)
