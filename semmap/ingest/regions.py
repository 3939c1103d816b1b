"""Regions of the map: drawn, parts of a model's surface, or found in geometry.

Deeken et al., section 3.4: a region is a part of a room's or object's geometry that has a meaning
of its own. It is held by that room or object and so moves along with it. A region of the same name
is brought up to date, never doubled; one that is as it should be is not touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from psycopg.types.json import Jsonb
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection

from semmap.geometry.outline import silhouette
from semmap.geometry.pose import IDENTITY, Pose
from semmap.geometry.surfaces import support_surfaces
from semmap.geometry.tin import to_mesh
from semmap.ingest.holders import MANY_TRIANGLES, find_surfaces
from semmap.ingest.types import load_tbox
from semmap.query.meshes import model_triangles

__all__ = [
    "draw_region",
    "find_support_surfaces",
    "region_of_faces",
]

THIN = 0.01
"""Metres that the region of a surface reaches above it: what stands on the surface touches it."""

ROOM_HEIGHT = 2.5
"""Metres from a floor to a ceiling of which nothing is known."""

UPRIGHT = 1e-3
"""Parts of a quaternion in x and y below which an entity stands upright."""

Outline: TypeAlias = Polygon | MultiPolygon
Box = tuple[float, float, float, float, float, float]
Origin = Literal["drawn", "faces", "support_surface", "walkable_floor", "observation_area"]


@dataclass(frozen=True)
class _Owner:
    """An entity that has regions; pose, box (2, 3) and footprint in the map's frame."""

    id: int
    map_id: int
    name: str
    kind: str
    pose: Pose
    box: NDArray[np.float64]
    footprint: Outline | None


@dataclass(frozen=True)
class _Region:
    """A region as it should be: outline from z `low` to `high` in its own frame, in its holder."""

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


def draw_region(
    connection: Connection,
    map_id: int,
    name: str,
    outline: Outline | None = None,
    *,
    box: Box | None = None,
    type: str = "region",
    holder: int | None = None,
    properties: dict[str, Any] | None = None,
) -> int:
    """Make or redraw a region that somebody drew; returns its id.

    Parameters
    ----------
    outline : on the ground, in the map's frame, metres; the region reaches from the floor to the
        ceiling of the room that is, or holds, its holder
    box : instead of an outline: lowest and highest corner (x0, y0, z0, x1, y1, z1), map's frame
    type : a semantic type of the T-Box, such as ``blocked_region``
    holder : the entity that it is in and moves with; the map itself where None
    properties : added to those that it has

    Raises
    ------
    LookupError
        The T-Box has no such type, or the map no such holder.
    ValueError
        Both or neither of outline and box; one without extent; a name that is taken.
    """
    if (outline is None) == (box is None):
        raise ValueError(f"{name}: give either an outline or a box")
    owner = None if holder is None else _owner(connection, holder)
    if owner is not None and owner.map_id != map_id:
        raise ValueError(f"{name}: its holder {owner.name} is in another map")
    if box is not None:
        x0, y0, low, x1, y1, high = box
        if not (x0 < x1 and y0 < y1 and low < high and np.isfinite(box).all()):
            raise ValueError(f"{name}: the box {box} is not from a lower to a higher corner")
        outline = shapely.box(x0, y0, x1, y1)
    else:
        low, high = _heights(connection, owner)
    assert outline is not None
    region = _level_region(
        name, type, "drawn", owner, outline, low, high, properties=properties or {}
    )
    return _keep(connection, map_id, owner, region)


def region_of_faces(
    connection: Connection,
    entity: int,
    faces: Sequence[int],
    name: str,
    type: str = "surface_region",
    *,
    model: int | None = None,
) -> int:
    """Make or change a region that is some of the faces of an entity's model; returns its id.

    Its own model is the outline of these faces on the entity's ground (of upright ones, a strip of
    2 mm) over their heights; the view ``region_face`` shows the faces themselves.

    Parameters
    ----------
    faces : indices of triangles, in the order of the model's chunks (`model_triangles`), from 0
    model : which model; may be left out where the entity has one that is seen

    Raises
    ------
    ValueError
        No faces, one that the model does not have, or no single model to take them from.
    """
    owner = _owner(connection, entity)
    models = _models(connection, owner)
    if model is None and len(models) == 1:
        (model,) = models
    if model is None or model not in models:
        raise ValueError(f"{owner.name} has the models {models}: say of which the faces are")
    triangles = model_triangles(_driver(connection), model)
    chosen = sorted({int(face) for face in faces})
    if not chosen or chosen[0] < 0 or chosen[-1] >= len(triangles):
        raise ValueError(
            f"{name}: name one or more faces of {owner.name}, from 0 to {len(triangles) - 1}"
        )
    part = triangles[chosen]
    outline = silhouette(to_mesh(part))
    if outline.area < 1e-4:
        outline = shapely.MultiPoint(part.reshape(-1, 3)[:, :2]).convex_hull.buffer(0.001)
    low, high = float(part[:, :, 2].min()), float(part[:, :, 2].max())
    pose, outline = _at_its_middle(outline, 0.0)
    region = _Region(
        name, type, "faces", pose, outline, low, max(high, low + THIN),
        model_id=model, faces=chosen,
    )  # fmt: skip
    return _keep(connection, owner.map_id, owner, region)


