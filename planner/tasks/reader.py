"""Reads the objects that a goal can use, and the state of the robot, from the current map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

import shapely
from sqlalchemy import text

from planner.tasks.goal import Goal
from planner.tasks.world import TaskObject, TaskState, TaskWorld
from planner.topology import Topology
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot
from semmap.query.stated_mass import stated_mass
from semmap.query.storey_reader import read_entities
from semmap.query.storey_scene import SceneEntity
from semmap.query.supertypes import read_supertypes

_UNCLASSIFIED = frozenset({"object", "entity"})
"""The supertypes of a type that the T-Box does not have."""

# By indexes alone: on (map, name), on (map, type) and on the holder. What a word means; in rooms
# that are named, what stands there; up to the room, what those stand on; and what stands on them.
_THINGS = """
WITH RECURSIVE named AS MATERIALIZED (
    SELECT id, kind FROM entity WHERE map_id = current_map() AND name = ANY (:words)
    UNION
    SELECT e.id, e.kind FROM object_type t JOIN entity e ON e.id = t.id
    WHERE t.type = ANY (:words) AND t.map_id = current_map()
    UNION
    SELECT id, kind FROM entity WHERE map_id = current_map() AND label = ANY (:words)
    UNION
    SELECT entity_id, 'object' FROM placement WHERE holder_id =
        (SELECT id FROM entity WHERE map_id = current_map() AND kind = 'agent' AND name = :robot)
), wanted AS MATERIALIZED (
    SELECT id FROM named WHERE kind = 'object'
    UNION
    SELECT p.entity_id FROM named n JOIN placement p ON p.holder_id = n.id WHERE n.kind = 'room'
), up (id) AS (
    SELECT id FROM wanted
    UNION
    SELECT p.holder_id FROM up JOIN placement p ON p.entity_id = up.id
    JOIN entity h ON h.id = p.holder_id AND h.kind = 'object'
), down (id) AS (
    SELECT id FROM up
    UNION
    SELECT p.entity_id FROM down JOIN placement p ON p.holder_id = down.id
)
SELECT e.id, e.name, e.type, e.label, e.properties, r.name AS room,
       h.name AS holder, h.id AS holder_id, h.kind AS holder_kind, w.pose,
       ST_XMin(w.box) AS x0, ST_YMin(w.box) AS y0,
       ST_ZMin(w.box) AS z0, ST_XMax(w.box) AS x1, ST_YMax(w.box) AS y1, ST_ZMax(w.box) AS z1,
       (SELECT ARRAY[ST_XMax(b) - ST_XMin(b), ST_YMax(b) - ST_YMin(b), ST_ZMax(b) - ST_ZMin(b)]
        FROM (SELECT ST_3DExtent(o.hull) FROM entity_model m JOIN model o ON o.id = m.model_id
              WHERE m.entity_id = e.id AND w.box IS NULL) hull (b)) AS lost_size,
       ST_Area(w.footprint) AS ground,
       (SELECT array_agg(ARRAY[s.height, ST_Area(s.outline), EXISTS (
            SELECT FROM support_surface o WHERE o.model_id = s.model_id AND o.height > s.height
            AND ST_Relate(o.outline, s.outline, 'T********'))::int::float8]) FROM entity_model m
        JOIN support_surface s ON s.model_id = m.model_id
        WHERE m.entity_id = e.id AND s.outline IS NOT NULL) AS levels,
       EXISTS (SELECT FROM entity_model m JOIN support_surface s ON s.model_id = m.model_id
               WHERE m.entity_id = e.id) AS looked
FROM down JOIN entity e ON e.id = down.id LEFT JOIN world w ON w.entity_id = e.id
LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id
LEFT JOIN entity r ON r.id = room_of(e.id)
WHERE e.kind = 'object' ORDER BY e.name
"""

_KNOWN = """
SELECT name FROM entity WHERE map_id = current_map() AND kind = 'object'
UNION SELECT type FROM object_type WHERE map_id = current_map()
"""

_STATE = """
SELECT e.id, e.name, w.pose, e.kind, e.type,
       (SELECT r.name FROM entity r WHERE r.id = room_of(e.id)) AS room,
       ARRAY(SELECT t.name FROM placement p JOIN entity t ON t.id = p.entity_id
             WHERE p.holder_id = e.id AND e.kind = 'agent' ORDER BY t.name) AS carrying
FROM entity e LEFT JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND (
      CAST(:name AS text) IS NOT NULL AND e.name = :name
      OR CAST(:name AS text) IS NULL AND (
         e.kind = 'agent' AND (e.type IS NULL OR e.type = ANY (subtypes('robot')))
         OR e.kind = 'region'
            AND (e.type = ANY (subtypes('home_region')) OR e.properties->>'home' = 'true')))
