"""Reads the topology of the current map: its rooms, their connectors, and regions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from datetime import datetime
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from psycopg.rows import namedtuple_row
from sqlalchemy import text

from planner.readers.rows import fetch_rows
from planner.topology import OUTSIDE, Narrowing, Place, PlaceConnector, PlaceRegion, Topology
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot
from semmap.query.supertypes import read_supertypes

_PLACES = """
SELECT e.name, e.type, e.label, s.name, l.name, NULLIF(e.properties, '{}'),
       coalesce(w.pose[3] + r.floor, 0), e.id
FROM room r JOIN entity e ON e.id = r.entity_id LEFT JOIN world w ON w.entity_id = e.id
LEFT JOIN entity s ON s.id = w.storey_id LEFT JOIN entity l ON l.id = r.elevator_id
WHERE e.map_id = (SELECT current_map()) ORDER BY e.name
"""

_CONNECTORS = """
SELECT array_send(w.pose || c.pose_a || c.pose_b), c.place_a, c.place_b,
       e.name, c.form, c.direction, c.state, c.behaviour, c.width, c.height, c.step,
       NULLIF(c.permissions, '{}'), NULLIF(e.properties, '{}'), e.id,
       CASE WHEN c.form IN ('stairs', 'ramp') THEN clear_width(c) END
FROM connector c JOIN entity e ON e.id = c.entity_id JOIN world w ON w.entity_id = e.id
WHERE e.map_id = (SELECT current_map()) AND (%s::bigint[] IS NULL OR e.id = ANY (%s::bigint[]))
  AND is_at_its_rooms(c, w.pose)
ORDER BY e.name
"""

_ASTRAY = """
SELECT e.name, a.name, b.name
FROM connector c JOIN entity e ON e.id = c.entity_id JOIN world w ON w.entity_id = e.id
JOIN entity a ON a.id = c.place_a LEFT JOIN entity b ON b.id = c.place_b
WHERE e.map_id = (SELECT current_map()) AND NOT e.id = ANY (%s::bigint[])
  AND NOT is_at_its_rooms(c, w.pose)
ORDER BY e.name
"""

_STEPS = "SELECT entity_id, step_of(c) FROM connector c WHERE entity_id = ANY (%s)"

_NARROWED = """
SELECT c.entity_id, array_agg(e.name ORDER BY e.name), ST_AsBinary(ST_Difference(
    ST_Buffer((way_of(c, w.pose)).line, coalesce(c.width, 0.9) / 2, 'endcap=square'),
    ST_Union(t.ground)))
FROM connector c JOIN world w ON w.entity_id = c.entity_id CROSS JOIN LATERAL things_on(c) t
JOIN entity e ON e.id = t.entity_id
WHERE c.entity_id = ANY (%s) GROUP BY c.entity_id, w.pose
"""

_THREE_POSES = np.dtype([("head", "V20"), ("poses", [("length", ">i4"), ("value", ">f8")], 21)])
"""Three poses in the binary format of an array of 21 numbers."""

_NO_PROPERTIES: Mapping[str, Any] = {}
"""Shared by all entities without properties."""

_REGIONS = """
SELECT e.id, e.name, e.label, e.type, e.properties,
       ST_AsBinary(coalesce(w.footprint, ST_Point(w.pose[1], w.pose[2]))) AS footprint,
       NULLIF(lower(g.valid), '-infinity') AS since, NULLIF(upper(g.valid), 'infinity') AS until,
       g.origin = 'drawn' AND w.entity_id IS NOT NULL AND coalesce(g.valid @> now(), true)
           AS valid_now
FROM region g JOIN entity e ON e.id = g.entity_id LEFT JOIN world w ON w.entity_id = e.id
WHERE e.map_id = (SELECT current_map()) ORDER BY e.name
"""

_REACHED = """
SELECT w.entity_id, array_agg(n.name ORDER BY n.name)
FROM world w JOIN world rw
     ON ST_Intersects(rw.footprint, coalesce(w.footprint, ST_Point(w.pose[1], w.pose[2])))
     AND (w.storey_id IS NULL OR rw.storey_id IS NOT DISTINCT FROM w.storey_id)
JOIN entity n ON n.id = rw.entity_id AND n.kind = 'room' AND n.map_id = (SELECT current_map())
WHERE w.entity_id = ANY (:ids) GROUP BY w.entity_id
"""


def read_topology(seen: Snapshot) -> Topology:
    """The topology of the current map, with all poses in the map's frame."""
    places = read_places(seen)
    regions, connectors = read_regions(seen)[0], read_connectors(seen, places)
    return Topology.of(places, connectors, regions, read_astray(seen, connectors))


