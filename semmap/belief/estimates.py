"""Beliefs of objects of the map that may hide each other."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from semmap.belief.occlusion import infer_with_occlusion
from semmap.belief.reader import read_columns, read_model
from semmap.query.snapshot import Snapshot

Belief = dict[str, dict[str, float]]
"""The probability of each place, for each object; the place `elsewhere` included."""


def belief_with_occlusion(
    seen: Snapshot, names: Sequence[str], at: datetime | None = None
) -> Belief:
    """Return where objects are, if the larger ones among them may hide the smaller ones.

    They have not moved since the first observation after the map was told where they are.
    `BeliefError` if a volume is unknown, or too many objects and places depend on each other.
    """
    columns, model = read_columns(seen, names, at), read_model(seen)
    probability = infer_with_occlusion(
        columns.prior, columns.observations, columns.mobility, columns.known_volume(), model=model
    )
    return {
        name: dict(zip(columns.places, row, strict=True))
        for name, row in zip(columns.objects, probability.tolist(), strict=True)
    }
