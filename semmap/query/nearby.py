"""What of a type is near a point: answered by the spatial index, whatever the number of subtypes."""

from __future__ import annotations

from sqlalchemy import Select, func, select
from sqlalchemy.dialects.postgresql import ARRAY
from sqlalchemy.orm import Session
from sqlalchemy.types import Text

from semmap.model import Entity, TypeClosure, WorldPlacement

__all__ = ["nearest_of_type", "of_type_near"]

Point = tuple[float, float, float]


def of_type(type_: str) -> Select[tuple[list[str]]]:
    """The names of a type and its subtypes as one array, computed once a statement.

    An array leaves the planner no join to go wrong: under a generic plan a join with the closure
    scans the type's million entities first.
    """
    return select(
        func.array(
            select(TypeClosure.sub).where(TypeClosure.super == type_).scalar_subquery(),
            type_=ARRAY(Text),
        )
    )


def near_statement(type_: str, point: Point, distance: float) -> Select[tuple[Entity]]:
    """Entities of the current map, of a type or its subtypes, within `distance` metres of a point.

    The distance is to the entity's 3D box (world coordinates); the nearest come first.
    """
    x, y, z = point
    metres = func.semmap.box_distance(WorldPlacement.box, x, y, z)
    return (
        select(Entity)
        .join(WorldPlacement, WorldPlacement.entity_id == Entity.id)
        .where(
            WorldPlacement.box.op("&&&")(func.semmap.around(x, y, z, distance)),
            metres <= distance,
            WorldPlacement.map_id == func.semmap.current_map(),
            Entity.type == func.any(of_type(type_).scalar_subquery()),
        )
        .order_by(metres, Entity.id)
    )


def of_type_near(session: Session, type_: str, point: Point, distance: float) -> list[Entity]:
    """Entities of a type within `distance` metres of a point in the map's frame, nearest first."""
    return list(session.scalars(near_statement(type_, point, distance)))


def nearest_of_type(session: Session, type_: str, point: Point, count: int = 1) -> list[Entity]:
    """The `count` entities of a type whose 3D boxes are nearest to a point, nearest first.

    Asks the index in growing cubes, so that a near answer costs little.
    """
    distance = 1.0
    while distance < 1e6:
        found = of_type_near(session, type_, point, distance)
        if len(found) >= count:
            return found[:count]
        distance *= 4
    return of_type_near(session, type_, point, distance)[:count]
