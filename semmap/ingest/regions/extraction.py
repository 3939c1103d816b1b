"""Regions of the map: drawn, parts of a model's surface, or found (Deeken et al., section 3.4).

The room or object of which it is a part holds a region. One of the same name is updated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from sqlalchemy import Connection

from semmap.database.maps import driver_of
from semmap.geometry.floor import walkable_floor
from semmap.geometry.ground_outline import silhouette
from semmap.geometry.mesh import Mesh
from semmap.geometry.observation import observation_area
from semmap.geometry.pose import IDENTITY, Pose
from semmap.geometry.surfaces import support_surfaces
from semmap.geometry.tin import to_mesh
from semmap.ingest.regions.region_store import (
    Origin,
    Outline,
    Owner,
    Wanted,
    at_its_middle,
    keep,
    level_region,
    with_article,
)
from semmap.ingest.store.holder_store import find_surfaces
from semmap.limits import SURFACE_TRIANGLES
from semmap.query.meshes import model_triangles, world_triangles

THIN = 0.01
"""Height of a surface's region above it, metres: objects on the surface touch the region."""

LEAST_AREA = 1e-4
"""Square metres below which the database takes an outline for none; a sliver is not a surface."""

ROOM_HEIGHT = 2.5
"""Height of a room whose ceiling is unknown, metres."""

UPRIGHT = 1e-3
"""Largest x and y of the quaternion of an upright entity."""

Box = tuple[float, float, float, float, float, float]


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
    valid: tuple[datetime | None, datetime | None] | None = None,
) -> int:
    """Make or redraw a drawn region; return its id.

    It has an outline on the ground, in the map's frame, metres, and reaches from the floor to the
    ceiling of the room that is, or holds, its holder; or it is a box from the lowest to the highest
    corner. With the holder it moves; without, the map holds it. The properties are added to those
    that it has; `valid` is from when until when it holds, None being open, as it was where not
    given.

    LookupError: the type or the holder is not known. ValueError: something else is wrong.
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
    region = level_region(name, type, "drawn", owner, outline, low, high, properties or {})
    made = keep(connection, map_id, owner, region)
    if valid is not None:
        since, until = valid
        if since is not None and until is not None and since >= until:
            raise ValueError(f"{name}: it would end at {until}, before it begins at {since}")
        connection.exec_driver_sql(
            "UPDATE region SET valid = tstzrange(%(since)s, %(until)s) WHERE entity_id = %(id)s "
            "AND valid IS DISTINCT FROM tstzrange(%(since)s, %(until)s)",
            {"since": since, "until": until, "id": made},
        )
    return made


def region_of_faces(
    connection: Connection,
    entity: int,
    faces: Sequence[int],
    name: str,
    type: str = "surface_region",
    *,
    model: int | None = None,
) -> int:
    """Make or change a region of some faces of an entity's model; return its id.

    Its own model is the outline of these faces on the entity's ground (of upright ones, a strip of
    2 mm) over their heights; the view ``region_face`` shows the faces themselves, indices from 0 in
    the order of the model's chunks. The model may be left out where one is seen.

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
        raise ValueError(f"{owner.name} has the models {models}: name the model that has the faces")
    triangles = model_triangles(driver_of(connection), model)
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
    pose, outline = at_its_middle(outline, 0.0)
    high = max(high, low + THIN)
    region = Wanted(name, type, "faces", pose, outline, low, high, model_id=model, faces=chosen)
    return keep(connection, owner.map_id, owner, region)


