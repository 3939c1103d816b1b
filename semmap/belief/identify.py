"""Which objects were detected: known ones that perhaps moved, or new ones; and what follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import combinations, product
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
from semmap.belief.store.beliefs import Row, read_belief, where
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


HIT, FALSE_ALARMS, LACKING = 0.9, 0.001, 0.05
"""Of a detector: P(seen | there), and the expected number of false detections of a type at a place;
of a map: the expected number of objects of a type at a place that it lacks."""

AGAIN = 10.0
"""Seconds within which views of one observer are not independent, as in the thesis's sightings."""

WALKS = 10.0
"""Seconds after which an agent has probably left its spot in a room."""

ONE_POINT = 0.01
"""Metres within which no two objects of a type are, nor within half of their least side."""

SAME = 0.5
"""A detection may be an object under another name with which it shares this part of the space."""

NEW, FALSE_ALARM = "(new)", "(false alarm)"
NONE_KNOWN = {NEW, FALSE_ALARM}
"""What a detection may be beside a known object."""


@dataclass(frozen=True)
class Identity:
    """The objects that a detection may be, each `known` one with its probability.

    The likeliest is the first. `new` is the probability of an object that the map lacks,
    `false_alarm` that of nothing: all sum to 1. `place` is None where no known object of the type
    was found.
    """

    place: str | None
    known: dict[str, float]
    new: float
    false_alarm: float = 0.0

    @property
    def may_be(self) -> dict[str, float]:
        """All of them, the likeliest first."""
        shares = {**self.known, NEW: self.new, FALSE_ALARM: self.false_alarm}
        return dict(sorted(shares.items(), key=lambda each: -each[1]))


def identify(
    seen: Snapshot,
    detections: Sequence[Detection],
    *,
    frame: str | None = None,
    at: datetime | None = None,
    motion: MotionModel = DAILY,
    hit: float = HIT,
    false_alarm: float = FALSE_ALARMS,
    new: float = LACKING,
) -> list[Identity]:
    """Return for each detection of one view which objects it may be.

    They are those of its type, and what the map has around its point: of a supertype, or in nearly
    the same space, as two solids are not at one place.

    The likelihood has the type, the size, and where each object is believed to be, as it may have
    moved since it was observed; also where it was within that place. Two detections are different
    objects: the probabilities are those of all hypotheses together. The places of the detections
    count as seen in full, so that other objects that are believed there were missed. A detector
    finds what is there with probability `hit`; it finds `false_alarm` objects of a type at a place
    that are not there, and the map lacks `new` that are, both as expected numbers. Points are in
    the `frame` of an agent; None: of the map. `BeliefError` if a point or size is not finite, or at
    no place, the detector rather finds what is not there, or two of one type are at one point.
    """
    if not 0 < false_alarm < hit < 1:
        raise BeliefError(
            f"hit is {hit:g}, false_alarm {false_alarm:g}: give 0 < false_alarm < hit < 1"
        )
    if not (math.isfinite(new) and new > 0):
        raise BeliefError(f"new is {new}: give an expected number above 0")
    _refuse_doubles(detections)
    lacking = hit * new / (hit * new + false_alarm)  # P(new | no known one)
    of_types = [
        [
            row
            for row in [*find(seen, type=each.type), *_occupants(seen, each, frame, at)]
            if row["kind"] in ("object", "agent") and row["name"] != frame
        ]
        for each in detections
    ]
    candidates = [[*dict.fromkeys(row["name"] for row in of_type)] for of_type in of_types]
    agents = {row["name"] for of_type in of_types for row in of_type if row["kind"] == "agent"}
    names = sorted({name for of_type in candidates for name in of_type})
    rows = [j for j, of_type in enumerate(candidates) if of_type]
    found = [Identity(None, {}, lacking, 1 - lacking) for _ in detections]
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
        hit,
        np.full(len(rows), new + false_alarm / hit),
    )
    known = [
        _at(boxes, places[candidates[j][0]], place)
        for j, (place, _) in zip(rows, located, strict=True)
    ]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        stay = np.where(
            [name in agents for name in names], WALKS, motion.seconds / columns.mobility
        )
        unmoved = np.exp(-age / stay)
        stayed = np.minimum(unmoved / belief[:, at_place].T, 1.0)
    areas = [place.area for place, _ in located]
    within = position_likelihood([point for _, point in located], known, areas, stayed)
    shares = joint_marginals(likelihood.same * within, likelihood.new, likelihood.missed)
    for j, (place, _), share in zip(rows, located, shares, strict=True):
        order = np.argsort(-share[:-1], kind="stable")
        likeliest = {names[i]: float(share[i]) for i in order if share[i] > 0}
        none = float(share[-1])
        found[j] = Identity(place.name, likeliest, none * lacking, none * (1 - lacking))
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


