"""Writes what a robot observed into the map, not what was expected."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import NamedTuple

import shapely
from sqlalchemy import Connection, text

from planner.mission.behaviours import Outcome, RobotObservation, Sighting
from planner.mission.command import Command
from planner.mission.placement_search import find_free_spot
from semmap.belief.store.beliefs import add_observations
from semmap.database.maps import driver_of
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import ANY_LEVEL, RIM, Levels
from semmap.query.snapshot import Snapshot

PASSAGE = 0.6  # metres around the passage of a connector that stay free of objects on the floor
AHEAD = 0.5  # metres before the robot's origin at which it puts objects on the floor


class ObjectRow(NamedTuple):
    """An object that holds no other, with its place and pose."""

    name: str
    place: str
    seen: Sighting


def write_observation(connection: Connection, robot: int, seen: RobotObservation) -> None:
    """Write the pose of a robot, what it holds, sees or no longer holds, and what looks showed."""
    connection.execute(
        text(_PLACE_ROBOT), {"robot": robot, "place": seen.place, "pose": seen.pose.row}
    )
    for name, grip in seen.holds.items():
        connection.execute(text(_HOLD), {"item": name, "robot": robot, "pose": grip.row})
    if seen.seen:
        objects = [
            {"item": n, "holder": s.holder, "relation": s.relation, "pose": s.pose.row}
            for n, s in seen.seen.items()
        ]
        connection.execute(text(_APPEAR), {"seen": json.dumps(objects)})
        connection.execute(text(_PUT), {"seen": json.dumps(objects)})
    held = connection.execute(text(_HELD), {"robot": robot}).scalars()
    for name in [n for n in held if n not in seen.holds]:
        # not held any more and not in view: somewhere in this place
        connection.execute(text(_LOSE), {"item": name, "place": seen.place})
    for name, state in seen.doors.items():
        if state in ("open", "closed", "locked"):
            write_door(connection, name, state)
    there = {name for look in seen.looks for name in (look.object, look.place)}
    there.difference_update(read_missing(connection, there))
    looks = [look for look in seen.looks if look.object in there and look.place in there]
    if looks:
        observer = connection.execute(text(_NAME), {"id": robot}).scalar_one()
        session = driver_of(connection)
        add_observations(session, [asdict(look) | {"observer": observer} for look in looks])


def write_door(connection: Connection, name: str, state: str) -> None:
    """Write the observed state of a connector, and the present time."""
    connection.execute(text(_DOOR), {"name": name, "state": state})


def write_execution(connection: Connection, robot: int, command: Command, outcome: Outcome) -> None:
    """Write the duration of a passage, a call or a ride, from which planners compute means."""
    if command.step is None or command.subject is None or outcome.seconds <= 0:
        return
    height = command.step.approach.z - command.step.leave.z if command.step.approach else 0.0
    connection.execute(
        text(_EXECUTED),
        {
            "behaviour": command.behaviour,
            "subject": command.subject,
            "seconds": outcome.seconds,
            "height": abs(height),
            "succeeded": outcome.succeeded,
            "robot": robot,
        },
    )


def find_placement(
    seen: Snapshot,
    item: str,
    target: str,
    towards: Pose,
    levels: Levels = ANY_LEVEL,
) -> Pose | None:
    """The free pose on a target that is nearest to another pose; None if there is none.

    The pose is on the largest of the `levels` of the target that is under no other one, or else on
    the top of its box, clear of the objects on it; in a room, it is on the floor before the robot,
    apart from its connectors and the objects there.
    """
    low, high = levels.heights
    which = {"name": target, "low": low, "high": high, "rim": RIM if levels.inside else -math.inf}
    row = seen.connection.execute(text(_TARGET), which).one_or_none()
    size = seen.connection.execute(text(_SIZE), {"name": item}).one_or_none()
    if row is None or size is None or row.footprint is None:
        return None
    is_room = row.kind == "room"
    if not is_room and not (low <= row.top <= high and (row.is_level or not levels.inside)):
        return None
    where = {"target": row.id, "item": item}
    rows = seen.connection.execute(text(_ON_FLOOR if is_room else _ON_TARGET), where).scalars()
    occupied = [shapely.from_wkb(bytes(k)) for k in rows]
    if is_room:
        ways = seen.connection.execute(text(_PASSAGES), where).all()
        occupied += [shapely.LineString([w.a[:2], w.b[:2]]).buffer(PASSAGE) for w in ways]
        towards @= Pose(AHEAD, 0.0, 0.0)
    found = find_free_spot(
        shapely.from_wkb(bytes(row.footprint)),
        occupied,
        max(size.radius, 0.01),
        (towards.x, towards.y),
    )
    if found is None:
        return None
    yaw = math.remainder(Pose(*size.pose).yaw, math.tau)
    return Pose.planar(found[0], found[1], yaw, (row.floor if is_room else row.top) + size.above)


def read_robot(seen: Snapshot, name: str) -> tuple[str, Pose] | None:
    """The place and the pose, in the map's frame, of an agent; None if there is none."""
    row = seen.connection.execute(text(_ROBOT), {"name": name}).one_or_none()
    return None if row is None else (row.place, Pose(*row.pose))


