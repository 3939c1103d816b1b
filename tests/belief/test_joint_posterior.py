"""Which instance each detection is of: against all hypotheses, one by one."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.belief import joint_posterior
from semmap.belief.error import BeliefError
from semmap.belief.joint_posterior import joint_marginals, one_each


def by_brute_force(same, new, missed) -> np.ndarray:
    k, n = len(new), len(missed)
    found = np.zeros((k, n + 1))
    for chosen in itertools.product(range(n + 1), repeat=k):
        known = [i for i in chosen if i < n]
        if len(set(known)) == len(known):
            weight = math.prod(missed[i] for i in range(n) if i not in known)
            weight *= math.prod(new[j] if i == n else same[j, i] for j, i in enumerate(chosen))
            found[np.arange(k), chosen] += weight
    return found / found.sum(axis=1, keepdims=True)


@st.composite
def views(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    k, n = draw(st.integers(1, 4)), draw(st.integers(0, 5))
    likelihood = st.one_of(st.just(0.0), st.floats(1e-12, 1e6))
    same = draw(st.lists(likelihood, min_size=k * n, max_size=k * n))
    new = draw(st.lists(st.floats(1e-9, 10.0), min_size=k, max_size=k))
    missed = draw(st.lists(st.floats(0.01, 1.0), min_size=n, max_size=n))
    return np.reshape(same, (k, n)), np.array(new), np.array(missed)


@settings(max_examples=300)
@given(views())
def test_probabilities_are_those_of_all_hypotheses_together(view) -> None:
    same, new, missed = view
    found = joint_marginals(same, new, missed)
    np.testing.assert_allclose(found, by_brute_force(same, new, missed), atol=1e-9)
    assert (found[:, :-1].sum(axis=0) <= 1 + 1e-9).all(), "no instance has two detections"


@settings(max_examples=200)
@given(st.integers(1, 4), st.integers(1, 5), st.data())
def test_each_has_one_and_the_most_are_right(k: int, n: int, data: st.DataObject) -> None:
    numbers = st.integers(0, 100)
    share = np.reshape(data.draw(st.lists(numbers, min_size=k * n, max_size=k * n)), (k, n)) / 100
    chosen = one_each(share, 0.1)
    taken = [i for i in chosen if i is not None]
    assert len(set(taken)) == len(taken)
    assert all(share[j, i] >= 0.1 for j, i in enumerate(chosen) if i is not None)
    best = max(
        sum(share[j, i] for j, i in enumerate(each) if i < n and share[j, i] >= 0.1)
        for each in itertools.product(range(n + 1), repeat=k)
        if len({i for i in each if i < n}) == sum(i < n for i in each)
    )
    found = sum(share[j, i] for j, i in enumerate(chosen) if i is not None)
    assert found == pytest.approx(best)


def test_interchangeable_instances_have_equal_shares() -> None:
    found = joint_marginals(np.full((8, 8), 0.7), np.full(8, 1e-9), np.full(8, 0.3))
    np.testing.assert_allclose(found[:, :-1], 1 / 8, atol=1e-6)


def test_many_detections_have_the_best_hypotheses() -> None:
    k = joint_posterior.FEW + 8
    same = np.full((k, k), 1e-4) + np.diag(np.full(k, 10.0))
    found = joint_marginals(same, np.full(k, 0.01), np.full(k, 0.3))
    assert (np.diag(found) > 0.9).all()
    np.testing.assert_allclose(found.sum(axis=1), 1)


def test_what_is_no_view() -> None:
    with pytest.raises(BeliefError, match="same has shape"):
        joint_marginals([[0.5]], [0.1], [0.5, 0.5])
    assert joint_marginals(np.empty((0, 2)), [], [0.5, 0.5]).shape == (0, 3)
    assert joint_marginals(np.empty((2, 0)), [0.1, 0.1], []).tolist() == [[1.0], [1.0]]
    assert one_each(np.empty((2, 0)), 0.1) == [None, None]
