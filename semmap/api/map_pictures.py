"""A map and its entities as plans, for notebooks."""

from __future__ import annotations

import html
from typing import Any

from semmap.api.map_questions import MapQuestions

_TYPES = (
    "SELECT c.sub, array_agg(c.super ORDER BY c.sub <> c.super, "
    "(SELECT count(*) FROM type_closure n WHERE n.super = c.super), c.super) FROM type_closure c "
    "WHERE c.sub = ANY (%s) GROUP BY c.sub"
)
_LOWEST = (
    "SELECT e.name FROM entity e JOIN world w ON w.entity_id = e.id "
    "WHERE e.map_id = current_map() AND e.kind = 'storey' ORDER BY w.pose[3], e.name LIMIT 1"
)

_IN_ROOM = (
    "WITH RECURSIVE given (id) AS (SELECT %s::bigint), "
    "home (id) AS (SELECT r.entity_id FROM given g LEFT JOIN connector c ON c.entity_id = g.id "
    "JOIN room r ON r.entity_id IN (place_of(g.id), c.place_a, c.place_b)), "
    "held (id) AS (SELECT id FROM home UNION "
    "SELECT p.entity_id FROM held JOIN placement p ON p.holder_id = held.id) "
    "SELECT id FROM given UNION SELECT id FROM held UNION SELECT c.entity_id FROM connector c "
    "JOIN home ON home.id IN (c.place_a, c.place_b)"
)
"""An entity, and all that is in its room, with the doors of that."""


class MapPictures(MapQuestions):
    """The part of `Map` that shows it in a notebook."""

    def _repr_svg_(self) -> str:
        """The floor plan of the lowest storey: rooms, regions, doors and furniture."""
        from semmap.query.entity_shapes import read_shapes

        rows = read_shapes(self.connection)
        lowest = self.execute(_LOWEST)
        storey = lowest[0][0] if lowest else None
        shown = [row for row in rows if row["storey"] in (storey, None)]
        title = self.name if storey is None else f"{self.name}, {storey}"
        return _svg(self, shown, title=title)

    def _repr_html_(self) -> str:
        """The name of the map, how many entities it has, and its floor plan."""
        rows = self.execute(
            "SELECT kind, count(*) FROM entity WHERE map_id = current_map() "
            "GROUP BY kind ORDER BY count(*) DESC, kind"
        )
        counts = ", ".join(f"{count} {kind}{'s' if count > 1 else ''}" for kind, count in rows)
        title = f"<div><b>{html.escape(self.name)}</b>: {counts or 'empty'}</div>"
        return title + self._repr_svg_()


def room_svg(map: MapQuestions, entity: int) -> str:
    """The plan of the room of an entity, with the entity marked; empty without outlines."""
    from semmap.query.entity_shapes import read_shapes

    rows = map.execute(_IN_ROOM, entity)
    shapes = read_shapes(map.connection, [row[0] for row in rows])
    if not any(shape["geometry"] is not None for shape in shapes):
        return ""
    return _svg(map, shapes, width=280, marked=entity)


def _svg(map: MapQuestions, rows: list[dict[str, Any]], **options: Any) -> str:
    from semmap.draw.plan_svg import plan_svg

    types = map.execute(_TYPES, [row["type"] for row in rows if row["type"]])
    return plan_svg(rows, {sub: tuple(above) for sub, above in types}, **options)
