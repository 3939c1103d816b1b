"""What of a type is near a point: answered by the spatial index, however many the subtypes."""

from __future__ import annotations

import math

from sqlalchemy import Double, Select, bindparam, func, select
from sqlalchemy.orm import Session
from sqlalchemy.types import Text

from semmap.model import Entity, ObjectType, WorldPlacement

__all__ = ["FAR", "NEAR", "nearest_of_type", "of_type_near"]

Point = tuple[float, float, float]

EVERYWHERE = 1e9
CLOSE = 10.0
"""Within so many metres the spatial index is where to begin, whatever the type."""


def _statement(*, planned_once: bool) -> Select[Entity]:
    """Parameters: `type`, `x`, `y`, `z`, `distance`.

    Parameters
    ----------
    planned_once : hide the place from the planner, in a subquery, so that one plan serves all.
        Else it is written into the statement (`float` made its numbers): each is planned by how
        much lies there, which takes as long as a near answer does, and begins with a rare type
        where the place is wide.
    """
    x, y, z, reach = (
        bindparam(name, type_=Double, literal_execute=not planned_once)
        for name in ("x", "y", "z", "distance")
    )
    cube = func.semmap.around(x, y, z, reach)
    metres = func.semmap.box_distance(WorldPlacement.box, x, y, z)
    map_id = select(func.semmap.current_map()).scalar_subquery()
    return (
        select(Entity)
        .join(WorldPlacement, WorldPlacement.entity_id == Entity.id)
        .join(ObjectType, ObjectType.id == WorldPlacement.entity_id)
        .where(
            WorldPlacement.box.op("&&")(select(cube).scalar_subquery() if planned_once else cube),
            metres <= reach,
            WorldPlacement.map_id == map_id,
            ObjectType.map_id == map_id,
            ObjectType.type == bindparam("type", type_=Text),
        )
        .order_by(metres, Entity.id)
    )


# Made once, for to make one takes a third of the time that its answer does.
NEAR = _statement(planned_once=True)
FAR = _statement(planned_once=False)


def of_type_near(session: Session, type_: str, point: Point, distance: float) -> list[Entity]:
    """Entities of the current map, of a type or its subtypes, within `distance` metres of a point.

    The distance is to the entity's 3D box, in the map's frame; the nearest come first.

    Raises
    ------
    ValueError
        A coordinate is not finite, or the distance is not a number (infinity is allowed).
    """
    x, y, z = (round(float(value), 9) for value in point)  # a square of less would underflow
    reach = min(float(distance), EVERYWHERE)
    if not all(map(math.isfinite, (x, y, z, reach))):
        raise ValueError(f"near {point}, {distance} m: give finite numbers, metres")
    asked = {"type": type_, "x": x, "y": y, "z": z, "distance": reach}
    return list(session.scalars(NEAR if reach <= CLOSE else FAR, asked))


def nearest_of_type(session: Session, type_: str, point: Point, count: int = 1) -> list[Entity]:
    """The `count` entities of a type whose 3D boxes are nearest to a point, nearest first.

    Queries the index in growing cubes, so that a near answer costs little.
    """
    distance = 1.0
    while distance < 1e6:
        found = of_type_near(session, type_, point, distance)
        if len(found) >= count:
            return found[:count]
        distance *= 4
    return of_type_near(session, type_, point, distance)[:count]
