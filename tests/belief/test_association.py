"""Moved or new: against all hypotheses."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.belief.association import NEW, associate, view_likelihoods
from semmap.belief.error import BeliefError


def moved_or_new(*args, keep=10, **more):
    return associate(*view_likelihoods(*args, **more), keep)


def all_hypotheses(same, new, missed) -> dict[tuple[int, ...], float]:
    found = {}
    for chosen in itertools.product(range(NEW, len(missed)), repeat=len(new)):
        known = [i for i in chosen if i != NEW]
        if len(set(known)) == len(known):
            weight = math.prod(m for i, m in enumerate(missed) if i not in known)
            weight *= math.prod(new[j] if i == NEW else same[j][i] for j, i in enumerate(chosen))
            if weight > 0:
                found[chosen] = weight
    return found


def random_likelihoods(seed: int):
    random = np.random.default_rng(seed)
    k, n = random.integers(0, 4), random.integers(0, 5)
    same = random.random((k, n)) * (random.random((k, n)) < 0.7)
    return same, 0.01 + random.random(k), 1 - random.random(n)


@settings(max_examples=200)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_the_best_hypotheses_are_kept_best_first(seed: int, keep: int) -> None:
    same, new, missed = random_likelihoods(seed)
    expected = sorted(all_hypotheses(same, new, missed).values(), reverse=True)[:keep]
    found = associate(same, new, missed, keep)
    weights = all_hypotheses(same, new, missed)
    of_found = [weights[tuple(row)] for row in found.instance.tolist()]
    np.testing.assert_allclose(of_found, expected, rtol=1e-9)
    np.testing.assert_allclose(found.probability, np.array(expected) / sum(expected), rtol=1e-9)
    assert len({tuple(row) for row in found.instance.tolist()}) == len(found.instance)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_marginals_of_all_hypotheses_are_exact(seed: int) -> None:
    same, new, missed = random_likelihoods(seed)
    weights = all_hypotheses(same, new, missed)
    expected = np.zeros((len(new), len(missed) + 1))
    for chosen, weight in weights.items():
        expected[np.arange(len(new)), chosen] += weight / sum(weights.values())
    found = associate(same, new, missed, keep=1000).marginals(len(missed))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def cup(seen_at: int, belief, **more) -> float:
    """P(the cup seen is the known one)."""
    view = np.eye(len(belief))[seen_at]
    found = moved_or_new([belief], view, [seen_at], [[0.9]], **more)
    return float(found.marginals(1)[0, 0])


def test_a_cup_where_another_was_is_that_one() -> None:
    assert cup(0, [0.9, 0.1]) > 0.9


def test_a_cup_elsewhere_is_new_unless_the_known_one_had_time_to_move() -> None:
    just_seen, long_ago = [0.9999, 0.0001], [0.6, 0.4]
    assert cup(1, just_seen) < 0.01
    assert cup(1, long_ago) > 0.8


def test_a_cup_of_another_size_is_new() -> None:
    assert cup(0, [0.9, 0.1], size=[0.1], known_size=[0.102]) > 0.95
    assert cup(0, [0.9, 0.1], size=[0.1], known_size=[0.2]) < 0.01
    unknown = cup(0, [0.9, 0.1], size=[0.1], known_size=[np.nan])
    assert unknown == pytest.approx(cup(0, [0.9, 0.1]), rel=1e-12)


def test_a_cup_of_another_class_is_new() -> None:
    seen = moved_or_new([[0.9, 0.1]], [1, 0], [0], [[0.001]])
    assert seen.marginals(1)[0, 0] < 0.05


def test_two_cups_are_not_one_instance() -> None:
    two = moved_or_new([[0.9, 0.1]], [1, 1], [0, 1], [[0.9], [0.9]]).marginals(1)
    assert two[0, 0] > 0.8
    assert two[1, 0] < 0.1
    np.testing.assert_allclose(two.sum(axis=1), 1)


def test_the_weights_of_a_view_are_those_of_the_model() -> None:
    """Two instances, one detection; worked out by hand."""
    found = moved_or_new(
        [[0.5, 0.5], [0.2, 0.8]], [0.5, 1.0], [0], [[0.9, 0.3]], hit=0.8, new=[0.1], keep=9
    )
    miss = (1 - 0.8 * (0.25 + 0.5), 1 - 0.8 * (0.1 + 0.8))
    weights = [
        0.8 * 0.5 * 0.5 * 0.9 * miss[1],
        0.8 * 0.5 * 0.2 * 0.3 * miss[0],
        0.8 * 0.5 * 0.1 * miss[0] * miss[1],
    ]
    expected = [weights[i] / sum(weights) for i in (0, 1, 2)]
    np.testing.assert_allclose(found.marginals(2)[0], expected, rtol=1e-12)


VIEW = {"belief": [[0.5, 0.5]], "view": [1.0, 0.0], "place": [0], "same_class": [[0.9]]}


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"place": [1]}, "detection 0 is at place 1, which is not in the view"),
        ({"place": [2]}, r"place is \[2\]: the belief has places 0 to 1"),
        ({"place": [0.0]}, "place: give a column"),
        ({"view": [1.0]}, r"view has shape \(1,\)"),
        ({"view": [1.0, 2.0]}, "give shares in"),
        ({"same_class": [0.9]}, r"same_class has shape \(1,\): give \(1, 1\)"),
        ({"same_class": [[-0.9]]}, "same has a likelihood"),
        ({"hit": 1.0}, "hit is 1.0: give a probability"),
        ({"new": [0.0]}, "new is .*: give likelihoods above 0"),
        ({"keep": 0}, "keep is 0: give at least 1"),
        ({"size": [1.0, 2.0], "known_size": [1.0]}, "sizes: 2 and 1 are given"),
        ({"size": [0.0], "known_size": [1.0]}, "sizes: give lengths above 0"),
        ({"size": [1.0], "known_size": [1.0], "spread": 0}, "spread is 0: give"),
    ],
)
def test_what_is_no_view(change: dict[str, object], text: str) -> None:
    with pytest.raises(BeliefError, match=text):
        moved_or_new(**{**VIEW, **change})
