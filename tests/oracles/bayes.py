"""Beliefs by Bayes' rule, one placement of the objects after another, in plain Python."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple


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
    hides: float = 0.0,
    hidden: Sequence[float] = (),
) -> list[list[float]]:
    """P(object at place) by the sum over all joint placements.

    With volumes, an object with a larger one is behind it with probability `hides`, and then seen
    at the rate `hidden[i]` of look i.
    """
    places = range(len(prior[0]))
    found = [[0.0] * len(places) for _ in prior]
    for placement in itertools.product(places, repeat=len(prior)):
        weight = math.prod(row[p] for row, p in zip(prior, placement, strict=True))
        for o, place in enumerate(placement):
            open_view = behind = 1.0
            for i, look in enumerate(looks):
                if look.object == o:
                    at = look.place == place
                    rate = look.there if at else look.elsewhere
                    open_view *= rate if look.seen else 1 - rate
                    rate = hidden[i] if at and volume else rate
                    behind *= rate if look.seen else 1 - rate
            with_larger = volume is not None and any(
                volume[other] > volume[o] and p == place for other, p in enumerate(placement)
            )
            weight *= hides * behind + (1 - hides) * open_view if with_larger else open_view
        for o, p in enumerate(placement):
            found[o][p] += weight
    return [[w / sum(row) for w in row] for row in found]
