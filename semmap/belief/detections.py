"""Detections become sightings of known objects, or new objects of the map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any

from semmap.belief.identify import Detection, Identity, identify
from semmap.belief.looks import observe_point
from semmap.belief.reader import read_agent_pose
from semmap.belief.store.beliefs import Row, read_belief
from semmap.query.snapshot import Snapshot
from semmap.snake_case import snake_case

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
