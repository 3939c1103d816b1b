"""Simple link patterns: thresholds on the aggregated similarity, judged without labels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.version_space import LEVELS, Levels

AGGREGATE, LEFT, RIGHT = -3, -2, -1
"""Columns of `semmap.interlinking.comparison.WHOLE`: the aggregate, and its share of the best one
of the left and of the right record."""

SIDES: tuple[tuple[int, ...], ...] = ((), (LEFT,), (RIGHT,), (LEFT, RIGHT))


@dataclass(frozen=True)
class SimplePatterns:
    """Thresholds: of all pairs first, then of those that are best for a record of each side."""

    patterns: Levels  # (n, d)
    scores: NDArray[np.float64]  # (n,) the pseudo F-measure of each

    @classmethod
    def of(cls, pairs: NDArray[np.int64], levels: Levels) -> Self:
        """Return all of them for candidate pairs, (m, 2), and their levels, (m, d)."""
        rows, scores = [], []
        for sides in SIDES:
            best = (levels[:, list(sides)] == LEVELS).all(axis=1)
            for threshold in range(LEVELS + 1):
                row = np.zeros(levels.shape[1], np.int8)
                row[list(sides)], row[AGGREGATE] = LEVELS, threshold
                rows.append(row)
                scores.append(pseudo_f(pairs[best & (levels[:, AGGREGATE] >= threshold)], pairs))
        return cls(np.array(rows), np.array(scores))

    @property
    def thresholds(self) -> slice:
        """The patterns of all pairs: without labels, the others may miss many links."""
        return slice(0, LEVELS + 1)


def pseudo_f(links: NDArray[np.int64], candidates: NDArray[np.int64]) -> float:
    """How one-to-one links are, and how complete where each record of one side has one.

    The pseudo F-measure of Nikolov, d'Aquin and Motta, which needs no labels.
    """
    if not len(links):
        return 0.0
    linked, all_ = (
        [np.count_nonzero(np.bincount(side)) for side in pairs.T] for pairs in (links, candidates)
    )
    precision = max(linked) / len(links)
    recall = max(linked) / max(min(all_), max(linked))
    return 2 * precision * recall / (precision + recall)
