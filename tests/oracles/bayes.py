"""Beliefs by Bayes' rule, one placement of the objects after another, in plain Python."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["Look", "posterior"]


class Look(NamedTuple):
    """One look for an object at a place: its rates, and what came of it."""

    object: int
    place: int
    there: float
    elsewhere: float
    seen: bool


def posterior(
    prior: Sequence[Sequence[float]],
    looks: Sequence[Look],
    volume: Sequence[float] | None = None,
    hidden: Sequence[float] = (),
) -> list[list[float]]:
    """P(object at place) by the sum over all joint placements.

    With volumes, an object is seen at the rate `hidden[i]` of look i where a larger one is with it.
    """
    places = range(len(prior[0]))
    found = [[0.0] * len(places) for _ in prior]
    for placement in itertools.product(places, repeat=len(prior)):
        weight = math.prod(row[p] for row, p in zip(prior, placement, strict=True))
        for i, look in enumerate(looks):
            rate = look.elsewhere
            if placement[look.object] == look.place:
                rate = look.there
                if volume is not None and any(
                    volume[other] > volume[look.object] and place == look.place
                    for other, place in enumerate(placement)
                ):
                    rate = hidden[i]
            weight *= rate if look.seen else 1 - rate
        for o, p in enumerate(placement):
            found[o][p] += weight
    return [[w / sum(row) for w in row] for row in found]