def _refuse_doubles(detections: Sequence[Detection]) -> None:
    given = [(seen.type, finite_numbers(seen.point, 3), seen.sides) for seen in detections]
    for (i, (type_, one, sides)), (j, (other, two, others)) in combinations(enumerate(given), 2):
        if type_ != other or one is None or two is None:
            continue
        known = [numbers for each in (sides, others) if (numbers := finite_numbers(each or (), 3))]
        apart = max([ONE_POINT, *(min(numbers) / 2 for numbers in known)])
        if math.dist(one, two) < apart:
            raise BeliefError(
                f"the detections {i} and {j} of one view are both of a {type_} at {tuple(one)}: "
                "send each object once"
            )


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

LEAST = 0.01
"""A known object that a detection is with less is not believed to be there for it."""

UNMOVED = 0.99
"""Before a sighting, the belief has at most this share of what it was (`belief_given` in SQL)."""

AddObject = Callable[[str, Detection, tuple[float, float, float]], object]
"""Adds a detected object to the map, by its name and the point in the map's frame."""


def observe_detections(
    seen: Snapshot,
    detections: Sequence[Detection],
    add: AddObject,
    *,
    frame: str | None = None,
    at: datetime | None = None,
    **rates: Any,
) -> list[Row]:
    """Associate the detections of one view with objects of the map, and store them.

    What is surely a known object is a sighting of it. What is surely new is added. In doubt,
    nothing moves and nothing is added: it is a sighting of each known object that it rather is than
    a new one, with such rates that the belief says how probable that is. Each row has `type`,
    `object` (the most probable one, None for none), its `probability`, whether it was added as
    `new`, the `place`, and all that it `may_be`. `rates` and errors are those of `identify`;
    nothing is stored then. A doubtful view repeated within `AGAIN` seconds says nothing new: it
    stays in doubt, and is not stored again.
    """
    found = identify(seen, detections, frame=frame, at=at, **rates)
    whole = _by_place(found)
    doubted = _doubted(seen, frame, at)
    chosen = [
        None if (name, who.place) in doubted else name
        for name, who in zip(_chosen(found, whole), found, strict=True)
    ]
    sighted = {name for name in chosen if name is not None}
    rows: list[Row] = []
    for detection, who, known in zip(detections, found, chosen, strict=True):
        may_be, place, is_new = who.may_be, who.place, who.new >= SURE
        name = known or next(iter(may_be))
        probability = may_be[name]
        if is_new:
            name = _free_name(seen, detection.type)
            add(name, detection, _in_map(seen, detection, frame, at))
        if is_new or known is not None:
            hangs = known is not None
            told = observe_point(seen, name, detection.point, frame=frame, at=at, hangs=hangs)
            place = told["place"]
        else:
            least = max(LEAST, who.new)  # else many views of a new object make it a known one
            likely = {name for name, share in who.known.items() if share >= least} - sighted
            here = {each for each in likely if _likeliest(whole[each]) == place}
            for each in sorted(name for name in here if (name, place) not in doubted):
                odds = _rates(seen, each, str(place), whole[each][str(place)], at)
                if odds["false_alarm"] < odds["hit"]:  # else it says nothing new
                    odds |= {"frame": frame, "at": at, "surely": False}
                    observe_point(seen, each, detection.point, **odds)
            sighted |= here
        row: Row = {"type": detection.type, "object": None if name in NONE_KNOWN else name}
        row |= {"probability": probability, "new": is_new, "place": place, "may_be": may_be}
        rows.append(row)
    return rows


def _doubted(seen: Snapshot, observer: str | None, at: datetime | None) -> set[tuple[str, str]]:
    """The objects and places that this observer has seen in doubt just before a moment."""
    rows = seen.session.execute(_DOUBTED, {"observer": observer, "at": at, "again": AGAIN})
    return {(name, place) for name, place in rows.fetchall()}


_DOUBTED = """
SELECT e.name, p.name FROM observation o JOIN entity e ON e.id = o.entity_id
JOIN entity p ON p.id = o.place_id LEFT JOIN entity r ON r.id = o.observer_id,
     (SELECT coalesce(%(at)s::timestamptz, clock_timestamp())) now (at)
WHERE e.map_id = current_map() AND o.seen AND o.position IS NULL AND o.hit IS NOT NULL
  AND r.name IS NOT DISTINCT FROM %(observer)s::text
  AND o.at > now.at - make_interval(secs => %(again)s) AND o.at <= now.at
"""


