"""Where a thing is by what was said and seen of it: the sum over its paths, in plain Python."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

UNMOVED = 0.99
"""At most so probably, a thing that is seen has not been moved since the fact before."""


class Fact(NamedTuple):
    """One fact about some places: that the thing was put at one of them, or a look at them.

    `there` and `elsewhere` are the probabilities of what a look showed; None: it was put there.
    """

    at: float
    places: Collection[str]
    there: float | None = None
    elsewhere: float = 1.0


def where_by_paths(
    prior: Mapping[str, float], facts: Sequence[Fact], now: float, moves: float, stated: float
) -> dict[str, float]:
    """P(place) at a time, of a thing that is moved to a place of its prior every `moves` seconds.

    A path has a place before each fact, one after it, and one at the next fact. What is said is
    true with the probability `stated`; of several places it leaves the proportions.
    """
    ordered = sorted(facts, key=lambda fact: fact.at)
    nexts: list[Fact | None] = [*ordered[1:], None]
    belief = dict(prior)

    def moved(a: str, b: str, seconds: float, then: Fact | None) -> float:
        keep = math.exp(-seconds / moves)
        if then and then.there and then.there > then.elsewhere and keep < 1:  # it is seen
            keep = min(keep, UNMOVED)
        return keep * (a == b) + (1 - keep) * prior[b]

    def told(before: str, after: str, fact: Fact) -> float:
        if fact.there is not None:
            return (before == after) * (fact.there if before in fact.places else fact.elsewhere)
        total = math.fsum(belief[place] for place in fact.places)
        there = belief[after] / total if after in fact.places else 0.0
        return (1 - stated) * (before == after) + stated * there

    for fact, then in zip(ordered, nexts, strict=True):
        end = then.at if then else now
        found = dict.fromkeys(prior, 0.0)
        for before, after, later in itertools.product(prior, repeat=3):
            weight = belief[before] * told(before, after, fact)
            found[later] += weight * moved(after, later, end - fact.at, then)
        belief = found
    total = math.fsum(belief.values())
    return {place: weight / total for place, weight in belief.items()}
