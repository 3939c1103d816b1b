"""Which objects of the map were detected: known ones that perhaps moved, or new ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from semmap.belief.association import moved_or_new
from semmap.belief.error import BeliefError
from semmap.belief.looks import spot
from semmap.belief.motion import DAILY, MotionModel
from semmap.belief.reader import read_columns
from semmap.belief.store.beliefs import read_belief
from semmap.finite_number import finite_numbers
from semmap.query.entity_query import find
from semmap.query.snapshot import Snapshot


@dataclass(frozen=True)
class Detection:
    """An object of a type that a detector found.

    `point` is (x, y, z) of its middle or foot, `sides` are (width, depth, height), metres; None if
    unknown.
    """

    type: str
    point: tuple[float, float, float]
    sides: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Identity:
    """The objects that a detection may be, each `known` one with its probability.

    The likeliest is the first. `new` is the probability of none of them; `place` is None where no
    known object of the type was found.
    """

    place: str | None
    known: dict[str, float]
    new: float


def identify(
    seen: Snapshot,
    detections: Sequence[Detection],
    *,
    frame: str | None = None,
    at: datetime | None = None,
    motion: MotionModel = DAILY,
    new: float = 0.05,
) -> list[Identity]:
    """Return for each detection of one view which objects of its type it may be.

    The likelihood has the type, the size, and where each object is believed to be, as it may have
    moved since it was observed. Two detections are different objects. The places of the detections
    count as seen in full, so that other objects that are believed there were missed. `new` is the
    expected number of objects of a type at a place that the map lacks. Points are in the `frame` of
    an agent; None: of the map. `BeliefError` if a point or size is not finite, or at no place.
    """
    candidates = [
        [row["name"] for row in find(seen.session, type=detection.type) if row["kind"] == "object"]
        for detection in detections
    ]
    names = sorted({name for of_type in candidates for name in of_type})
    rows = [j for j, of_type in enumerate(candidates) if of_type]
    found = [Identity(None, {}, 1.0) for _ in detections]
    if not rows:
        return found
    columns = read_columns(seen, names, at)
    beliefs = [read_belief(seen, name, at, motion.seconds) for name in names]
    belief = [[one.get(place, 0.0) for place in columns.places] for one in beliefs]
    place = []
    for j in rows:
        like, given = candidates[j][0], detections[j]
        found_at = spot(seen, like, given.point, frame=frame, at=at, called=given.type)
        place.append(found_at["place"])
    at_place = np.array([columns.places.index(name) for name in place])
    view = np.zeros(len(columns.places))
    view[at_place] = 1.0
    best = moved_or_new(
        belief,
        view,
        at_place,
        [[float(name in candidates[j]) for name in names] for j in rows],
        [_size(detections[j]) for j in rows],
        np.cbrt(columns.volume),
        new=np.full(len(rows), new),
        keep=100,
    )
    for j, where, share in zip(rows, place, best.marginals(len(names)), strict=True):
        order = np.argsort(-share[:-1], kind="stable")
        known = {names[i]: float(share[i]) for i in order if share[i] > 0}
        found[j] = Identity(where, known, float(share[-1]))
    return found


def _size(seen: Detection) -> float:
    """The edge of a cube of the volume of a detection, metres; NaN if unknown."""
    if seen.sides is None:
        return math.nan
    sides = finite_numbers(seen.sides, 3)
    if sides is None or min(sides) <= 0:
        raise BeliefError(f"{seen.type} has the sides {seen.sides}: give metres above 0")
    return math.prod(sides) ** (1 / 3)
