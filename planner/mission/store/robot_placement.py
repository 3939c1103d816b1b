"""Where the robots of a map are: agents in places, each at a pose."""

from __future__ import annotations

from sqlalchemy import Connection, text

from planner.mission.store.mission_list import MissionError
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot


def write_robot(
    connection: Connection, name: str, place: str, pose: Pose, robot_class: str | None
) -> None:
    """Put an agent at a pose in a place; add it if the map does not have it.

    Raises MissionError: an entity of another kind has this name, or there is no such place.
    """
    kind = connection.execute(text(_KIND), {"name": name}).scalar()
    if kind not in (None, "agent"):
        raise MissionError(f"{name} is of kind {kind}, not agent; give the robot another name")
    if connection.execute(text(_KIND), {"name": place}).scalar() != "room":
        raise MissionError(f"there is no place named {place} for {name}")
    if kind is None:
        connection.execute(text(_ADD_AGENT), {"name": name})
    if robot_class is not None:
        connection.execute(text(_CLASS), {"name": name, "class": robot_class})
    connection.execute(text(_ADD_PLACEMENT), {"name": name, "place": place, "pose": pose.row})


def read_robot(seen: Snapshot, name: str) -> tuple[str, Pose] | None:
    """The place and the pose, in the map's frame, of an agent; None if there is none."""
    row = seen.connection.execute(text(_ROBOT), {"name": name}).one_or_none()
    return None if row is None else (row.place, Pose(*row.pose))


def read_home(seen: Snapshot) -> str | None:
    """The room of the first home region, by name; None without one.

    None, too, where the map has an agent: a name that it does not have may be a typing error.
    """
    found = seen.connection.execute(text(_HOME)).scalar()
    return None if found is None else str(found)


_KIND = "SELECT kind FROM entity WHERE map_id = current_map() AND name = :name"

_ADD_AGENT = "INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'agent', :name)"

_CLASS = """
UPDATE entity SET properties = properties || jsonb_build_object('robot_class', CAST(:class AS text))
WHERE id = entity_id(:name) AND properties->>'robot_class' IS DISTINCT FROM :class
"""

_ADD_PLACEMENT = """
INSERT INTO placement AS p (entity_id, holder_id, pose)
SELECT entity_id(:name), r.entity_id, pose_compose(pose_inverse(r.pose), CAST(:pose AS float8[]))
FROM world r WHERE r.entity_id = entity_id(:place)
ON CONFLICT (entity_id) DO UPDATE SET holder_id = excluded.holder_id, pose = excluded.pose
"""

_ROBOT = """
SELECT r.name AS place, w.pose
FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
     JOIN entity r ON r.id = p.holder_id AND r.kind = 'room'
WHERE e.map_id = current_map() AND e.name = :name AND e.kind = 'agent'
"""

_HOME = """
SELECT r.name FROM entity e JOIN placement p ON p.entity_id = e.id
JOIN entity r ON r.id = p.holder_id AND r.kind = 'room'
WHERE e.map_id = current_map() AND e.kind = 'region'
  AND (e.type = ANY (subtypes('home_region')) OR e.properties->>'home' = 'true')
  AND NOT EXISTS (SELECT FROM entity a WHERE a.map_id = e.map_id AND a.kind = 'agent')
ORDER BY e.name LIMIT 1
"""
