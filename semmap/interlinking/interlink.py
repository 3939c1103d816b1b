"""Algorithm 1 of Tosello et al.: links between two data sets, from labels of few pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semmap.interlinking.comparison import Comparison, compare_records
from semmap.interlinking.correspondences import Correspondence, find_correspondences
from semmap.interlinking.link_pattern import (
    LinkPattern,
    control_question,
    learn_pattern,
    next_question,
)
from semmap.interlinking.records import InterlinkingError, Records

Pair = tuple[str, str]
CONTROL = 4
"""Each question of this number is about a pair again: a person who errs is found out."""

Ask = Callable[[str, str], bool | None]
"""Answers whether a left and a right key describe the same resource; None ends the questions."""


@dataclass(frozen=True)
class PairQuestion:
    """A pair of records whose label tells much."""

    left: str
    right: str
    # of each correspondence: its name on the left, and the values of both records
    values: Sequence[tuple[str, Sequence[str], Sequence[str]]]


@dataclass(frozen=True)
class Quality:
    """How links agree with reference links; all in [0, 1]."""

    precision: float
    recall: float
    f: float


@dataclass(frozen=True)
class Interlinking:
    """The links between two data sets."""

    left: Records
    right: Records
    correspondences: Sequence[Correspondence]
    pairs: NDArray[np.int64]  # (n, 2) numbers of a left and a right record
    # (n,) in (0, 1]: the share of the patterns that link a pair; 1 if labelled the same
    confidence: NDArray[np.float64]
    pattern: str  # in words
    labels: Mapping[Pair, bool]  # those that were asked included
    unexplained: Sequence[Pair]  # labelled the same, but as similar as pairs labelled different
    doubted: Sequence[Pair]  # whose labels are probably wrong; they were left out
    candidates: int  # how many pairs were compared
    dropped: int  # how many labels were left out, for records that the data sets do not have
    link_set: int | None = None  # its number in the database, if it is stored

    def links(self) -> dict[Pair, float]:
        """Return (left key, right key) to confidence."""
        return {
            (self.left.keys[i], self.right.keys[j]): float(c)
            for (i, j), c in zip(self.pairs.tolist(), self.confidence, strict=True)
        }

    def quality(self, reference: set[Pair]) -> Quality:
        """Return precision, recall and F measure beside reference links."""
        found = self.links().keys()
        right = len(found & reference)
        return Quality(
            right / len(found) if found else 0.0,
            right / len(reference),
            2 * right / (len(found) + len(reference)),
        )


def known_pairs(pairs: Iterable[Pair], left: Records, right: Records) -> set[Pair]:
    """Return the pairs of which both data sets have the records.

    `InterlinkingError` if there are pairs, and none of them is known: the sets may be exchanged.
    """
    given = [*pairs]
    known = {(a, b) for a, b in given if a in left.number and b in right.number}
    if given and not known:
        a, b = given[0]
        missing, records = (a, left) if a not in left.number else (b, right)
        raise InterlinkingError(
            f"no pair is of records that both data sets have: {missing!r} is not a record of "
            f"{records.name}: correct the keys, or exchange the data sets"
        )
    return known


class Workbench:
    """Two data sets whose candidate pairs are compared; labels are added one by one (Algorithm 1).

    Correspondences of properties (lines 3 to 7), similarities of candidate pairs and their
    aggregate (8 to 11), a pattern with a threshold on the aggregate (12), links (13). Labels of
    records that the data sets do not have are `dropped`, which counts them. `progress`
    gets a stage, how much of it is done, and how much it has. `every_pair` compares all pairs, not
    those of blocking: for small data sets.
    """

    def __init__(
        self,
        left: Records,
        right: Records,
        labels: Mapping[Pair, bool],
        progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
        every_pair: bool = False,
    ) -> None:
        known = known_pairs(labels, left, right)
        self.dropped = len(labels) - len(known)
        labels = {pair: same for pair, same in labels.items() if pair in known}
        self.left, self.right = left, right
        self.correspondences = find_correspondences(left, right)
        pairs = [(left.number[a], right.number[b]) for a, b in labels]
        if every_pair:
            pairs = [*np.ndindex(len(left), len(right))]
        also = np.array(pairs, np.int64).reshape(-1, 2)
        self.comparison: Comparison = compare_records(
            left, right, self.correspondences, lambda i, n: progress("compare", i, n), also
        )
        self._place = (
            {
                (left.keys[i], right.keys[j]): place
                for place, (i, j) in enumerate(self.comparison.pairs.tolist())
            }
            if labels
            else {}
        )
        self._labels = {self._place[pair]: 1 if same else -1 for pair, same in labels.items()}

    @property
    def labels(self) -> dict[Pair, bool]:
        """All labels by keys: what most answers say."""
        return {self._keys(place): votes > 0 for place, votes in self._labels.items() if votes}

    def ask(self, answer: Ask, questions: int) -> int:
        """Ask at most so many questions; return how many were answered.

        Each `CONTROL`th one, and each one after a contradiction, is about a pair again.
        """
        for number in range(1, questions + 1):
            again = number % CONTROL == 0 or 0 in self._labels.values()
            next_pair = control_question if again else next_question
            place = next_pair(self.comparison, self._labels)
            if place is None and again:
                place = next_question(self.comparison, self._labels)
            same = None if place is None else answer(*self._keys(place))
            if place is None or same is None:
                return number - 1
            self._labels[place] = self._labels.get(place, 0) + (1 if same else -1)
        return questions

    def forget(self) -> None:
        """Drop all labels."""
        self._labels.clear()

    def question(self, left: str, right: str) -> PairQuestion:
        """Return the values by which a person tells whether two records are the same."""
        records = self.left, self.right
        a, b = (r.record(r.number[key]) for r, key in zip(records, (left, right), strict=True))
        values = [(c.left, a.get(c.left, ()), b.get(c.right, ())) for c in self.correspondences]
        return PairQuestion(left, right, values)

    def pattern(self) -> LinkPattern:
        """Return the pattern that agrees with the labels that are not doubted."""
        return learn_pattern(self.comparison, self._labels)

    def interlink(self) -> Interlinking:
        """Return the links that agree with the labels that are not doubted."""
        pattern = self.pattern()
        linked = pattern.links(self.comparison.levels)
        trusted = {
            place: votes > 0
            for place, votes in self._labels.items()
            if votes and place not in pattern.doubted
        }
        for place, yes in trusted.items():
            linked[place] = yes
        places = np.flatnonzero(linked)
        confidence = pattern.confidence(self.comparison.levels[places])
        confidence[[trusted.get(int(p), False) for p in places]] = 1
        return Interlinking(
            self.left,
            self.right,
            self.correspondences,
            self.comparison.pairs[places],
            np.maximum(confidence, 1e-6),
            pattern.text(self.comparison.features),
            self.labels,
            [self._keys(place) for place in pattern.unexplained],
            [self._keys(place) for place in pattern.doubted],
            len(self.comparison.pairs),
            self.dropped,
        )

    def _keys(self, place: int) -> Pair:
        i, j = self.comparison.pairs[place]
        return self.left.keys[i], self.right.keys[j]
