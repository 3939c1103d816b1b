"""The version space of link patterns (Mitchell; Fan): conjunctions of lowest similarities.

All patterns that agree with the labels lie between the most specific and the most general ones.
Where no conjunction agrees with all labels there are several spaces: any may link a pair.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Levels = NDArray[np.int8]

LEVELS = 50  # a similarity of 1 has this level; 0 is also the level of a missing value

MOST_GENERAL = 200
"""At most so many most general patterns are kept, those with the fewest and lowest conditions."""


def levels(similarities: NDArray[np.float64]) -> Levels:
    """Return similarities in [0, 1] as levels; NaN, which stands for no value, has level 0."""
    return np.floor(np.nan_to_num(similarities) * LEVELS + 1e-9).astype(np.int8)


def matches(patterns: Levels, pairs: Levels) -> NDArray[np.bool_]:
    """Return whether each pattern links each pair, shape (pairs, patterns)."""
    found = np.ones((len(pairs), len(patterns)), bool)
    for column, needed in zip(pairs.T, patterns.T, strict=True):
        found &= column[:, None] >= needed
    return found


@dataclass(frozen=True)
class VersionSpace:
    """All conjunctions that link some positive pairs and none of the negative pairs."""

    # (d,) the most specific pattern; each of the positive pairs has at least these levels
    specific: Levels
    # (g, d) the most general patterns. A pattern p is in the space if ``g <= p <= specific`` for
    # one of them
    general: Levels


def learn(positives: Levels, negatives: Levels) -> tuple[list[VersionSpace], list[int]]:
    """Return version spaces that together link all positive pairs, (n, d), and no negative, (m, d).

    They are as few as adding the positives one by one leads to, the most similar first. Also
    returned are the positives than which a negative is as similar in all respects.
    """
    hopeless = [i for i, p in enumerate(positives) if (negatives >= p).all(axis=1).any()]
    specifics: list[Levels] = []
    order = np.argsort(-positives.sum(axis=1, dtype=int), kind="stable")
    for i in (int(i) for i in order if i not in {*hopeless}):
        for place, specific in enumerate(specifics):
            wider = np.minimum(specific, positives[i])
            if not (negatives >= wider).all(axis=1).any():
                specifics[place] = wider
                break
        else:
            specifics.append(positives[i])
    return [VersionSpace(s, _most_general(s, negatives)) for s in specifics], hopeless


def _most_general(specific: Levels, negatives: Levels) -> Levels:
    """The minimal patterns below `specific` that exclude each negative (candidate elimination)."""
    found = np.zeros((1, len(specific)), np.int8)
    for negative in np.unique(negatives, axis=0):
        excluded = (found > negative).any(axis=1)
        split = [found[excluded]]
        for i in np.flatnonzero(negative < specific):
            raised = found[~excluded].copy()
            raised[:, i] = negative[i] + 1
            split.append(raised)
        found = _minimal(np.unique(np.vstack(split), axis=0))
    return found


def _minimal(patterns: Levels) -> Levels:
    """The patterns that are not more special than another one, the simplest first."""
    found = np.empty((0, patterns.shape[1]), np.int8)
    for pattern in simplest(patterns):
        if not (found <= pattern).all(axis=1).any():
            found = np.vstack([found, pattern])
            if len(found) == MOST_GENERAL:
                break
    return found


def simplest(patterns: Levels) -> Levels:
    """Return patterns in the order of the number of conditions, then of the sum of levels."""
    return patterns[np.lexsort((patterns.sum(axis=1, dtype=int), (patterns > 0).sum(axis=1)))]
