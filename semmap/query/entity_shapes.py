"""The shapes of entities: outlines and lines in the map's frame, boxes, meshes, GeoJSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from psycopg.rows import dict_row

from semmap.geometry.pose import Pose
from semmap.query.entity_query import PLACED
from semmap.query.meshes import models_triangles
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    import trimesh


OPENING = (
    "SELECT pose_compose(w.pose, CASE WHEN posts THEN planar_pose(0, -c.width / 2) ELSE c.pose_a "
    "END), pose_compose(w.pose, CASE WHEN posts THEN planar_pose(0, c.width / 2) ELSE c.pose_b END)"
    " FROM (SELECT c.form IN ('door', 'elevator_door') AND c.width IS NOT NULL) t (posts)"
)
"""The ends of a connector: of its opening, from post to post; of stairs and ramps, of the way."""


SHAPE = (
    "CASE WHEN c.entity_id IS NOT NULL THEN ST_MakeLine("
    "ST_MakePoint(first[1], first[2]), ST_MakePoint(second[1], second[2])) "
    "ELSE coalesce(w.footprint, ST_MakePoint(w.pose[1], w.pose[2])) END"
)
"""What a GIS shows of an entity, see `read_shapes`; of the rows of `SHAPED`."""

SHAPED = (
    f"{PLACED} LEFT JOIN connector c ON c.entity_id = e.id "
    f"LEFT JOIN LATERAL ({OPENING}) l (first, second) ON c.entity_id IS NOT NULL"
)


def read_shapes(seen: Snapshot, ids: Sequence[int] | None = None) -> list[dict[str, Any]]:
    """What a GIS shows of entities, of all in the map where `ids` is None, by kind and name.

    Rows with `id`, `name`, `kind`, `type`, `label`, `holder`, `storey`, `low` and `high` (metres in
    the map's frame), `state` (of a door), `properties` and `geometry`, in 2D in the map's frame:
    the outline (Polygon, or MultiPolygon of several parts); the line of a door's opening, or along
    stairs and ramps; else the point of its pose; None without a placement.
    """
    with seen.session.cursor(row_factory=dict_row) as cursor:
        rows = cursor.execute(
            "SELECT e.id, e.name, e.kind, e.type, e.label, h.name AS holder, s.name AS storey, "
            "ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high, c.state, e.properties, "
            f"ST_AsBinary({SHAPE}) AS geometry FROM {SHAPED} "
            "WHERE e.map_id = current_map() AND (%(ids)s::bigint[] IS NULL OR e.id = ANY (%(ids)s))"
            " ORDER BY e.kind, e.name",
            {"ids": None if ids is None else [*ids]},
        ).fetchall()
    for row in rows:
        row["geometry"] = _geometry(row["geometry"])
    return rows


def _geometry(wkb: bytes | None) -> shapely.Geometry | None:
    """The geometry of WKB; a MultiPolygon of one part as a Polygon."""
    if wkb is None:
        return None
    made = shapely.from_wkb(bytes(wkb))
    if isinstance(made, shapely.MultiPolygon) and len(made.geoms) == 1:
        made = made.geoms[0]
    return None if made.is_empty else made


def read_footprint(seen: Snapshot, entity: int) -> shapely.Polygon | shapely.MultiPolygon | None:
    """The ground that an entity covers, in the map's frame; None without geometry."""
    row = seen.session.execute(
        "SELECT ST_AsBinary(footprint) FROM world WHERE entity_id = %s", (entity,)
    ).fetchone()
    return _geometry(row[0]) if row else None


def read_box(seen: Snapshot, entity: int) -> tuple[float, ...] | None:
    """(x0, y0, z0, x1, y1, z1) in the map's frame; None without a placement."""
    row = seen.session.execute(
        "SELECT ST_XMin(box), ST_YMin(box), ST_ZMin(box), ST_XMax(box), ST_YMax(box), ST_ZMax(box) "
        "FROM world WHERE entity_id = %s",
        (entity,),
    ).fetchone()
    return None if row is None else tuple(row)


def read_size(seen: Snapshot, entity: int) -> tuple[float, float, float] | None:
    """The extents (x, y, z) of an entity in its own frame, metres; None without geometry."""
    return seen.session.execute(
        "SELECT ST_XMax(b) - ST_XMin(b), ST_YMax(b) - ST_YMin(b), ST_ZMax(b) - ST_ZMin(b) "
        "FROM (SELECT ST_3DExtent(m.hull) FROM entity_model em JOIN model m ON m.id = em.model_id "
        "WHERE em.entity_id = %s) t (b) WHERE b IS NOT NULL",
        (entity,),
    ).fetchone()


def read_mesh(seen: Snapshot, entity: int) -> trimesh.Trimesh | None:
    """The triangles of an entity in the map's frame; of a region that is a part, those faces."""
    import trimesh

    rows = seen.session.execute(
        "SELECT DISTINCT c.model_id, NULL::integer[], w.pose FROM entity_chunk ec "
        "JOIN chunk c ON c.id = ec.chunk_id JOIN model m ON m.id = c.model_id AND m.triangles > 0 "
        "JOIN world w ON w.entity_id = ec.entity_id WHERE ec.entity_id = %(id)s "
        "UNION ALL SELECT r.model_id, r.faces, w.pose FROM region r "
        "JOIN world w ON w.entity_id = coalesce(r.of_id, r.entity_id) "
        "WHERE r.entity_id = %(id)s AND r.model_id IS NOT NULL ORDER BY 1",
        {"id": entity},
    ).fetchall()
    if not rows:
        return None
    models = models_triangles(seen.session, {model for model, _, _ in rows})
    parts = [
        Pose(*pose).apply((models[model] if faces is None else models[model][faces]).reshape(-1, 3))
        for model, faces, pose in rows
    ]
    corners = np.concatenate(parts)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))


def geojson_feature(
    geometry: shapely.Geometry | None, properties: Mapping[str, Any]
) -> dict[str, Any]:
    """A GeoJSON Feature (RFC 7946, but metres in the map's frame)."""
    shown = None if geometry is None else shapely.geometry.mapping(geometry)
    return {"type": "Feature", "geometry": shown, "properties": properties}


def feature(row: Mapping[str, Any]) -> dict[str, Any]:
    """The Feature of a row of `read_shapes`; free properties come along."""
    shown = {k: v for k, v in row.items() if k not in ("id", "geometry", "properties")}
    if row["kind"] != "connector":
        del shown["state"]
    made = geojson_feature(row["geometry"], {**row["properties"], **shown}) | {"id": row["id"]}
    return made if row["geometry"] is None else made | {"bbox": row["geometry"].bounds}


def feature_collection(rows: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The FeatureCollection of rows of `read_shapes`."""
    return {"type": "FeatureCollection", "features": [feature(row) for row in rows]}
