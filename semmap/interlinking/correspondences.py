"""Which properties of two data sets correspond: the alignment of Algorithm 1, lines 3 to 7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from semmap.interlinking.k_medoids import best_k_medoids
from semmap.interlinking.property_statistics import common_words, is_numeric, property_statistics
from semmap.interlinking.records import PropertyColumn, Records


@dataclass(frozen=True)
class Correspondence:
    """A property of the left data set, one of the right, and one of `similarity.MEASURES`."""

    left: str
    right: str
    measure: str


def find_correspondences(left: Records, right: Records) -> list[Correspondence]:
    """Return which properties correspond, each at most once.

    K-medoids groups them by their statistics and common words, into at most as many groups as the
    larger data set has properties. Within a group, then among the rest, the assignment of the
    smallest dissimilarity is taken. A wrong correspondence does little harm, because the aggregate
    gives it no weight; a missing one does.
    """
    columns = [*left.columns.items(), *right.columns.items()]
    split = len(left.columns)
    statistics = np.vstack([property_statistics(left), property_statistics(right)])
    spread = statistics.std(axis=0)
    scaled = statistics / np.where(spread > 0, spread, 1)
    apart = np.sqrt(((scaled[:, None] - scaled) ** 2).mean(axis=2))
    dissimilarity = apart + 2 * (1 - common_words([column for _, column in columns]))
    np.fill_diagonal(dissimilarity, 0)
    groups = best_k_medoids(dissimilarity, max(split, len(columns) - split))
    matched: list[tuple[int, int]] = []
    for group in np.unique(groups):
        matched += _assign(dissimilarity, np.flatnonzero(groups == group), split)
    rest = np.setdiff1d(np.arange(len(columns)), np.ravel(matched))
    matched += _assign(dissimilarity, rest, split)
    return [
        Correspondence(columns[i][0], columns[j][0], _measure(columns[i][1], columns[j][1]))
        for i, j in sorted(matched)
    ]


def _assign(
    dissimilarity: NDArray[np.float64], members: NDArray[np.int64], split: int
) -> list[tuple[int, int]]:
    """Pairs of a left and a right property among members, of the smallest dissimilarity."""
    a, b = members[members < split], members[members >= split]
    rows, columns = linear_sum_assignment(dissimilarity[np.ix_(a, b)])
    return [(int(a[i]), int(b[j])) for i, j in zip(rows, columns, strict=True)]


def _measure(left: PropertyColumn, right: PropertyColumn) -> str:
    if is_numeric(left) and is_numeric(right):
        return "number"
    words = np.mean([text.count(" ") + 1 for c in (left, right) for text in c.texts[:5000]])
    return "words" if words > 1.5 else "letters"