def find_support_surfaces(connection: Connection, entity: int) -> list[int]:
    """Make regions of the support surfaces of an object; return their ids.

    They are named ``NAME_surface_1`` and so on, the highest first; those of a former search that
    are not found again are taken out. A ValueError says why an object has none.
    """
    owner = _owner(connection, entity)
    if owner.kind != "object":
        raise ValueError(
            f"{owner.name} is not an object but {with_article(owner.kind)}: it has no such surfaces"
        )
    frame = IDENTITY
    if max(abs(owner.pose.qx), abs(owner.pose.qy)) >= UPRIGHT:
        frame = owner.pose._replace(x=0.0, y=0.0, z=0.0).inverse()
    kept: list[int] = []
    sort: Origin = "support_surface"
    for model, height, outline, faces in _surfaces(connection, owner, frame):
        pose, flat = at_its_middle(outline, height)
        if flat.area < LEAST_AREA:
            continue
        name, pose = f"{owner.name}_surface_{len(kept) + 1}", frame @ pose
        region = Wanted(name, sort, sort, pose, flat, 0.0, THIN, model_id=model, faces=faces)
        kept.append(keep(connection, owner.map_id, owner, region))
    connection.exec_driver_sql(
        "DELETE FROM entity e USING region r WHERE r.entity_id = e.id AND r.of_id = %(of)s "
        "AND r.origin = 'support_surface' AND NOT e.id = ANY(%(kept)s::bigint[])",
        {"of": owner.id, "kept": kept},
    )
    return kept


def find_walkable_floor(
    connection: Connection,
    room: int,
    *,
    headroom: float = 2.0,
    max_step: float = 0.03,
    max_slope: float = math.radians(10),
) -> int:
    """Make the region ``NAME_floor``, the walkable floor of a room as it is now; return its id.

    `headroom` is metres that have to be free above, `max_step` metres that one steps up or down,
    `max_slope` radians of tilt. A ValueError says why there is no place to walk.
    """
    owner = _owner(connection, room)
    if owner.kind != "room" or owner.footprint is None:
        raise ValueError(
            f"{owner.name} is not a room with an outline but {with_article(owner.kind)}: "
            "it has no floor"
        )
    height, _ = _heights(connection, owner)
    shell, standing = _shell(connection, owner), _standing_in(connection, owner)
    limits = {"headroom": headroom, "max_step": max_step, "max_slope": max_slope}
    floor = walkable_floor(owner.footprint, height, shell, standing, **limits)
    if floor is None:
        raise ValueError(
            f"nothing of {owner.name} can be walked on at z = {height:.3f} m with {headroom} m "
            "above it free: check the room's floor height, or ask for less headroom"
        )
    name, high = f"{owner.name}_floor", max(floor.high, floor.low + THIN)
    limits["max_slope"] = round(max_slope, 6)
    sort: Origin = "walkable_floor"
    region = level_region(name, sort, sort, owner, floor.outline, floor.low, high, limits)
    return keep(connection, owner.map_id, owner, region)


def find_observation_area(
    connection: Connection, entity: int, *, near: float = 0.5, far: float = 1.2
) -> int:
    """Make the region ``NAME_observation``, from which to observe an object; return its id.

    A ring from `near` to `far` metres from the object's footprint, within its room, from floor to
    ceiling, which moves with the object; its room clips it again when it is found again. A
    ValueError says why there is none.
    """
    owner = _owner(connection, entity)
    if owner.kind in ("room", "storey", "region") or owner.footprint is None:
        raise ValueError(
            f"{owner.name} is not an object but {with_article(owner.kind)}, or has no footprint"
        )
    room = _room_of(connection, owner)
    try:
        ring = observation_area(owner.footprint, near, far, room and room.footprint)
    except ValueError as error:
        raise ValueError(f"{owner.name}: {error}") from None
    low, high = _heights(connection, owner)
    name, about = f"{owner.name}_observation", {"near": near, "far": far}
    sort: Origin = "observation_area"
    region = level_region(name, sort, sort, owner, ring, low, high, about)
    return keep(connection, owner.map_id, owner, region)


def _owner(connection: Connection, entity: int) -> Owner:
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
    return Owner(number, map_id, name, kind, Pose(*pose), np.array(box).reshape(2, 3), flat)