def find_support_surfaces(connection: Connection, entity: int) -> list[int]:
    """Make regions of the level patches of an object on which things can stand; returns their ids.

    They are named ``NAME_surface_1`` and so on, the highest first. Those that a former search found
    and this one does not are taken out.

    Raises
    ------
    ValueError
        No object, one without triangles, or one of more than `MANY_TRIANGLES`.
    """
    owner = _owner(connection, entity)
    if owner.kind != "object":
        raise ValueError(f"{owner.name} is no object but {_a(owner.kind)}: it has no such surfaces")
    frame = IDENTITY
    if max(abs(owner.pose.qx), abs(owner.pose.qy)) >= UPRIGHT:
        frame = Pose(0, 0, 0, -owner.pose.qx, -owner.pose.qy, -owner.pose.qz, owner.pose.qw)
    found = []
    for model, height, outline, faces in _surfaces(connection, owner, frame):
        pose, flat = _at_its_middle(outline, height)
        found.append((frame @ pose, flat, model, faces))
    kept = [
        _keep(connection, owner.map_id, owner, _Region(
            f"{owner.name}_surface_{number}", "support_surface", "support_surface", pose, flat,
            0.0, THIN, model_id=model, faces=faces,
        ))
        for number, (pose, flat, model, faces) in enumerate(found, 1)
    ]  # fmt: skip
    connection.exec_driver_sql(
        "DELETE FROM entity e USING region r WHERE r.entity_id = e.id AND r.of_id = %(of)s "
        "AND r.origin = 'support_surface' AND NOT e.id = ANY(%(kept)s::bigint[])",
        {"of": owner.id, "kept": kept},
    )
    return kept


# -- what is read -----------------------------------------------------------------------------


def _driver(connection: Connection) -> psycopg.Connection[Any]:
    driver: psycopg.Connection[Any] | None = connection.connection.driver_connection
    assert driver is not None
    return driver


def _owner(connection: Connection, entity: int) -> _Owner:
    row = connection.exec_driver_sql(
        "SELECT e.id, e.map_id, e.name, e.kind, w.pose, ARRAY[ST_XMin(w.box), ST_YMin(w.box), "
        "ST_ZMin(w.box), ST_XMax(w.box), ST_YMax(w.box), ST_ZMax(w.box)], ST_AsBinary(w.footprint) "
        "FROM entity e LEFT JOIN world w ON w.entity_id = e.id WHERE e.id = %(id)s",
        {"id": entity},
    ).one_or_none()
    if row is None:
        raise LookupError(f"there is no entity with the id {entity}")
    number, map_id, name, kind, pose, box, footprint = row
    if pose is None:
        raise ValueError(f"{name} is not placed: a region has to be somewhere. Place it first")
    flat = None if footprint is None else shapely.from_wkb(bytes(footprint))
    return _Owner(number, map_id, name, kind, Pose(*pose), np.array(box).reshape(2, 3), flat)


def _room_of(connection: Connection, owner: _Owner) -> _Owner | None:
    """The entity itself where it is a room, else the nearest room above it in the inventories."""
    room = connection.exec_driver_sql(
        "WITH RECURSIVE up (id, depth) AS (SELECT %(id)s::bigint, 0 UNION ALL "
        "SELECT p.holder_id, up.depth + 1 FROM up JOIN placement p ON p.entity_id = up.id "
        "WHERE p.holder_id IS NOT NULL) "
        "SELECT e.id FROM up JOIN entity e ON e.id = up.id WHERE e.kind = 'room' "
        "ORDER BY up.depth LIMIT 1",
        {"id": owner.id},
    ).scalar()
    return None if room is None else _owner(connection, room)


def _heights(connection: Connection, owner: _Owner | None) -> tuple[float, float]:
    """Floor and ceiling of the room of an entity, else what rises from its lowest point."""
    if owner is None:
        return 0.0, ROOM_HEIGHT
    room = _room_of(connection, owner)
    if room is None:
        low = float(owner.box[0, 2])
        return low, low + ROOM_HEIGHT
    floor, ceiling = connection.exec_driver_sql(
        "SELECT floor, ceiling FROM room WHERE entity_id = %(id)s", {"id": room.id}
    ).one()
    low = room.pose.z + floor
    return low, low + ROOM_HEIGHT if ceiling is None else room.pose.z + ceiling


