"""Data sets from the database: objects of a map, and the object models of manipulation."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import psycopg

from semmap.interlinking.records import Records
from semmap.query.snapshot import Snapshot

OBJECTS = """
SELECT e.name, jsonb_strip_nulls(jsonb_build_object(
           'name', e.name, 'type', e.type, 'label', e.label,
           'width', round(s.sides[1]::numeric, 3), 'length', round(s.sides[2]::numeric, 3),
           'height', round(s.height::numeric, 3))
       || e.properties)
FROM semmap.entity e, LATERAL semmap.size_of(e.id) s
WHERE e.map_id = (SELECT semmap.current_map()) AND e.kind = 'object' ORDER BY e.name
"""

MODELS = """
SELECT m.key, jsonb_strip_nulls(jsonb_build_object(
           'name', m.name, 'type', m.type, 'function', to_jsonb(m.functions), 'shape', m.shape,
           'size', to_jsonb(m.size), 'gripper', g.grippers, 'approach', g.approaches,
           'grasps', g.grasps, 'grasp_points', g.points))
FROM semmap.object_model m LEFT JOIN (
    SELECT a.object_id, jsonb_agg(DISTINCT d.name) AS grippers,
           jsonb_agg(DISTINCT a.approach) FILTER (WHERE a.approach IS NOT NULL) AS approaches,
           count(*) AS grasps,
           (jsonb_agg(DISTINCT round(a.pose[1]::numeric, 3) || ' ' || round(a.pose[2]::numeric, 3)
                      || ' ' || round(a.pose[3]::numeric, 3))) AS points
    FROM semmap.action a JOIN semmap.device d ON d.id = a.gripper_id
    WHERE a.kind = 'grasp' AND a.replaced_by IS NULL GROUP BY a.object_id) g ON g.object_id = m.id
ORDER BY m.key
"""

MOST_VALUES = 20  # of a property of a model: it may have thousands of grasp points


def read_map_objects(seen: Snapshot) -> Records:
    """Return the objects of a map, with sizes (m) and free properties."""
    return _records(seen.session, OBJECTS, f"map {seen.name}")


def read_object_models(session: psycopg.Connection[Any]) -> Records:
    """Return the stored object models: name, type, functions, shape, grippers, grasp points."""
    return _records(session, MODELS, "models")


def _records(session: psycopg.Connection[Any], query: str, name: str) -> Records:
    rows = session.execute(query).fetchall()
    columns: dict[str, list[tuple[str, ...]]] = defaultdict(lambda: [()] * len(rows))
    for number, (_, properties) in enumerate(rows):
        for key, value in properties.items():
            values = value if isinstance(value, list) else [value]
            columns[key][number] = tuple(
                str(v) for v in values[:MOST_VALUES] if isinstance(v, str | int | float)
            )
    return Records(name, [row[0] for row in rows], columns)
