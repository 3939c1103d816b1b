"""K-medoids beside brute force over all medoids."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.interlinking.correspondences import best_k_medoids, k_medoids, silhouette


def distances(points) -> np.ndarray:
    points = np.array(points, float)
    return np.abs(points[:, None] - points)


def cost(d, medoids) -> float:
    return d[:, list(medoids)].min(axis=1).sum()


@given(st.lists(st.floats(0, 100), min_size=3, max_size=7), st.integers(1, 3))
def test_no_exchange_of_a_medoid_is_better(points, k) -> None:
    d = distances(points)
    groups = k_medoids(d, k)
    costs = [min(d[np.ix_(groups == g, groups == g)].sum(axis=0)) for g in np.unique(groups)]
    best = min(cost(d, chosen) for chosen in combinations(range(len(points)), k))
    assert sum(costs) <= 5 * best + 1e-9  # the bound of a local optimum of single exchanges


def test_separate_groups_are_found_with_their_number() -> None:
    d = distances([0, 0.1, 0.2, 5, 5.1, 9, 9.1])
    assert k_medoids(d, 3).tolist() == best_k_medoids(d, 6).tolist()
    assert len(set(best_k_medoids(d, 6)[[0, 3, 5]])) == 3
    assert silhouette(d, best_k_medoids(d, 6)) > 0.9


def test_a_wrong_k_is_refused() -> None:
    with pytest.raises(ValueError, match="1 to 3"):
        k_medoids(distances([1, 2, 3]), 4)