def _by_place(found: Sequence[Identity]) -> dict[str, dict[str, float]]:
    """P(a known object has a detection at a place), by object and place."""
    whole: dict[str, dict[str, float]] = {}
    for one in found:
        for name, share in one.known.items():
            at_place = whole.setdefault(name, {})
            assert one.place is not None
            at_place[one.place] = at_place.get(one.place, 0.0) + share
    return whole


def _likeliest(shares: dict[str, float]) -> str:
    """The name with the largest share."""
    return max(shares, key=lambda name: shares[name])


def _chosen(found: Sequence[Identity], whole: dict[str, dict[str, float]]) -> list[str | None]:
    """The known object that each detection surely is; None: a new one, or in doubt.

    Which of several alike ones at a place it is may be open; no object has two detections.
    """
    names = sorted(whole)
    if not names:
        return [None] * len(found)
    share = [
        [
            one.known.get(name, 0.0)
            if sum(one.known.values()) >= SURE and whole[name].get(str(one.place), 0.0) >= SURE
            else 0.0
            for name in names
        ]
        for one in found
    ]
    return [None if i is None else names[i] for i in one_each(share, LEAST)]


def _occupants(
    seen: Snapshot, detection: Detection, frame: str | None, at: datetime | None
) -> list[Row]:
    """The objects and agents around a detection that it is under another name."""
    if finite_numbers(detection.point, 3) is None:
        return []  # refused later
    _size(detection)  # refuses sides that are none
    point = np.array(_in_map(seen, detection, frame, at))
    values = dict(zip("xyz", point.tolist(), strict=True)) | {"type": detection.type}
    rows = seen.session.execute(_OCCUPANTS, values | {"near": ONE_POINT}).fetchall()
    return [
        {"name": name, "kind": kind}
        for name, kind, is_super, box in rows
        if is_super or _share(detection, point, np.array(box).reshape(2, 3)) >= SAME
    ]


def _share(detection: Detection, point: NDArray[np.float64], box: NDArray[np.float64]) -> float:
    """The common part of a detection and a box (2, 3), over both; 0 without sides.

    The point of the detection is its middle or its foot, and its sides are along x and y, or y and
    x.
    """
    if detection.sides is None:
        return 0.0
    (a, b, c), shares = detection.sides, []
    for sides, foot in product(((a, b, c), (b, a, c)), (0.0, c / 2)):
        middle = point + np.array((0, 0, foot))
        ends = np.array([middle - np.array(sides) / 2, middle + np.array(sides) / 2])
        common = np.minimum(ends[1], box[1]) - np.maximum(ends[0], box[0])
        both = float(np.prod(np.maximum(common, 0)))
        shares.append(both / (a * b * c + float(np.prod(box[1] - box[0])) - both))
    return max(shares)


_OCCUPANTS = """
SELECT e.name, e.kind, e.type IN (SELECT c.super FROM type_closure c WHERE c.sub = %(type)s),
       ARRAY[ST_XMin(w.box), ST_YMin(w.box), ST_ZMin(w.box),
             ST_XMax(w.box), ST_YMax(w.box), ST_ZMax(w.box)]
FROM world w JOIN entity e ON e.id = w.entity_id
WHERE w.map_id = current_map() AND e.kind IN ('object', 'agent') AND NOT is_building_part(e.type)
  AND w.box &&& grown(ST_MakePoint(%(x)s, %(y)s, %(z)s), %(near)s)
"""


def _in_map(
    seen: Snapshot, detection: Detection, frame: str | None, at: datetime | None
) -> tuple[float, float, float]:
    """The point of a detection in the map's frame."""
    if frame is None:
        return detection.point
    x, y, z = read_agent_pose(seen, frame, at).apply([detection.point])[0]
    return float(x), float(y), float(z)


def _rates(
    seen: Snapshot, name: str, place: str, there: float, at: datetime | None
) -> dict[str, Any]:
    """The rates with which a doubtful detection makes the belief that an object is at a place."""
    row = next((row for row in where(seen, name, at) if row["place"] == place), None)
    before = 0.0 if row is None else UNMOVED * row["probability"] + (1 - UNMOVED) * row["prior"]
    odds = there / max(1 - there, 1e-9) * (1 - before) / max(before, 1e-9)
    return {"hit": HIT, "false_alarm": min(HIT / max(odds, 1.0), HIT)}


def _free_name(seen: Snapshot, type_: str) -> str:
    """The first name of a type and a number that the map does not have."""
    word = snake_case(type_)
    rows = seen.session.execute(
        "SELECT name FROM entity WHERE map_id = current_map() AND starts_with(name, %s)", (word,)
    )
    taken = {row[0] for row in rows.fetchall()}
    return next(n for i in range(1, len(taken) + 2) if (n := f"{word}_{i}") not in taken)
