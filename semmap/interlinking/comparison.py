"""Candidate pairs: similarities, their aggregate, and the rank of a pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.blocking import candidate_pairs
from semmap.interlinking.correspondences import Correspondence
from semmap.interlinking.records import Records
from semmap.interlinking.similarity import compare
from semmap.interlinking.simple_patterns import SimplePatterns
from semmap.interlinking.version_space import LEVELS, Levels, levels

WHOLE = (
    "rare words in common",
    "likelihood",
    "best of the left record",
    "best of the right record",
)
"""Similarities of whole records, which follow those of the correspondences: of the keys of
blocking; how much more likely the similarities are of the same resource (the aggregate v of
Algorithm 1, line 11); and that aggregate as a share of the best one that either record has."""

PRIOR = 2.0
"""So many pairs are assumed to be distributed over the levels like those of the other kind."""

RANDOM = 50_000  # pairs at random, which show how similar different records are


@dataclass(frozen=True)
class Comparison:
    """Candidate pairs of two data sets."""

    pairs: NDArray[np.int64]  # (n, 2) numbers of a left and a right record
    features: Sequence[str]  # names of the d similarities
    similarities: NDArray[np.float64]  # (n, d) in [0, 1]; NaN where a record has no value
    levels: Levels  # (n, d), see `semmap.interlinking.version_space.levels`

    @property
    def likelihood(self) -> NDArray[np.float64]:
        """(n,) the aggregated similarity, in [0, 1]."""
        return self.similarities[:, -3]

    @cached_property
    def simple(self) -> SimplePatterns:
        """The simple patterns of these pairs."""
        return SimplePatterns.of(self.pairs, self.levels)


def compare_records(
    left: Records,
    right: Records,
    correspondences: Sequence[Correspondence],
    progress: Callable[[int, int], None] = lambda done, total: None,
    also: NDArray[np.int64] | None = None,
) -> Comparison:
    """Return candidate pairs with their similarities (lines 8 to 11), and pairs `also`, (m, 2)."""
    found, shared = candidate_pairs(left, right, correspondences, progress)
    if also is not None and len(also):
        left_out = also[~np.isin(also @ [len(right), 1], found @ [len(right), 1])]
        found, first = np.unique(np.vstack([found, left_out]), axis=0, return_index=True)
        shared = np.append(shared, np.zeros(len(left_out)))[first]
    parts = compare(left, right, correspondences, found)
    random = np.random.default_rng(0)
    strangers = np.column_stack([random.integers(0, len(s), RANDOM) for s in (left, right)])
    apart = compare(left, right, correspondences, strangers)
    likelihood = _likelihood(parts, apart, shared, found)
    best = [_share_of_best(likelihood, side) for side in found.T]
    similarities = np.column_stack([parts, shared, likelihood, *best])
    names = [f"{c.left} = {c.right} ({c.measure})" for c in correspondences]
    return Comparison(found, [*names, *WHOLE], similarities, levels(similarities))


def _likelihood(
    parts: NDArray[np.float64],
    apart: NDArray[np.float64],
    shared: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> NDArray[np.float64]:
    """The aggregate: weights of agreement by level (Fellegi and Sunter), scaled to [0, 1].

    Those of the same resource are learnt from pairs that are best for both records, at first by the
    plain mean of the similarities.
    """
    if not len(pairs):
        return np.empty(0)
    with np.errstate(invalid="ignore"):
        known = np.isfinite(parts)
        plain = (np.nansum(parts, axis=1) + shared) / (known.sum(axis=1) + 1)
    score = plain
    for _ in range(3):
        mutual = np.all([_share_of_best(score, side) >= 1 for side in pairs.T], axis=0)
        likely = mutual & (score >= np.median(score[mutual]))
        total = np.zeros(len(parts))
        most = np.zeros(len(parts))
        least = np.zeros(len(parts))
        for column, other in zip(parts.T, apart.T, strict=True):
            weights = _weights(column[likely], other)
            filled = np.isfinite(column)
            at = levels(column)[filled]
            total[filled] += weights[at]
            most[filled] += weights[-1]
            least += weights[0]
        score = (total - least.min()) / max(most.max() - least.min(), 1e-9)
    return np.asarray(np.clip(score, 0, 1), np.float64)


def _weights(same: NDArray[np.float64], different: NDArray[np.float64]) -> NDArray[np.float64]:
    """log P(level | same) / P(level | different) of each level, not decreasing."""
    counts = [
        np.bincount(levels(values[np.isfinite(values)]), minlength=LEVELS + 1) + 0.0
        for values in (same, different)
    ]
    shares = [(c + 1e-9) / (c + 1e-9).sum() for c in counts]
    smooth = [
        (c + PRIOR * other) / (c.sum() + PRIOR)
        for c, other in zip(counts, reversed(shares), strict=True)
    ]
    return np.asarray(np.maximum.accumulate(np.log(smooth[0] / smooth[1])), np.float64)


def _share_of_best(score: NDArray[np.float64], side: NDArray[np.int64]) -> NDArray[np.float64]:
    """The score of each pair by the best one of its record on a side, in [0, 1]; 1 for the best."""
    if not len(side):
        return np.empty(0)
    top = np.zeros(side.max() + 1)
    np.maximum.at(top, side, score)
    return np.where(top[side] > 0, score / np.where(top[side] > 0, top[side], 1), 1.0)