def _room_of(connection: Connection, owner: Owner) -> Owner | None:
    """The room of an entity; of a room, itself."""
    room = connection.exec_driver_sql("SELECT room_of(%(id)s)", {"id": owner.id}).scalar()
    return None if room is None else _owner(connection, room)


def _heights(connection: Connection, owner: Owner | None) -> tuple[float, float]:
    """Return floor and ceiling of an entity's room, else heights from the entity's lowest point."""
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


def _models(connection: Connection, owner: Owner) -> list[int]:
    """Return the visual models, or the collision models where there are none."""
    rows = connection.exec_driver_sql(
        "SELECT em.model_id FROM entity_model em JOIN model m ON m.id = em.model_id "
        "WHERE em.entity_id = %(id)s AND m.triangles > 0 AND (em.role = 'visual' OR NOT EXISTS ("
        "SELECT FROM entity_model v WHERE v.entity_id = em.entity_id AND v.role = 'visual')) "
        "ORDER BY em.model_id",
        {"id": owner.id},
    )
    return list(rows.scalars())


def _shell(connection: Connection, room: Owner) -> Mesh | None:
    """Return the room's mesh in the map's frame; None where it is drawn, or has none."""
    drawn = connection.exec_driver_sql(
        "SELECT bool_and(m.kind = 'polygon') FROM entity_model em "
        "JOIN model m ON m.id = em.model_id "
        "WHERE em.entity_id = %(id)s",
        {"id": room.id},
    ).scalar()
    if drawn is None or drawn:
        return None
    triangles = world_triangles(driver_of(connection), [room.id]).get(room.id)
    return None if triangles is None else to_mesh(triangles)


def _standing_in(connection: Connection, room: Owner) -> list[tuple[Mesh, bool]]:
    """Return the meshes of objects that reach into a room's box, with `fill` as in `shadow`."""
    rows = connection.exec_driver_sql(
        "SELECT e.id, NOT is_building_part(e.type) FROM entity e "
        "JOIN world w ON w.entity_id = e.id JOIN world r ON r.entity_id = %(id)s "
        "WHERE e.map_id = %(map)s AND e.kind = 'object' AND w.box &&& r.box ORDER BY e.id",
        {"id": room.id, "map": room.map_id},
    ).all()
    meshes = world_triangles(driver_of(connection), [entity for entity, _ in rows])
    return [(to_mesh(meshes[entity]), fill) for entity, fill in rows if entity in meshes]


def _surfaces(
    connection: Connection, owner: Owner, frame: Pose
) -> list[tuple[int, float, Polygon, list[int]]]:
    """Model, height, outline and faces of the surfaces level in `frame`, highest first."""
    models = _models(connection, owner)
    if not models:
        raise ValueError(f"{owner.name} has no triangles: import its mesh first")
    (most,) = connection.exec_driver_sql(
        "SELECT max(triangles) FROM model WHERE id = ANY(%(models)s)", {"models": models}
    ).one()
    SURFACE_TRIANGLES.check(
        most, lambda problem, fix: ValueError(f"{owner.name} {problem}. {fix}"), "Simplify it."
    )
    if frame is IDENTITY:
        find_surfaces(driver_of(connection), owner.map_id)
        rows = connection.exec_driver_sql(
            "SELECT model_id, height, ST_AsBinary(outline), faces FROM support_surface "
            "WHERE model_id = ANY(%(models)s) AND height IS NOT NULL "
            "ORDER BY height DESC, ST_Area(outline) DESC, model_id, number",
            {"models": models},
        )
        return [(model, h, shapely.from_wkb(bytes(o)), faces) for model, h, o, faces in rows]
    found = []
    for model in models:
        turned = to_mesh(model_triangles(driver_of(connection), model)).moved(frame.inverse())
        for s in support_surfaces(turned):
            found.append((model, s.height, s.outline, [int(face) for face in s.faces]))
    return sorted(found, key=lambda s: (-s[1], -s[2].area, s[0]))