ORDER BY e.kind, e.name
"""


def read_world(
    seen: Snapshot,
    goal: Goal,
    topology: Topology,
    heights: tuple[float, float],
    *,
    words: Iterable[str] = (),
    robot: str | None = None,
    assume_sizes: bool = False,
) -> TaskWorld:
    """The objects that a goal can use: those that its words stand for, below and on them.

    The robot takes objects between two heights above the floor, metres. `words` are more names or
    types, which a domain file needs; the agent `robot` may carry objects.
    """
    searched = sorted({w.text for w in goal.words()} | set(words))
    searched += [
        p.name
        for p in topology.places.values()
        if p.name not in searched and ({p.type, p.label, *p.types} & set(searched))
    ]
    rows = seen.connection.execute(text(_THINGS), {"words": searched, "robot": robot}).all()
    types = read_supertypes(seen, {row.type for row in rows})
    by_id = {row.id: row for row in rows}
    assumed: dict[int, SceneEntity] = {}
    if assume_sizes:
        found_here = read_entities(seen, by_id, kinds=["object"], assume_sizes=True)
        assumed = {entity.id: entity for entity in found_here if entity.assumed}
    known: list[str] = []
    found = {row.name for row in rows} | {t for ts in types.values() for t in ts}
    found |= {row.label for row in rows} | set(topology.places)
    if any(w not in found for w in searched):
        known = [*seen.connection.execute(text(_KNOWN)).scalars()]
    on_it: dict[int, float] = {}
    for row in rows:
        if row.holder_id in by_id:
            on_it[row.holder_id] = on_it.get(row.holder_id, 0.0) + (row.ground or 0.0)
    items = [
        _task_object(row, by_id, types, topology, heights, on_it.get(row.id, 0.0), assumed)
        for row in rows
    ]
    return TaskWorld(items, known)


def _task_object(
    row: Any,
    by_id: dict[int, Any],
    types: dict[str, tuple[str, ...]],
    topology: Topology,
    heights: tuple[float, float],
    taken: float,
    assumptions: Mapping[int, SceneEntity],
) -> TaskObject:
    lowest = row
    while lowest.holder_id in by_id:
        lowest = by_id[lowest.holder_id]
    place = row.room if lowest.holder_kind != "agent" and row.room in topology.places else None
    floor = topology.places[place].floor if place is not None else 0.0
    properties = row.properties
    size, height, top = (0.0, 0.0, 0.0), 0.0, 0.0
    if row.x0 is not None:
        size = (row.x1 - row.x0, row.y1 - row.y0, row.z1 - row.z0)
        height, top = (row.z0 + row.z1) / 2 - floor, row.z1 - floor
    elif row.lost_size is not None and None not in row.lost_size:
        size = tuple(row.lost_size)
    boards = None
    surface, surface_height = float("inf") if row.ground is not None else 0.0, top
    if row.looked and row.pose is not None:
        levels = [(row.pose[2] - floor + z, area) for z, area, _ in row.levels or ()]
        below = [is_below > 0 for _, _, is_below in row.levels or ()]
        boards = tuple((z, is_below) for (z, _), is_below in zip(levels, below, strict=True))
        within = [level for level in levels if heights[0] <= level[0] <= heights[1]]
        surface = max(sum(area for _, area in within or levels) - taken, 0.0)
        if levels:
            surface_height = max(within or levels, key=lambda level: level[1])[0]
    assumed = assumptions.get(row.id)
    if assumed is not None:
        corners = assumed.triangles.reshape(-1, 3)
        low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
        height, surface_height = (low[2] + high[2]) / 2 - floor, high[2] - floor
        outline = shapely.convex_hull(shapely.multipoints(corners[:, :2]))
        surface = max(outline.area - taken, 0.0)
    weight = None
    with suppress(ValueError):  # a plan does not need it
        weight = stated_mass(properties)
    return TaskObject(
        row.name,
        types.get(row.type, ()),
        row.label,
        row.holder if row.holder_kind != "agent" else None,
        place,
        None if row.pose is None else Pose(*row.pose)._replace(z=floor + height),
        height=height,
        size=size,
        weight=weight,
        classified=not _UNCLASSIFIED.issuperset(types.get(row.type, ())[1:]),
        graspable=properties.get("graspable"),
        surface=surface,
        surface_height=surface_height,
        levels=None if assumed is not None else boards,
        properties=properties,
        assumed=assumed is not None,
    )


def read_state(seen: Snapshot, topology: Topology, start: str | None = None) -> TaskState:
    """The place and pose of the robot, and the objects that it carries.

    `start` names a room, an agent or a region; by default the robot of the map, or else its home.
    Raises UnknownPlaceError for an unknown name; LookupError if the map has no robot and no home,
    or has several.
    """
    if start is not None and start in topology.places:
        return TaskState(start)
    rows = seen.connection.execute(text(_STATE), {"name": start}).all()
    agents = [row for row in rows if row.kind == "agent"]
    rows = agents or rows
    if start is not None and not rows:
        topology.place(start)
    if not rows:
        raise LookupError("the map has no robot and no home region: give its start by start=")
    if len(rows) > 1:
        names = ", ".join(row.name for row in rows)
        raise LookupError(f"the robot may be {names}; name one by start=")
    row = rows[0]
    places = [row.room] if row.room in topology.places else []
    places += [p for r in topology.regions if r.name == row.name for p in r.places]
    if not places:
        raise LookupError(f"no room holds {row.name}; place it in one, or give a room by start=")
    pose = None
    if row.pose is not None and row.kind in ("agent", "region"):
        pose = Pose(*row.pose)
    return TaskState(places[0], pose, tuple(row.carrying))
