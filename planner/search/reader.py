"""Reads what a search needs from the map: beliefs, places, what hides them, and past looks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import text

from planner.readers.robot_class import read_robot_urdf
from planner.search.viewpoints import Sight
from semmap.belief.places import BeliefPlace
from semmap.belief.reader import read_height, read_occluders, read_places
from semmap.belief.store.beliefs import where
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities
from semmap.query.storey_scene import SceneEntity
from semmap.robot.camera_reach import camera_reach
from semmap.robot.error import RobotError
from semmap.robot.urdf import load_robot

HEIGHT = 0.1  # metres, of an object whose size is unknown

DOUBT = 0.5
"""How often a thing that is searched for is not where it was believed: who is sure, fetches it."""

DOUBTED = f". Who searches doubts: {DOUBT:.0%} of each chance is the prior, the rest the belief"

LARGE = 0.5  # metres of the box of a thing, corner to corner, that may hide a place from a look
MOVED = 0.1  # metres by which such a thing moves until a search is planned again

SURE = 0.9
"""With this belief in the place of an object in the map, it is fetched there without a search."""


@dataclass(frozen=True, eq=False)
class BelievedObject:
    """An object and where it may be; its belief is P(place) of one who doubts what was believed."""

    name: str
    belief: dict[str, float]
    places: Sequence[BeliefPlace]
    occluders: NDArray[np.float64]  # (F, 3, 3) triangles that hide it, metres in the map's frame
    height: float  # metres
    shut: frozenset[str]  # must be opened before one sees into them

    @property
    def all_shut(self) -> frozenset[str]:
        """The places into which one sees only when they are open, with those without a surface."""
        closed = (p.name for p in self.places if p.kind != "room" and not p.surfaces)
        return self.shut.union(closed)


def read_believed_object(seen: Snapshot, name: str) -> BelievedObject:
    """An object or agent of the current map, with the places at which it has room.

    Raises LookupError if the map has no entity of this name.
    """
    rows = where(seen, name)
    belief = {row["place"]: (1 - DOUBT) * row["probability"] + DOUBT * row["prior"] for row in rows}
    shut = frozenset(seen.connection.execute(text(_SHUT)).scalars())
    places = read_places(seen, name)  # what is shut has an inside
    return BelievedObject(
        name,
        belief,
        [replace(place, stores=place.stores or place.name in shut) for place in places],
        read_occluders(seen, [name]),
        read_height(seen, name) or HEIGHT,
        shut,
    )


def read_sight(seen: Snapshot, robot: str | None) -> tuple[Sight, str | None]:
    """How a stored class of robots can hold its camera, by its URDF; and what is assumed, if so."""
    default = Sight()
    why = "as that of the robot is not known"
    if robot is not None:
        try:
            reach = camera_reach(load_robot(read_robot_urdf(seen, robot)))
            if reach is not None:
                return Sight(reach.heights, reach.pitches, reach.pan), None
            why = f"as the URDF of {robot} has no link with the name of a camera on its head"
        except LookupError:
            pass
        except RobotError as error:
            why = f"as the URDF of {robot} cannot be read: {error}"
    tilts = " and ".join(f"{math.degrees(pitch):.0f}" for pitch in default.pitches)
    return default, (
        f"assumed: a camera {default.heights[0]:g} m above the floor that looks {tilts} degrees "
        f"down, {why}"
    )


def read_entity_shapes(seen: Snapshot) -> dict[str, SceneEntity]:
    """The rooms, objects and shut doors of the current map with their triangles, by name."""
    entities = read_entities(seen, kinds=("room", "object", "connector"))
    return {e.name: e for e in entities if e.state != "open"}


def read_doubtful(seen: Snapshot, names: Sequence[str]) -> dict[str, float]:
    """The objects without a place, or of which looks have shown that they may be at another one.

    With the probability of the likeliest place of each.
    """
    rows = seen.connection.execute(text(_UNSURE), {"names": [*names]}).all()
    doubtful = {}
    for name, placed in rows:
        best = where(seen, name)[0]
        sure = placed and best["probability"] >= SURE
        if not sure or not _scalar(seen, _IS_AT, name=name, place=best["place"]):
            doubtful[name] = float(best["probability"])
    return doubtful


def read_looks(seen: Snapshot, name: str, robot: str, after: int) -> tuple[Sequence[Any], int]:
    """What a robot has observed of an object since an observation, and the newest one of all.

    Each look has a place, and whether the object was seen there.
    """
    values = {"name": name, "robot": robot, "after": after}
    looks = seen.connection.execute(text(_LOOKS), values).all()
    return looks, int(_scalar(seen, "SELECT coalesce(max(id), 0) FROM observation"))


@dataclass(frozen=True, eq=False)
class Circumstances:
    """What others know of an object, and where the large things are that may hide it."""

    sighting: int  # the newest one of the object by another than the robot
    holder: str | None  # what holds the object in the map
    things: NDArray[np.int64]  # (n,) their ids
    boxes: NDArray[np.float64]  # (n, 6) lowest and highest corners, metres in the map's frame

    def differ(self, other: Circumstances, *, own_sighting: bool) -> bool:
        """Whether a search must be planned again; its `own_sighting` moves the object in the map.

        Things count that moved by more than `MOVED`.
        """
        if self.sighting != other.sighting or (self.holder != other.holder and not own_sighting):
            return True
        same = np.array_equal(self.things, other.things)
        return not same or bool((abs(self.boxes - other.boxes) > MOVED).any())


def read_circumstances(seen: Snapshot, name: str, robot: str) -> Circumstances:
    """Who else has seen an object, where the map has it, and where large things are."""
    values = {"name": name, "robot": robot, "large": LARGE}
    large = np.array(seen.connection.execute(text(_LARGE), values).all(), float).reshape(-1, 7)
    return Circumstances(
        int(_scalar(seen, _SIGHTING, name=name, robot=robot)),
        read_holder(seen, name),
        large[:, 0].astype(np.int64),
        large[:, 1:],
    )


def read_opened(seen: Snapshot, robot: str) -> frozenset[str]:
    """The containers that a robot has opened in the mission that it runs."""
    return frozenset(seen.connection.execute(text(_OPENED), {"robot": robot}).scalars())


def read_seen_by(seen: Snapshot, name: str, robot: str) -> bool:
    """Whether a robot has seen an object in the mission that it runs."""
    return bool(_scalar(seen, _SEEN, name=name, robot=robot))


def read_holder(seen: Snapshot, name: str) -> str | None:
    """The name of what an entity is on or in; None if nothing holds it."""
    return _word(seen, _HOLDER, name=name)


def read_kind(seen: Snapshot, name: str) -> str | None:
    """The kind of an entity of the current map; None if there is none of this name."""
    return _word(seen, _KIND, name=name)


def read_room(seen: Snapshot, name: str) -> str | None:
    """The room in or on whose contents an entity is, or the room itself; None if there is none."""
    return _word(seen, _ROOM, name=name)


def read_middle(seen: Snapshot, name: str) -> tuple[float, float, float] | None:
    """The middle of the box of an entity, metres in the map's frame; None without geometry."""
    row = seen.connection.execute(text(_MIDDLE), {"name": name}).one_or_none()
    return None if row is None else (row.x, row.y, row.z)


