"""The link pattern: chosen from the version space, and which pair to ask a person about next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.comparison import Comparison
from semmap.interlinking.version_space import (
    LEVELS,
    Levels,
    VersionSpace,
    learn,
    matches,
    simplest,
)

OPTIONS = 60  # of so many patterns of a version space, the simplest ones, one is chosen

AGGREGATE = -3
"""The column of the aggregated similarity, see `semmap.interlinking.comparison.WHOLE`."""


@dataclass(frozen=True)
class LinkPattern:
    """Conjunctions, of which a link fulfils at least one."""

    spaces: Sequence[VersionSpace]  # the version spaces that agree with the labels
    chosen: Levels  # (spaces, d) the pattern that is chosen from each
    # labelled pairs that are the same although a negative pair is as similar in all respects
    unexplained: Sequence[int]

    def links(self, pairs: Levels) -> NDArray[np.bool_]:
        """Return whether each pair is linked."""
        return np.asarray(matches(self.chosen, pairs).any(axis=1))

    def confidence(self, pairs: Levels) -> NDArray[np.float64]:
        """Return the share of the most specific and most general patterns that link each pair."""
        return _confidence(self.spaces, pairs)

    def text(self, features: Sequence[str]) -> str:
        """Return the pattern for people: conditions joined by "and", conjunctions by "or"."""
        conjunctions = [
            " and ".join(
                f"{name} >= {level / LEVELS:g}"
                for name, level in zip(features, row, strict=True)
                if level > 0
            )
            for row in self.chosen.tolist()
        ]
        return " or ".join(text or "any candidate" for text in conjunctions) or "labelled the same"


def _confidence(spaces: Sequence[VersionSpace], pairs: Levels) -> NDArray[np.float64]:
    found = np.zeros(len(pairs))
    for space in spaces:
        general = matches(space.general, pairs).mean(axis=1)
        specific = matches(space.specific[None], pairs)[:, 0]
        found = np.maximum(found, (general + specific) / 2)
    return found


def learn_pattern(comparison: Comparison, labels: Mapping[int, bool]) -> LinkPattern:
    """Return the pattern that labels of candidate pairs, by number, lead to.

    Many patterns agree with few labels. Of those, the one is chosen whose links are the most
    one-to-one and complete: the pseudo F-measure of Nikolov, d'Aquin and Motta, without labels.
    """
    same = [i for i, yes in labels.items() if yes]
    different = [i for i, yes in labels.items() if not yes]
    spaces, hopeless = learn(comparison.levels[same], comparison.levels[different])
    chosen = [_choose(space, comparison, comparison.levels[different]) for space in spaces]
    rows = np.array(chosen, np.int8).reshape(len(chosen), len(comparison.features))
    return LinkPattern(spaces, rows, [same[i] for i in hopeless])


def _choose(space: VersionSpace, comparison: Comparison, negatives: Levels) -> Levels:
    """The pattern with the best links, at a threshold on the aggregate (line 12)."""
    middle = (space.general.astype(int) + space.specific + 1) // 2
    options = np.vstack([space.specific[None], middle.astype(np.int8), space.general])
    lowest = int(space.specific[AGGREGATE])
    below = negatives[:, AGGREGATE][negatives[:, AGGREGATE] < lowest]
    if len(below):
        thresholds = [(lowest + int(below.max()) + 1) // 2]
    else:
        thresholds = [lowest * share // 8 for share in range(9)]
    options = np.vstack([options] * len(thresholds))
    threshold = np.repeat(thresholds, len(options) // len(thresholds)).astype(np.int8)
    options[:, AGGREGATE] = np.maximum(options[:, AGGREGATE], threshold)
    options = simplest(np.unique(options, axis=0))[:OPTIONS]
    scores = []
    for option in options:
        linked = matches(option[None], comparison.levels)[:, 0]
        scores.append(_pseudo_f(comparison.pairs[linked], comparison.pairs))
    chosen: Levels = options[int(np.argmax(scores))]
    return chosen


def _pseudo_f(links: NDArray[np.int64], candidates: NDArray[np.int64]) -> float:
    """How one-to-one links are, and how complete where each record of one side has one."""
    if not len(links):
        return 0.0
    linked, all_ = (
        [np.count_nonzero(np.bincount(side)) for side in pairs.T] for pairs in (links, candidates)
    )
    precision = max(linked) / len(links)
    recall = max(linked) / max(min(all_), max(linked))
    return 2 * precision * recall / (precision + recall)


def next_question(comparison: Comparison, labels: Mapping[int, bool]) -> int | None:
    """Return the candidate pair whose label tells most; None where all are labelled.

    Undecided is a pair that some patterns of the version space link and others do not. Of those
    that are best for one of their records, it is the one in the middle between pairs labelled the
    same and pairs labelled different. Without an undecided pair, any other one.
    """
    v = comparison.likelihood
    best = np.asarray((comparison.similarities[:, -2:] >= 1).any(axis=1))
    best[list(labels)] = False
    same = [i for i, yes in labels.items() if yes]
    if not same:
        open_ = np.flatnonzero(best)
        return int(open_[np.argmax(v[open_])]) if len(open_) else None
    different = [i for i, yes in labels.items() if not yes]
    spaces, _ = learn(comparison.levels[same], comparison.levels[different])
    places = np.flatnonzero(best)
    confidence = _confidence(spaces, comparison.levels[places])
    open_ = places[(confidence > 0) & (confidence < 1)]
    if not len(open_):
        open_ = np.flatnonzero(best)
    if not len(open_):
        return None
    low = max(v[different]) if different else float(v[open_].min())
    middle = (min(v[same]) + low) / 2
    return int(open_[np.argmin(np.abs(v[open_] - middle))])
