"""Which objects were detected: known ones that perhaps moved, or new ones; and what follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.belief.association import view_likelihoods
from semmap.belief.error import BeliefError
from semmap.belief.joint_posterior import joint_marginals, one_each
from semmap.belief.looks import locate, observe_point
from semmap.belief.motion import DAILY, MotionModel
from semmap.belief.places import BeliefPlace, place_around, place_at
from semmap.belief.reader import (
    read_agent_pose,
    read_columns,
    read_height,
    read_places,
    read_positions,
)
from semmap.belief.store.beliefs import Row, read_belief
from semmap.belief.within_place import position_likelihood
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
    moved since it was observed; also where it was within that place. Two detections are different
    objects: the probabilities are those of all hypotheses together. The places of the detections
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
    belief = np.array([[one.get(place, 0.0) for place in columns.places] for one in beliefs])
    boxes, age = read_positions(seen, names, at)
    places = {of[0]: read_places(seen, of[0]) for of in candidates if of}
    located = [
        locate(
            seen,
            given.type,
            places[of[0]],
            given.point,
            height=given.sides[2] if given.sides else read_height(seen, of[0]) or 0.0,
            known=boxes[[names.index(name) for name in of]],
            frame=frame,
            at=at,
        )
        for given, of in zip(detections, candidates, strict=True)
        if of
    ]
    at_place = np.array([columns.places.index(place.name) for place, _ in located])
    view = np.zeros(len(columns.places))
    view[at_place] = 1.0
    likelihood = view_likelihoods(
        belief,
        view,
        at_place,
        [[float(name in candidates[j]) for name in names] for j in rows],
        [_size(detections[j]) for j in rows],
        np.cbrt(columns.volume),
        new=np.full(len(rows), new),
    )
    known = [
        _at(boxes, places[candidates[j][0]], place)
        for j, (place, _) in zip(rows, located, strict=True)
    ]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        unmoved = np.exp(-columns.mobility * age / motion.seconds)
        stayed = np.minimum(unmoved / belief[:, at_place].T, 1.0)
    areas = [place.area for place, _ in located]
    within = position_likelihood([point for _, point in located], known, areas, stayed)
    shares = joint_marginals(likelihood.same * within, likelihood.new, likelihood.missed)
    for j, (place, _), share in zip(rows, located, shares, strict=True):
        order = np.argsort(-share[:-1], kind="stable")
        likeliest = {names[i]: float(share[i]) for i in order if share[i] > 0}
        found[j] = Identity(place.name, likeliest, float(share[-1]))
    return found


def _at(
    boxes: NDArray[np.float64], places: Sequence[BeliefPlace], place: BeliefPlace
) -> NDArray[np.float64]:
    """The boxes of `read_positions` whose foot is at a place among others; NaN for the others."""
    feet = [
        None if np.isnan(x) else place_at(places, (x, y, z)) or place_around(places, (x, y, z))
        for x, y, z, _ in boxes.tolist()
    ]
    here = np.array([foot is not None and foot.name == place.name for foot in feet])
    return np.where(here[:, None], boxes, np.nan)


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
    a sighting of a likely one, with such rates that the belief says how sure it is; the object
    stays where it is. Each row
    has `type`, `object`, `probability`, `new` and `place`. Errors as `identify`; nothing is stored.
    """
    rows: list[Row] = []
    found = identify(seen, detections, frame=frame, at=at)
    for detection, who, known in zip(detections, found, _chosen(found), strict=True):
        name = known or _free_name(seen, detection.type)
        rates: dict[str, Any] = {}
        if known is not None:
            there = sum(one.known.get(known, 0.0) for one in found if one.place == who.place)
            rates = _rates(seen, known, who.place, there) | {"surely": there >= SURE}
        else:
            point = detection.point
            if frame is not None:
                x, y, z = read_agent_pose(seen, frame, at).apply([detection.point])[0]
                point = (float(x), float(y), float(z))
            add(name, detection, point)
        hangs = known is not None
        row = observe_point(seen, name, detection.point, frame=frame, at=at, hangs=hangs, **rates)
        chance = who.new if known is None else who.known[known]
        rows.append({"type": detection.type, "object": name, "probability": chance})
        rows[-1] |= {"new": known is None, "place": row["place"]}
    return rows


def _chosen(found: Sequence[Identity]) -> list[str | None]:
    """The known object of each detection; None: a new one. No object has two detections.

    In doubt, a detection is of a known object, if one is free that is not too improbable.
    """
    names = sorted({name for one in found for name in one.known})
    share = [
        [0.0 if one.new >= SURE else one.known.get(name, 0.0) for name in names] for one in found
    ]
    if not names:
        return [None] * len(found)
    return [None if i is None else names[i] for i in one_each(share, 1 - SURE)]


def _rates(seen: Snapshot, name: str, place: str | None, there: float) -> dict[str, Any]:
    """The rates with which a doubtful detection makes the belief that an object is at a place."""
    if there >= SURE or place is None:
        return {}
    before = read_belief(seen, name).get(place, 0.0)
    odds = there / (1 - there) * (1 - before) / max(before, 1e-9)
    return {"hit": HIT, "false_alarm": min(HIT / max(odds, 1.0), HIT)}


def _free_name(seen: Snapshot, type_: str) -> str:
    """The first name of a type and a number that the map does not have."""
    word = snake_case(type_)
    rows = seen.session.execute(
        "SELECT name FROM entity WHERE map_id = current_map() AND starts_with(name, %s)", (word,)
    )
    taken = {row[0] for row in rows.fetchall()}
    return next(n for i in range(1, len(taken) + 2) if (n := f"{word}_{i}") not in taken)
