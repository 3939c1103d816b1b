"""The regions of a map, as rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import psycopg
from psycopg.rows import dict_row

REGIONS = """
SELECT e.name, e.type, r.origin, o.name AS of, h.name AS holder, ST_Area(w.footprint) AS area,
       ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high, cardinality(r.faces) AS faces
FROM region r JOIN entity e ON e.id = r.entity_id
LEFT JOIN entity o ON o.id = r.of_id LEFT JOIN placement p ON p.entity_id = e.id
LEFT JOIN entity h ON h.id = p.holder_id LEFT JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND (%(ids)s::bigint[] IS NULL OR e.id = ANY (%(ids)s))
ORDER BY e.name
"""


def list_regions(
    session: psycopg.Connection[Any], ids: Sequence[int] | None = None
) -> list[dict[str, Any]]:
    """Return the regions of the map, or those with these ids; area in square metres, z in metres.

    `of` is the entity that it is a part of; `faces` is their number.
    """
    with session.cursor(row_factory=dict_row) as cursor:
        rows = cursor.execute(REGIONS, {"ids": ids}).fetchall()
    return [
        {key: round(v, 3) if isinstance(v, float) else v for key, v in row.items()} for row in rows
    ]
