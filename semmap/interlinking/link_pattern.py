"""The link pattern: chosen from the version space, and which pair to ask a person about next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.comparison import Comparison
from semmap.interlinking.simple_patterns import AGGREGATE, pseudo_f
from semmap.interlinking.version_space import (
    LEVELS,
    Levels,
    VersionSpace,
    learn,
    matches,
    simplest,
)

OPTIONS = 60  # of so many patterns of a version space, the simplest ones, one is chosen

COST = 0.03
"""A wrong answer, a condition on one property and a further conjunction count as much as this
difference of the pseudo F-measure."""

MOST_WRONG = 0.25
"""At most this share of the answers is doubted: who is wrong more often cannot be told from data
sets that a pattern does not explain."""

Votes = Mapping[int, int]
"""By candidate pair: how many more answers say that both records are the same than that not."""


@dataclass(frozen=True)
class LinkPattern:
    """Conjunctions, of which a link fulfils at least one."""

    spaces: Sequence[VersionSpace]  # the version spaces that agree with the labels
    chosen: Levels  # (spaces, d) the pattern that is chosen from each
    # labelled pairs that are the same although a negative pair is as similar in all respects
    unexplained: Sequence[int]
    doubted: Sequence[int]  # labelled pairs whose labels are probably wrong, and left out

    def links(self, pairs: Levels) -> NDArray[np.bool_]:
        """Return whether each pair is linked."""
        return np.asarray(matches(self.chosen, pairs).any(axis=1))

    def confidence(self, pairs: Levels) -> NDArray[np.float64]:
        """Return the share of the most specific and most general patterns that link each pair.

        Without a version space, it is the aggregated similarity.
        """
        if not self.spaces:
            return pairs[:, AGGREGATE] / LEVELS
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


def learn_pattern(comparison: Comparison, labels: Votes) -> LinkPattern:
    """Return the pattern that labels of candidate pairs, by number, lead to.

    Many patterns agree with few labels. Of those, the one is chosen whose links have the highest
    `pseudo_f`; a threshold on the aggregate alone, if it agrees and its links are as good. Labels
    that are probably wrong are doubted, and left out. Without labels of both kinds, it is the
    threshold that agrees best with those that there are.
    """
    simple = comparison.simple
    agrees, wrong = _contradictions(comparison, labels)
    worth = simple.scores - COST * wrong
    strict = _agreeing(comparison, labels)
    plain = int(np.argmax(worth[simple.thresholds]))
    threshold = replace(strict, chosen=simple.patterns[[plain]])
    if not all(_kinds(labels)):
        return threshold
    if strict.spaces and not wrong[plain] and worth[plain] > _worth(strict, comparison):
        return threshold
    best = int(np.argmax(worth))
    if not 0 < wrong[best] <= MOST_WRONG * sum(map(abs, labels.values())):
        return strict
    doubted = [
        p for p, right in zip(labels, agrees[:, best], strict=True) if labels[p] and not right
    ]
    other = _agreeing(comparison, {p: v for p, v in labels.items() if p not in doubted})
    if not other.spaces:
        other = replace(other, chosen=simple.patterns[[best]])
    if _worth(other, comparison) - COST * wrong[best] > _worth(strict, comparison):
        return replace(other, doubted=doubted)
    return strict


def _contradictions(
    comparison: Comparison, labels: Votes
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Whether simple patterns agree with labels, (n, m); how many answers each contradicts."""
    votes = np.array([*labels.values()], np.int64)
    linked = matches(comparison.simple.patterns, comparison.levels[[*labels]])
    agrees = linked == (votes > 0)[:, None]
    return agrees, np.abs(votes) @ ~agrees


def _worth(pattern: LinkPattern, comparison: Comparison) -> float:
    """How good links are without labels, less the cost of what the pattern has to explain them."""
    score = pseudo_f(comparison.pairs[pattern.links(comparison.levels)], comparison.pairs)
    conditions = np.count_nonzero(pattern.chosen[:, :AGGREGATE])
    more = len(pattern.chosen) - 1 + len(pattern.unexplained)
    return score - COST * (conditions + more)


def _agreeing(comparison: Comparison, labels: Votes) -> LinkPattern:
    """The pattern that agrees with all labels."""
    same, different = _kinds(labels)
    spaces, hopeless = learn(comparison.levels[same], comparison.levels[different])
    chosen = [_choose(space, comparison, comparison.levels[different]) for space in spaces]
    rows = np.array(chosen, np.int8).reshape(len(chosen), len(comparison.features))
    return LinkPattern(spaces, rows, [same[i] for i in hopeless], [])


def _kinds(labels: Votes) -> tuple[list[int], list[int]]:
    """The pairs that are labelled the same, and those that are labelled different."""
    return [p for p, v in labels.items() if v > 0], [p for p, v in labels.items() if v < 0]


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
        scores.append(pseudo_f(comparison.pairs[linked], comparison.pairs))
    chosen: Levels = options[int(np.argmax(scores))]
    return chosen


def next_question(comparison: Comparison, labels: Votes) -> int | None:
    """Return the candidate pair whose label tells most; None where all are labelled.

    Undecided is a pair that some patterns of the version space link and others do not. Of those
    that are best for one of their records, it is the one in the middle between pairs labelled the
    same and pairs labelled different. Without an undecided pair, any other one.
    """
    v = comparison.likelihood
    best = np.asarray((comparison.similarities[:, -2:] >= 1).any(axis=1))
    best[list(labels)] = False
    same, different = _kinds(_trusted(comparison, labels))
    if not same:
        open_ = np.flatnonzero(best)
        return int(open_[np.argmax(v[open_])]) if len(open_) else None
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


def control_question(comparison: Comparison, labels: Votes) -> int | None:
    """Return the pair that is asked about again: the answer that is the most probably wrong.

    That is one with as many answers for as against it, else a doubted one, else the one that is the
    most like pairs of the other kind. None where each pair has two more answers for its label.
    """
    open_ = [place for place, votes in labels.items() if abs(votes) < 2]
    trusted = _trusted(comparison, labels)
    same, different = _kinds(trusted)
    v = comparison.likelihood
    low, high = min(v[same], default=1.0), max(v[different], default=0.0)

    def distance(place: int) -> tuple[bool, bool, float]:
        votes = labels[place]
        return votes != 0, place in trusted, v[place] - high if votes > 0 else low - v[place]

    return min(open_, key=distance, default=None)


def _trusted(comparison: Comparison, labels: Votes) -> Votes:
    """The labels that are not doubted."""
    _, wrong = _contradictions(comparison, labels)
    if not wrong[np.argmax(comparison.simple.scores - COST * wrong)]:
        return labels
    doubted = learn_pattern(comparison, labels).doubted
    return {place: votes for place, votes in labels.items() if place not in doubted}