def read_missing(connection: Connection, names: Iterable[str]) -> list[str]:
    """Those of some names that the map does not have, or has no more, in order."""
    return list(connection.execute(text(_MISSING), {"names": [*names]}).scalars())


def read_objects(seen: Snapshot) -> list[ObjectRow]:
    """The objects of the current map that lie in or on something."""
    rows = seen.connection.execute(text(_THINGS)).all()
    return [ObjectRow(r.name, r.place, Sighting(r.holder, r.relation, Pose(*r.pose))) for r in rows]


_PLACE_ROBOT = """
UPDATE placement p SET holder_id = w.entity_id, relation = 'in', confidence = NULL, pose = there
FROM world w, LATERAL pose_compose(pose_inverse(w.pose), CAST(:pose AS float8[])) there
WHERE p.entity_id = :robot
  AND w.entity_id = (SELECT id FROM entity WHERE map_id = current_map() AND name = :place)
  AND (p.holder_id, p.pose) IS DISTINCT FROM (w.entity_id, there)
"""

_HOLD = """
UPDATE placement p SET holder_id = :robot, relation = 'in', confidence = NULL, pose = :pose
FROM entity e WHERE e.map_id = current_map() AND e.name = :item AND p.entity_id = e.id
  AND (holder_id, pose) IS DISTINCT FROM (CAST(:robot AS bigint), CAST(:pose AS float8[]))
"""

# What had no place any more and is seen again.
_APPEAR = """
INSERT INTO placement (entity_id, holder_id, relation, pose)
SELECT e.id, h.entity_id, s.relation, pose_compose(pose_inverse(h.pose), s.pose)
FROM jsonb_to_recordset(CAST(:seen AS jsonb))
         AS s (item text, holder text, relation text, pose float8[]),
     entity e, entity k, world h
WHERE e.map_id = current_map() AND e.name = s.item AND e.kind = 'object'
  AND k.map_id = current_map() AND k.name = s.holder AND h.entity_id = k.id
  AND NOT EXISTS (SELECT FROM placement p WHERE p.entity_id = e.id)
"""

# An object within a centimetre of its place in the map has not moved.
_PUT = """
UPDATE placement p
SET holder_id = h.entity_id, relation = s.relation, confidence = NULL,
    pose = pose_compose(pose_inverse(h.pose), s.pose)
FROM jsonb_to_recordset(CAST(:seen AS jsonb))
         AS s (item text, holder text, relation text, pose float8[]),
     entity e, world w, entity k, world h
WHERE e.map_id = current_map() AND e.name = s.item AND e.kind = 'object'
  AND p.entity_id = e.id AND w.entity_id = e.id
  AND k.map_id = current_map() AND k.name = s.holder AND h.entity_id = k.id
  AND (p.holder_id IS DISTINCT FROM h.entity_id OR p.relation <> s.relation
       OR abs(w.pose[1] - s.pose[1]) > 0.01 OR abs(w.pose[2] - s.pose[2]) > 0.01
       OR abs(w.pose[3] - s.pose[3]) > 0.01)
"""

_ROBOT = """
SELECT r.name AS place, w.pose
FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
     JOIN entity r ON r.id = p.holder_id AND r.kind = 'room'
WHERE e.map_id = current_map() AND e.name = :name AND e.kind = 'agent'
"""

_MISSING = """
SELECT n FROM unnest(CAST(:names AS text[])) WITH ORDINALITY o (n, i)
WHERE NOT EXISTS (SELECT FROM entity e WHERE e.map_id = current_map() AND e.name = n) ORDER BY i
"""

_NAME = "SELECT name FROM entity WHERE id = :id"

_HELD = """
SELECT e.name FROM placement p JOIN entity e ON e.id = p.entity_id
WHERE p.holder_id = :robot AND e.kind = 'object'
"""