def _word(seen: Snapshot, statement: str, **values: object) -> str | None:
    found = _scalar(seen, statement, **values)
    return None if found is None else str(found)


def _scalar(seen: Snapshot, statement: str, **values: object) -> Any:
    return seen.connection.execute(text(statement), values).scalar()


_KIND = "SELECT kind FROM entity WHERE map_id = current_map() AND name = :name"

_ROOM = """
SELECT name FROM entity WHERE id = room_of(
    (SELECT id FROM entity WHERE map_id = current_map() AND name = :name))
"""

_MIDDLE = """
SELECT (ST_XMin(box) + ST_XMax(box)) / 2 AS x, (ST_YMin(box) + ST_YMax(box)) / 2 AS y,
       (ST_ZMin(box) + ST_ZMax(box)) / 2 AS z
FROM world WHERE entity_id = entity_id(:name) AND box IS NOT NULL
"""

_SHUT = """
SELECT name FROM entity
WHERE map_id = current_map() AND kind = 'object' AND properties->'shut' = 'true'
"""

_UNSURE = """
SELECT e.name, p.holder_id IS NOT NULL AS placed
FROM entity e LEFT JOIN placement p ON p.entity_id = e.id
WHERE e.map_id = current_map() AND e.name = ANY (:names)
  AND (p.holder_id IS NULL OR EXISTS (SELECT FROM observation o WHERE o.entity_id = e.id))
ORDER BY e.name
"""

_IS_AT = """
SELECT EXISTS (SELECT FROM entity e WHERE e.map_id = current_map() AND e.name = :place
               AND is_held_by(entity_id(:name), e.id))
"""

_LOOKS = """
SELECT p.name AS place, o.seen FROM observation o JOIN entity p ON p.id = o.place_id
WHERE o.entity_id = entity_id(:name) AND o.observer_id = entity_id(:robot) AND o.id > :after
ORDER BY o.id
"""

_SIGHTING = """
SELECT coalesce(max(id), 0) FROM observation
WHERE entity_id = entity_id(:name) AND seen AND observer_id IS DISTINCT FROM entity_id(:robot)
"""

_LARGE = """
SELECT w.entity_id, ST_XMin(w.box), ST_YMin(w.box), ST_ZMin(w.box), ST_XMax(w.box), ST_YMax(w.box),
       ST_ZMax(w.box)
FROM world w JOIN entity e ON e.id = w.entity_id
LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id
WHERE e.map_id = current_map() AND e.kind = 'object' AND e.name <> :name
  AND h.kind IS DISTINCT FROM 'agent' AND ST_3DLength(w.box) >= :large
ORDER BY w.entity_id
"""

_OPENED = """
SELECT s.arguments[1] FROM mission_step s JOIN mission m ON m.id = s.mission_id
WHERE m.robot_id = entity_id(:robot) AND m.state = 'running' AND s.action = 'open_container'
  AND s.state = 'done'
"""

_SEEN = """
SELECT EXISTS (
    SELECT FROM observation o JOIN mission m ON m.robot_id = o.observer_id
    JOIN mission_step s ON s.mission_id = m.id AND s.action = 'look' AND s.state = 'done'
     AND o.at BETWEEN s.started_at AND s.ended_at
    WHERE o.entity_id = entity_id(:name) AND o.observer_id = entity_id(:robot)
      AND m.state = 'running' AND o.seen)
"""

_HOLDER = """
SELECT h.name FROM placement p JOIN entity h ON h.id = p.holder_id
WHERE p.entity_id = entity_id(:name)
"""