def read_places(seen: Snapshot) -> list[Place]:
    """The rooms of the current map, and the cabins of its elevators, by name."""
    rows = fetch_rows(seen, _PLACES)
    types = read_supertypes(seen, {row[1] for row in rows})
    return [
        Place(name, kind, label, storey, lift, types.get(kind, ()), own or _NO_PROPERTIES, z, id_)
        for name, kind, label, storey, lift, own, z, id_ in rows
    ]


def read_regions(seen: Snapshot) -> tuple[list[PlaceRegion], dict[int, list[datetime]]]:
    """The regions that are drawn on the current map and valid now; those without area as points.

    Also, by id, the moments at which regions become valid or invalid, if there are any.
    """
    rows = fetch_rows(seen, _REGIONS, rows=namedtuple_row)
    ends = {row.id: [t for t in (row.since, row.until) if t is not None] for row in rows}
    timed = {number: moments for number, moments in ends.items() if moments}
    drawn = [row for row in rows if row.valid_now]
    if not drawn:
        return [], timed
    types = read_supertypes(seen, {row.type for row in drawn})
    reached = seen.connection.execute(text(_REACHED), {"ids": [row.id for row in drawn]})
    places = {number: tuple(names) for number, names in reached}
    regions = [
        PlaceRegion(
            row.name,
            shapely.from_wkb(bytes(row.footprint)),
            places[row.id],
            row.label,
            types.get(row.type, ()),
            row.properties,
        )
        for row in drawn
        if row.id in places
    ]
    return regions, timed


def read_connectors(
    seen: Snapshot, places: Iterable[Place], ids: Collection[int] | None = None
) -> list[PlaceConnector]:
    """The connectors, of these ids or all, that join these places, and are at them."""
    if ids is not None and not ids:
        return []
    names: dict[int | None, str] = {p.id: p.name for p in places if p.id is not None}
    names[None] = OUTSIDE
    floors = {p.id: p.floor for p in places}
    wanted = None if ids is None else [*ids]
    rows = fetch_rows(seen, _CONNECTORS, (wanted, wanted))
    rows = [row for row in rows if row[1] in names and row[2] in names]
    if not rows:
        return []
    packed = np.frombuffer(b"".join([row[0] for row in rows]), _THREE_POSES)
    three = packed["poses"]["value"].astype(np.float64).reshape(-1, 3, 7)
    differ = [row[-2] for row in rows if len({floors[n] for n in row[1:3] if n in floors}) > 1]
    steps = dict(fetch_rows(seen, _STEPS, (differ,))) if differ else {}
    widths = {row[-2]: row[-1] for row in rows if row[-1] is not None}
    narrowed = _read_narrowings(seen, widths)
    a, b = (map(Pose._make, _composed(three[:, 0], three[:, k]).tolist()) for k in (1, 2))
    found = []
    for poses, row in zip(zip(a, b, strict=True), rows, strict=True):
        _, place_a, place_b, name, *details, permissions, properties, number, _ = row
        fields: list[Any] = [name, (names[place_a], names[place_b]), poses]
        *details, step = details  # from form to step, as PlaceConnector has them
        fields += [*details, steps.get(number, step)]
        fields += [
            frozenset(permissions or ()),
            properties or _NO_PROPERTIES,
            number,
            narrowed.get(number),
        ]
        found.append(PlaceConnector(*fields))
    return found


def _read_narrowings(seen: Snapshot, widths: Mapping[int, float]) -> dict[int, Narrowing]:
    """What objects leave free of the stairs and ramps on which they are, by id, of these widths."""
    rows = fetch_rows(seen, _NARROWED, ([*widths],)) if widths else []
    return {
        number: Narrowing(widths[number], tuple(names), shapely.from_wkb(bytes(free)))
        for number, names, free in rows
    }


def read_astray(seen: Snapshot, connectors: Iterable[PlaceConnector]) -> dict[str, tuple[str, str]]:
    """The connectors that are not at the two places that they join; none of those that are."""
    rows = fetch_rows(seen, _ASTRAY, ([c.id for c in connectors],))
    return {name: (a, b or OUTSIDE) for name, a, b in rows}


def _composed(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 7) poses a @ b, row by row."""
    v, w = a[:, 3:6], a[:, 6:]
    t = 2 * np.cross(v, b[:, :3])
    at = a[:, :3] + b[:, :3] + w * t + np.cross(v, t)
    x, s = b[:, 3:6], b[:, 6:]
    turned = w * x + s * v + np.cross(v, x)
    return np.concatenate([at, turned, w * s - (v * x).sum(axis=1, keepdims=True)], axis=1)


def read_kinds(seen: Snapshot, ids: Collection[int]) -> dict[int, str]:
    """The kind of each entity that exists among those with these ids."""
    rows = seen.connection.execute(
        text("SELECT id, kind FROM entity WHERE id = ANY (:ids)"), {"ids": [*ids]}
    )
    return {row.id: row.kind for row in rows}