_LOSE = """
SELECT put(entity_id(:item), id, 'in', 0) FROM entity
WHERE map_id = current_map() AND name = :place
"""

_DOOR = """
UPDATE connector c SET state = :state, seen_at = clock_timestamp()
FROM entity e WHERE e.map_id = current_map() AND e.name = :name AND c.entity_id = e.id
AND (state <> :state OR :state = 'locked')
"""

_EXECUTED = """
INSERT INTO execution (robot_class_id, behaviour, entity_id, seconds, height, succeeded)
SELECT (SELECT c.id FROM robot_class c JOIN entity r ON r.id = :robot
        WHERE c.name = r.properties->>'robot_class'),
       :behaviour, id, :seconds, :height, :succeeded
FROM entity WHERE map_id = current_map() AND name = :subject
"""

_TARGET = """
SELECT e.id, e.kind, coalesce(w.pose[3] + s.height, ST_ZMax(w.box)) AS top,
       s.height IS NOT NULL AS is_level,
       ST_AsBinary(coalesce(ST_Translate(ST_Rotate(s.outline, pose_yaw(w.pose), 0, 0),
                                         w.pose[1], w.pose[2]), w.footprint)) AS footprint,
       w.pose[3] + coalesce(r.floor, 0) AS floor
FROM entity e JOIN world w ON w.entity_id = e.id LEFT JOIN room r ON r.entity_id = e.id
LEFT JOIN LATERAL (
    SELECT k.height, k.outline FROM entity_model m JOIN support_surface k ON k.model_id = m.model_id
    WHERE m.entity_id = e.id AND e.kind = 'object' AND k.outline IS NOT NULL
      AND abs(w.pose[4]) < 1e-3 AND abs(w.pose[5]) < 1e-3
      AND w.pose[3] + k.height BETWEEN :low AND :high
      AND w.pose[3] + k.height < ST_ZMax(w.box) - CAST(:rim AS float8)
      AND NOT EXISTS (SELECT FROM support_surface o WHERE o.model_id = k.model_id
                      AND o.height > k.height AND ST_Relate(o.outline, k.outline, 'T********'))
    ORDER BY ST_Area(k.outline) DESC LIMIT 1) s ON true
WHERE e.map_id = current_map() AND e.name = :name
"""

_SIZE = """
SELECT w.pose, w.pose[3] - ST_ZMin(w.box) AS above,
       sqrt((ST_XMax(w.box) - ST_XMin(w.box)) ^ 2 + (ST_YMax(w.box) - ST_YMin(w.box)) ^ 2) / 2
       AS radius
FROM entity e JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND e.name = :name
"""

_ON_TARGET = """
SELECT ST_AsBinary(w.footprint) FROM placement p JOIN world w ON w.entity_id = p.entity_id
WHERE p.holder_id = :target AND w.footprint IS NOT NULL AND p.entity_id <> entity_id(:item)
"""

# What stands on the floor, or less than a metre above it: leaves of doors too, but not carpets and
# other parts of the building.
_ON_FLOOR = """
SELECT ST_AsBinary(w.footprint) FROM room r
     JOIN world h ON h.entity_id = r.entity_id
     JOIN world w ON w.map_id = h.map_id AND w.box && h.box AND w.footprint IS NOT NULL
     JOIN entity e ON e.id = w.entity_id AND e.kind = 'object'
          AND (NOT is_building_part(e.type) OR e.type = ANY (subtypes('door_leaf')))
WHERE r.entity_id = :target AND e.name <> :item
  AND ST_ZMin(w.box) < h.pose[3] + r.floor + 1.0 AND ST_ZMax(w.box) > h.pose[3] + r.floor + 0.03
"""

_PASSAGES = """
SELECT pose_compose(w.pose, c.pose_a) AS a, pose_compose(w.pose, c.pose_b) AS b
FROM connector c JOIN world w ON w.entity_id = c.entity_id WHERE :target IN (c.place_a, c.place_b)
"""

_THINGS = """
SELECT e.name, r.name AS place, h.name AS holder, p.relation, w.pose
FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
     JOIN entity h ON h.id = p.holder_id
     JOIN entity r ON r.id = room_of(e.id)
WHERE e.map_id = current_map() AND e.kind = 'object' AND h.kind IN ('object', 'room')
  AND NOT EXISTS (SELECT FROM placement c WHERE c.holder_id = e.id)
"""
