"""Whether tests left a map that disagrees with itself."""

from __future__ import annotations

import psycopg
from sqlalchemy import URL

Contradiction = tuple[str, str, str | None, str, str | None]
"""Map, entity, its holder, the kind of problem, and the holder that the geometry shows."""

HOLDERS = """
SELECT m.name AS map, e.name, h.name AS holder,
       CASE WHEN p.confidence IS NULL THEN 'stated' ELSE 'derived' END || ' holder' AS problem,
       d.name AS geometry_says
FROM semmap.map m
CROSS JOIN LATERAL semmap.derived_holders(ARRAY(
    SELECT id FROM semmap.entity WHERE map_id = m.id AND kind IN ('object', 'agent'))) g
JOIN semmap.entity e ON e.id = g.entity_id
JOIN semmap.placement p ON p.entity_id = e.id
LEFT JOIN semmap.entity h ON h.id = p.holder_id
LEFT JOIN semmap.entity d ON d.id = g.holder_id
WHERE CASE WHEN p.confidence IS NULL AND p.holder_id IS NOT NULL AND h.kind <> 'storey'
           THEN semmap.contradicts(e.id, p.holder_id, g.holder_id, g.confidence)
           ELSE p.holder_id IS DISTINCT FROM g.holder_id END
"""
"""Where the holders that changes left are not those that all derived at once would be.

It shows that the triggers forget nothing; whether the rules are right, `tests.buildings` judges.
"""

POSES = """
SELECT m.name AS map, e.name, h.name AS holder, 'world pose' AS problem, NULL AS geometry_says
FROM semmap.placement p JOIN semmap.entity e ON e.id = p.entity_id
JOIN semmap.map m ON m.id = e.map_id LEFT JOIN semmap.world w ON w.entity_id = p.entity_id
LEFT JOIN semmap.world k ON k.entity_id = p.holder_id
LEFT JOIN semmap.entity h ON h.id = p.holder_id
WHERE w.pose IS NULL OR EXISTS (
    SELECT FROM unnest(w.pose, CASE WHEN p.holder_id IS NULL THEN p.pose
                               ELSE semmap.pose_compose(k.pose, p.pose) END) AS t (is_at, should_be)
    WHERE NOT abs(is_at - should_be) <= 1e-6 * (1 + abs(should_be)))
"""
"""Where the pose in the world is not the holder's pose times the placement."""


def contradictions(database: URL) -> list[Contradiction]:
    """Return where stored holders and poses are not those that would be derived, ten at most.

    A database without the schema, or with that of an earlier revision, has none.
    """
    url = database.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url) as connection:
        installed = "SELECT to_regproc('semmap.part_by_shape') IS NOT NULL"
        if connection.execute(installed).fetchone() == (False,):
            return []
        if connection.execute("SELECT FROM semmap.placement LIMIT 1").fetchone() is None:
            return []
        return connection.execute(f"{HOLDERS} UNION ALL {POSES} LIMIT 10").fetchall()
