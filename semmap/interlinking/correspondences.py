"""Which properties of two data sets correspond: the alignment of Algorithm 1, lines 3 to 7."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from semmap.interlinking.records import PropertyColumn, Records

SAMPLE = 5_000
"""At most so many values of a property are looked at: a change of the order of records may then
change statistics in the third digit."""


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
    statistics = np.vstack([_property_statistics(left), _property_statistics(right)])
    spread = statistics.std(axis=0)
    scaled = statistics / np.where(spread > 0, spread, 1)
    apart = np.sqrt(((scaled[:, None] - scaled) ** 2).mean(axis=2))
    dissimilarity = apart + 2 * (1 - _common_words([column for _, column in columns]))
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
    if _is_numeric(left) and _is_numeric(right):
        return "number"
    words = np.mean([text.count(" ") + 1 for c in (left, right) for text in c.texts[:5000]])
    return "words" if words > 1.5 else "letters"


def _property_statistics(records: Records) -> NDArray[np.float64]:
    """Return the statistics of each property, shape (properties, 10)."""
    return np.array([_statistics(column, len(records)) for column in records.columns.values()])


def _statistics(column: PropertyColumn, records: int) -> list[float]:
    sample = _sample(column)
    lengths = np.array([len(t) for t in sample], dtype=float)
    total = lengths.sum()
    together = "".join(sample)
    values = numbers(sample)
    finite = values[np.isfinite(values)]
    return [
        np.count_nonzero(np.diff(column.starts)) / records,
        len(set(sample)) / len(sample),
        np.log2(lengths.mean()),
        np.log2(1 + lengths.std()),
        np.log2(np.mean([t.count(" ") + 1 for t in sample])),
        sum(map(str.isdigit, together)) / total,
        sum(map(str.isalpha, together)) / total,
        len(finite) / len(sample),
        np.count_nonzero(finite == np.round(finite)) / len(sample),
        float(np.log10(1e-6 + np.median(np.abs(finite)))) if len(finite) else 0.0,
    ]


def _sample(column: PropertyColumn) -> list[str]:
    step = max(len(column.texts) // SAMPLE, 1)
    return column.texts[::step].tolist()  # type: ignore[no-any-return]


def numbers(texts: Sequence[str] | NDArray[np.object_]) -> NDArray[np.float64]:
    """Return texts as numbers; NaN where one is not a finite number."""
    found = np.full(len(texts), np.nan)
    for i, text in enumerate(texts):
        try:
            found[i] = float(text)
        except ValueError:
            continue
    found[np.isinf(found)] = np.nan
    return found


def _is_numeric(column: PropertyColumn) -> bool:
    """Return whether the values are measurements: numbers of which some have a fraction."""
    values = numbers(_sample(column))
    share = np.isfinite(values).mean()
    return bool(share > 0.9 and np.any(values[np.isfinite(values)] % 1))


def _common_words(columns: Sequence[PropertyColumn]) -> NDArray[np.float64]:
    """Return the overlap coefficient of the words of properties, (n, n): by the smaller set."""
    words = [set(" ".join(_words_of(column)).split()) for column in columns]
    return np.array([[len(a & b) / min(len(a), len(b)) for b in words] for a in words])


def _words_of(column: PropertyColumn) -> list[str]:
    """Texts of a column; of many, those whose hash is smallest, which another column has, too."""
    texts = set(column.texts.tolist())
    if len(texts) <= SAMPLE:
        return list(texts)
    return sorted(texts, key=lambda text: crc32(text.encode()))[:SAMPLE]


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
