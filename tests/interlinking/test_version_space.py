"""Version spaces beside an enumeration of all patterns."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from semmap.interlinking.version_space import LEVELS, learn, levels, matches

TOP = 3  # patterns of few levels can be enumerated
vectors = st.lists(st.tuples(*[st.integers(0, TOP)] * 3), max_size=6)


def as_levels(rows) -> np.ndarray:
    return np.array(rows, np.int8).reshape(-1, 3)


def consistent(positives, negatives) -> set[tuple[int, ...]]:
    """All patterns that link each positive and no negative."""
    return {
        p
        for p in product(range(TOP + 1), repeat=3)
        if all(all(a >= b for a, b in zip(x, p, strict=True)) for x in positives)
        and not any(all(a >= b for a, b in zip(x, p, strict=True)) for x in negatives)
    }


@given(vectors.filter(bool), vectors)
def test_a_space_has_exactly_the_consistent_patterns(positives, negatives) -> None:
    spaces, unexplained = learn(as_levels(positives), as_levels(negatives))
    every = consistent(positives, negatives)
    if not every:
        assert len(spaces) != 1 or unexplained
        return
    assert len(spaces) == 1
    assert not unexplained
    specific, general = spaces[0].specific, spaces[0].general
    patterns = product(range(TOP + 1), repeat=3)
    between = {p for p in patterns if (p <= specific).all() and (general <= p).all(axis=1).any()}
    assert between == every


@given(vectors, vectors)
def test_spaces_link_all_positives_and_no_negative(positives, negatives) -> None:
    spaces, unexplained = learn(as_levels(positives), as_levels(negatives))
    patterns = np.vstack([as_levels([]), *(np.vstack([s.specific, s.general]) for s in spaces)])
    assert not matches(patterns, as_levels(negatives)).any()
    specific = as_levels([s.specific for s in spaces])
    covered = matches(specific, as_levels(positives)).any(axis=1)
    assert set(np.flatnonzero(~covered)) == set(unexplained)
    for i in unexplained:
        assert any(all(a >= b for a, b in zip(n, positives[i], strict=True)) for n in negatives)


@given(vectors.filter(bool), vectors, st.randoms())
def test_the_order_of_labels_does_not_matter_to_a_conjunction(positives, negatives, order) -> None:
    spaces, _ = learn(as_levels(positives), as_levels(negatives))
    order.shuffle(positives)
    order.shuffle(negatives)
    other, _ = learn(as_levels(positives), as_levels(negatives))
    if len(spaces) == 1:
        assert (spaces[0].specific == other[0].specific).all()
        assert {*map(tuple, spaces[0].general.tolist())} == {*map(tuple, other[0].general.tolist())}


def test_two_conjunctions_where_one_is_not_enough() -> None:
    spaces, unexplained = learn(as_levels([[3, 0, 3], [0, 3, 3]]), as_levels([[2, 2, 3]]))
    assert not unexplained
    assert len(spaces) == 2


def test_levels() -> None:
    assert levels(np.array([0, 0.5, 1, np.nan])).tolist() == [0, LEVELS // 2, LEVELS, 0]
