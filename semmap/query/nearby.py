"""What of a type is near a point: answered by the spatial index, however many the subtypes."""

from __future__ import annotations

from sqlalchemy import ColumnElement, Double, Select, bindparam, func, select
from sqlalchemy.dialects.postgresql import ARRAY
from sqlalchemy.orm import Session
from sqlalchemy.types import Text

from semmap.model import Entity, TypeClosure, WorldPlacement

__all__ = ["NEAR", "nearest_of_type", "of_type_near", "subtypes"]

Point = tuple[float, float, float]


def subtypes(type_: str | ColumnElement[str]) -> ColumnElement[list[str]]:
    """The names of a type and its subtypes as one array, computed once a statement.

    An array leaves the planner no join to go wrong: under a generic plan, a join with the closure
    begins with all entities of the type.
    """
    closure = select(TypeClosure.sub).where(TypeClosure.super == type_)
    return func.array(closure.scalar_subquery(), type_=ARRAY(Text))


def _near_statement() -> Select[Entity]:
    """Parameters: `type`, `x`, `y`, `z`, `distance`. Built once, for building it takes a third of
    the time that answering it does."""
    x, y, z = (bindparam(name, type_=Double) for name in "xyz")
    reach = bindparam("distance", type_=Double)
    metres = func.semmap.box_distance(WorldPlacement.box, x, y, z)
    return (
        select(Entity)
        .join(WorldPlacement, WorldPlacement.entity_id == Entity.id)
        .where(
            WorldPlacement.box.op("&&")(func.semmap.around(x, y, z, reach)),
            metres <= reach,
            WorldPlacement.map_id == select(func.semmap.current_map()).scalar_subquery(),
            Entity.type == func.any(subtypes(bindparam("type", type_=Text))),
        )
        .order_by(metres, Entity.id)
    )


NEAR = _near_statement()


def of_type_near(session: Session, type_: str, point: Point, distance: float) -> list[Entity]:
    """Entities of the current map, of a type or its subtypes, within `distance` metres of a point.

    The distance is to the entity's 3D box, in the map's frame; the nearest come first.
    """
    x, y, z = point
    asked = {"type": type_, "x": x, "y": y, "z": z, "distance": distance}
    return list(session.scalars(NEAR, asked))


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
