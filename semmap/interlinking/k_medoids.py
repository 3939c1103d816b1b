"""K-medoids: groups around members, for any dissimilarity (PAM of Kaufman and Rousseeuw)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Labels = NDArray[np.int64]


def k_medoids(dissimilarity: NDArray[np.float64], k: int) -> Labels:
    """Return the group of each of n members: the number of its nearest of k medoids.

    Dissimilarities are (n, n), symmetric, zero on the diagonal. Medoids are added one by one where
    they lower their sum most, and exchanged with other members until no exchange lowers it.
    """
    n = len(dissimilarity)
    if not 1 <= k <= n:
        raise ValueError(f"k is {k}: give 1 to {n}")
    medoids: list[int] = []
    for _ in range(k):
        others = set(range(n)) - {*medoids}
        medoids.append(min(others, key=lambda i: _cost(dissimilarity, [*medoids, i])))
    cost = _cost(dissimilarity, medoids)
    improved = True
    while improved:
        improved = False
        for place in range(k):
            for i in set(range(n)) - {*medoids}:
                exchanged = [*medoids[:place], i, *medoids[place + 1 :]]
                if (other := _cost(dissimilarity, exchanged)) < cost - 1e-12:
                    medoids, cost, improved = exchanged, other, True
    nearest: Labels = np.argmin(dissimilarity[:, medoids], axis=1)
    return nearest


def _cost(dissimilarity: NDArray[np.float64], medoids: list[int]) -> float:
    return float(dissimilarity[:, medoids].min(axis=1).sum())


def silhouette(dissimilarity: NDArray[np.float64], labels: Labels) -> float:
    """Return the mean silhouette of groups, in [-1, 1]; a member alone in its group counts 0."""
    groups = np.unique(labels)
    if len(groups) < 2:
        return 0.0
    member = labels[:, None] == groups
    sums = dissimilarity @ member
    sizes = member.sum(axis=0)
    own = member.argmax(axis=1)
    rows = np.arange(len(labels))
    within = sums[rows, own] / np.maximum(sizes[own] - 1, 1)
    means = sums / sizes
    means[rows, own] = np.inf
    nearest = means.min(axis=1)
    widths = (nearest - within) / np.maximum(np.maximum(nearest, within), 1e-12)
    return float(np.where(sizes[own] > 1, widths, 0.0).mean())


def best_k_medoids(dissimilarity: NDArray[np.float64], most: int) -> Labels:
    """Return the groups of the k in 2..most that has the largest mean silhouette."""
    tried = [k_medoids(dissimilarity, k) for k in range(2, most + 1)]
    if not tried:
        return np.zeros(len(dissimilarity), np.int64)
    return max(tried, key=lambda labels: silhouette(dissimilarity, labels))
