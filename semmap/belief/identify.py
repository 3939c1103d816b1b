"""Which objects were detected: known ones that perhaps moved, or new ones; and what follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from semmap.belief.association import moved_or_new
from semmap.belief.error import BeliefError
from semmap.belief.looks import observe_point, spot
from semmap.belief.motion import DAILY, MotionModel
from semmap.belief.reader import read_agent_pose, read_columns
from semmap.belief.store.beliefs import Row, read_belief
from semmap.finite_number import finite_numbers
from semmap.query.entity_query import find
from semmap.query.snapshot import Snapshot
from semmap.snake_case import snake_case


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
        [row["name"] for row in find(seen, type=detection.type) if row["kind"] == "object"]
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


# --- into the map

SURE = 0.9
"""A detection is of an object, or of a new one, with at least this probability; else in doubt."""

HIT = 0.9
"""P(seen | there) of a detection whose object is in doubt."""

AddObject = Callable[[str, Detection, tuple[float, float, float]], object]
"""Adds a detected object to the map, by its name and the point in the map's frame."""


def observe_detections(
    seen: Snapshot,
    detections: Sequence[Detection],
    add: AddObject,
    *,
    frame: str | None = None,
    at: datetime | None = None,
) -> list[Row]:
    """Associate the detections of one view with objects of the map, and store them.

    What is surely a known object is a sighting of it. What is surely none is added. In doubt, it is
    a sighting of the likeliest one, with such rates that the belief says how sure it is. Each row
    has `type`, `object`, `probability`, `new` and `place`. Errors as `identify`; nothing is stored.
    """
    rows: list[Row] = []
    found = identify(seen, detections, frame=frame, at=at)
    for detection, who in zip(detections, found, strict=True):
        likeliest = next(iter(who.known), None)
        new = likeliest is None or who.new >= SURE
        name = _free_name(seen, detection.type) if new else str(likeliest)
        rates = {} if new else _rates(seen, name, who)
        if new:
            point = detection.point
            if frame is not None:
                x, y, z = read_agent_pose(seen, frame, at).apply([detection.point])[0]
                point = (float(x), float(y), float(z))
            add(name, detection, point)
        row = observe_point(seen, name, detection.point, frame=frame, at=at, **rates)
        chance = who.new if new else who.known[name]
        rows.append({"type": detection.type, "object": name, "probability": chance, "new": new})
        rows[-1]["place"] = row["place"]
    return rows


def _rates(seen: Snapshot, name: str, who: Identity) -> dict[str, Any]:
    """The rates with which a doubtful detection makes the belief that of the association."""
    chance, place = who.known[name], who.place
    if chance >= SURE or place is None:
        return {}
    before = read_belief(seen, name).get(place, 0.0)
    odds = chance / (1 - chance) * (1 - before) / max(before, 1e-9)
    return {"hit": HIT, "false_alarm": min(HIT / max(odds, 1.0), HIT)}


def _free_name(seen: Snapshot, type_: str) -> str:
    """The first name of a type and a number that the map does not have."""
    word = snake_case(type_)
    rows = seen.session.execute(
        "SELECT name FROM entity WHERE map_id = current_map() AND starts_with(name, %s)", (word,)
    )
    taken = {row[0] for row in rows.fetchall()}
    return next(n for i in range(1, len(taken) + 2) if (n := f"{word}_{i}") not in taken)
