"""A map, or the room of an entity, as a plan for notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from semmap.api.map_questions import MapQuestions

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


def room_svg(map: MapQuestions, entity: int) -> str:
    """The plan of the room of an entity, with the entity marked; empty without outlines."""
    from semmap.query.entity_shapes import read_shapes

    rows = map._rows(_IN_ROOM, entity)
    shapes = read_shapes(map._seen, [row[0] for row in rows])
    if not any(shape["geometry"] is not None for shape in shapes):
        return ""
    return plan_of(map, shapes, width=280, marked=entity)


def plan_of(map: MapQuestions, rows: list[dict[str, Any]], **options: Any) -> str:
    """The plan of rows as of `read_shapes`, as SVG."""
    from semmap.draw.plan_svg import plan_svg
    from semmap.query.supertypes import read_supertypes

    types = read_supertypes(map._seen, {row["type"] for row in rows})
    return plan_svg(rows, types, **options)
