"""Regions into the database: made, or updated where they differ."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from psycopg.types.json import Jsonb
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection

from semmap.geometry.morphology import polygons
from semmap.geometry.pose import Pose
from semmap.ingest.ontology.type_store import load_tbox

Outline: TypeAlias = Polygon | MultiPolygon
Origin = Literal["drawn", "faces", "support_surface", "walkable_floor", "observation_area"]


@dataclass(frozen=True)
class Owner:
    """An entity that has regions; pose, box (2, 3) and footprint in the map's frame."""

    id: int
    map_id: int
    name: str
    kind: str
    pose: Pose
    box: NDArray[np.float64]
    footprint: Outline | None


@dataclass(frozen=True)
class Wanted:
    """The wanted state of a region: its pose in its holder; outline and z in its own frame."""

    name: str
    type: str
    origin: Origin
    pose: Pose
    outline: Outline
    low: float
    high: float
    properties: dict[str, Any] = field(default_factory=dict)
    model_id: int | None = None
    faces: list[int] | None = None


def at_its_middle(outline: Outline, height: float) -> tuple[Pose, Outline]:
    """A frame at a point of the outline, parallel to the given one; the outline in it.

    A neck as thin as the last digit may cross itself there; it is cut, with what it joins kept.
    """
    middle = outline.representative_point()
    x, y = round(middle.x, 6), round(middle.y, 6)
    moved = shapely.transform(outline, lambda points: points - (x, y))
    if not moved.is_valid:
        moved = shapely.MultiPolygon([p for p in polygons(shapely.make_valid(moved)) if p.area])
    return Pose(x, y, height), moved


def level_region(
    name: str,
    type_: str,
    origin: Origin,
    owner: Owner | None,
    outline: Outline,
    low: float,
    high: float,
    properties: dict[str, Any],
) -> Wanted:
    """Return a region given in the map's frame; its own frame is level."""
    pose, flat = at_its_middle(outline, low)
    if owner is not None:
        pose = owner.pose.inverse() @ pose
    return Wanted(name, type_, origin, pose, flat, 0.0, high - low, properties)


def keep(connection: Connection, map_id: int, owner: Owner | None, region: Wanted) -> int:
    """Make or update the map's region of that name and return its id."""
    connection.exec_driver_sql("SELECT pg_advisory_xact_lock(hashtext('semmap.regions'))")
    _check_type(connection, region)
    entity = _entry(connection, map_id, owner, region)
    _give_outline(connection, entity, region)
    connection.exec_driver_sql(
        "INSERT INTO placement AS p (entity_id, holder_id, pose) "
        "VALUES (%(id)s, %(holder)s, %(pose)s) ON CONFLICT (entity_id) DO UPDATE "
        "SET holder_id = excluded.holder_id, pose = excluded.pose "
        "WHERE (p.holder_id, p.pose) IS DISTINCT FROM (excluded.holder_id, excluded.pose)",
        {"id": entity, "holder": owner and owner.id, "pose": region.pose.row},
    )
    return entity


def _check_type(connection: Connection, region: Wanted) -> None:
    subtypes = "SELECT sub FROM type_closure WHERE super = 'region' ORDER BY sub"
    if region.type in connection.exec_driver_sql(subtypes).scalars().all():
        return
    load_tbox(connection)
    known = connection.exec_driver_sql(subtypes).scalars().all()
    if region.type not in known:
        problem = f"{region.name}: the T-Box has no type of region {region.type}"
        raise LookupError(f"{problem}; it has {', '.join(known)}")


def _entry(connection: Connection, map_id: int, owner: Owner | None, region: Wanted) -> int:
    """Make or update the entity and its row of the table region; return its id."""
    values = {
        "map": map_id,
        "name": region.name,
        "type": region.type,
        "properties": Jsonb(region.properties),
        "of": owner.id if owner is not None and owner.kind in ("room", "object") else None,
        "model": region.model_id,
        "faces": region.faces,
        "origin": region.origin,
    }
    there = connection.exec_driver_sql(
        "SELECT e.id, e.kind, r.origin, r.of_id FROM entity e "
        "LEFT JOIN region r ON r.entity_id = e.id WHERE (e.map_id, e.name) = (%(map)s, %(name)s)",
        values,
    ).one_or_none()
    if there is None:
        entity = connection.exec_driver_sql(
            "INSERT INTO entity (map_id, kind, name, type, properties) "
            "VALUES (%(map)s, 'region', %(name)s, %(type)s, %(properties)s) RETURNING id",
            values,
        ).scalar_one()
    else:
        entity, kind, origin, of = there
        if kind != "region" or (
            region.origin != "drawn" and (origin, of) != (region.origin, values["of"])
        ):
            what = kind if origin is None else f"{origin.replace('_', ' ')} region"
            raise ValueError(
                f"the map has another {region.name}, {with_article(what)}: rename or delete it"
            )
        connection.exec_driver_sql(
            "UPDATE entity SET type = %(type)s, properties = properties || %(properties)s "
            "WHERE id = %(id)s AND NOT "
            "(type IS NOT DISTINCT FROM %(type)s AND properties @> %(properties)s)",
            {**values, "id": entity},
        )
    connection.exec_driver_sql(
        "INSERT INTO region AS r (entity_id, of_id, model_id, faces, origin) "
        "VALUES (%(id)s, %(of)s, %(model)s, %(faces)s, %(origin)s) ON CONFLICT (entity_id) "
        "DO UPDATE SET of_id = excluded.of_id, model_id = excluded.model_id, "
        "faces = excluded.faces, origin = excluded.origin "
        "WHERE (r.of_id, r.model_id, r.faces, r.origin) IS DISTINCT FROM "
        "(excluded.of_id, excluded.model_id, excluded.faces, excluded.origin)",
        {**values, "id": entity},
    )
    return int(entity)


def _give_outline(connection: Connection, entity: int, region: Wanted) -> None:
    """Replace the region's model by the drawn model of its outline."""
    model = connection.exec_driver_sql(
        "SELECT drawn_model(check_outline(ST_GeomFromWKB(%(outline)s, 0), %(name)s), "
        "%(low)s::float8, %(high)s::float8)",
        {
            "outline": shapely.to_wkb(shapely.force_2d(region.outline)),
            "name": region.name,
            "low": region.low,
            "high": region.high,
        },
    ).scalar_one()
    former = connection.exec_driver_sql(
        "DELETE FROM entity_model WHERE entity_id = %(id)s AND model_id <> %(model)s "
        "RETURNING model_id",
        {"id": entity, "model": model},
    )
    unused = list(former.scalars())
    connection.exec_driver_sql(
        "INSERT INTO entity_model (entity_id, model_id) SELECT %(id)s, %(model)s "
        "WHERE NOT EXISTS (SELECT FROM entity_model WHERE (entity_id, model_id) = "
        "(%(id)s, %(model)s))",
        {"id": entity, "model": model},
    )
    connection.exec_driver_sql(
        "DELETE FROM model m WHERE m.id = ANY(%(unused)s::bigint[]) "
        "AND NOT EXISTS (SELECT FROM entity_model e WHERE e.model_id = m.id) "
        "AND NOT EXISTS (SELECT FROM region r WHERE r.model_id = m.id)",
        {"unused": unused},
    )


def with_article(noun: str) -> str:
    """The noun after its indefinite article: a door, an elevator."""
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"