def _models(connection: Connection, owner: _Owner) -> list[int]:
    """The models that are seen; where there are none, those that collide."""
    rows = connection.exec_driver_sql(
        "SELECT em.model_id FROM entity_model em JOIN model m ON m.id = em.model_id "
        "WHERE em.entity_id = %(id)s AND m.triangles > 0 AND (em.role = 'visual' OR NOT EXISTS ("
        "SELECT FROM entity_model v WHERE v.entity_id = em.entity_id AND v.role = 'visual')) "
        "ORDER BY em.model_id",
        {"id": owner.id},
    )
    return list(rows.scalars())


def _surfaces(
    connection: Connection, owner: _Owner, frame: Pose
) -> list[tuple[int, float, Polygon, list[int]]]:
    """Model, height, outline and faces of the surfaces that are level in `frame`, highest first.

    Those that are level in the models' own frame are kept with the models; what lies on its side
    has others, which are looked for here.
    """
    models = _models(connection, owner)
    if not models:
        raise ValueError(f"{owner.name} has no triangles: import its mesh first")
    (most,) = connection.exec_driver_sql(
        "SELECT max(triangles) FROM model WHERE id = ANY(%(models)s)", {"models": models}
    ).one()
    if most > MANY_TRIANGLES:
        raise ValueError(f"{owner.name} has more than {MANY_TRIANGLES} triangles: simplify it")
    if frame is IDENTITY:
        find_surfaces(_driver(connection), owner.map_id)
        rows = connection.exec_driver_sql(
            "SELECT model_id, height, ST_AsBinary(outline), faces FROM support_surface "
            "WHERE model_id = ANY(%(models)s) AND height IS NOT NULL "
            "ORDER BY height DESC, ST_Area(outline) DESC, model_id, number",
            {"models": models},
        )
        return [(model, h, shapely.from_wkb(bytes(o)), faces) for model, h, o, faces in rows]
    found = []
    for model in models:
        turned = to_mesh(model_triangles(_driver(connection), model)).moved(frame.inverse())
        for s in support_surfaces(turned):
            found.append((model, s.height, s.outline, [int(face) for face in s.faces]))
    return sorted(found, key=lambda s: (-s[1], -s[2].area, s[0]))


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


# -- what is written --------------------------------------------------------------------------


def _at_its_middle(outline: Outline, height: float) -> tuple[Pose, Outline]:
    """A frame at a point of the outline, parallel to the one it is given in; the outline in it."""
    middle = outline.representative_point()
    x, y = round(middle.x, 6), round(middle.y, 6)
    return Pose(x, y, height), shapely.transform(outline, lambda points: points - (x, y))


def _level_region(
    name: str, type_: str, origin: Origin, owner: _Owner | None, outline: Outline, low: float,
    high: float, *, properties: dict[str, Any],
) -> _Region:  # fmt: skip
    """A region given in the map's frame: its own frame is level, its pose that in its owner."""
    pose, flat = _at_its_middle(outline, low)
    if owner is not None:
        pose = owner.pose.inverse() @ pose
    return _Region(name, type_, origin, pose, flat, 0.0, high - low, properties)


def _keep(connection: Connection, map_id: int, owner: _Owner | None, region: _Region) -> int:
    """Bring the map's region of that name to what it should be, and nothing else."""
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


def _check_type(connection: Connection, region: _Region) -> None:
    known = "SELECT EXISTS (SELECT FROM type_closure WHERE (sub, super) = (%(type)s, 'region'))"
    if connection.exec_driver_sql(known, {"type": region.type}).scalar():
        return
    load_tbox(connection)
    if not connection.exec_driver_sql(known, {"type": region.type}).scalar():
        kinds = connection.exec_driver_sql(
            "SELECT sub FROM type_closure WHERE super = 'region' ORDER BY sub"
        ).scalars()
        raise LookupError(
            f"{region.name}: the T-Box has no type of region {region.type}; it has "
            + ", ".join(kinds)
        )


def _entry(connection: Connection, map_id: int, owner: _Owner | None, region: _Region) -> int:
    """The entity and its row of table region, made or brought up to date."""
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
            raise ValueError(f"the map has another {region.name}, {_a(what)}: rename or delete it")
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


def _give_outline(connection: Connection, entity: int, region: _Region) -> None:
    """The drawn model of the region's outline, instead of the one that it had."""
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
