"""Map features as a file: GeoPackage or GeoJSON, as `semmap.ingest.annotation` reads them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from psycopg.rows import dict_row

from semmap.query.entity_shapes import geojson_feature, read_shapes
from semmap.query.snapshot import Snapshot

Feature = tuple[shapely.Geometry | None, dict[str, Any]]

_BASE = (
    "CROSS JOIN LATERAL (SELECT coalesce((SELECT b.pose[3] FROM world b JOIN entity s ON s.id = "
    "b.entity_id WHERE s.map_id = current_map() AND s.kind = 'storey' AND (s.name = v.storey OR "
    "v.storey IS NULL AND 1 = (SELECT count(*) FROM entity o WHERE o.map_id = s.map_id "
    "AND o.kind = 'storey'))), 0)) base (z)"
)
"""The height above which the file has the heights of a feature of the view `v`."""

_HOLDER = (
    "(SELECT h.name FROM placement p JOIN entity h ON h.id = p.holder_id WHERE p.entity_id = v.fid "
    "AND (p.confidence IS NULL OR e.kind = 'agent') AND h.kind IN ({}))"
)
"""The stated holder; a derived one is derived again, but not that of an agent."""

_HELD_BY_PLACES = _HOLDER.format("'room', 'storey'")
_HELD = _HOLDER.format("'room', 'storey', 'object'")

_VIEW = (
    "FROM {} v JOIN entity e ON e.id = v.fid LEFT JOIN world w ON w.entity_id = v.fid "
    f"{_BASE} WHERE v.map = (SELECT name FROM map WHERE id = current_map())"
)

LAYERS = {
    "storeys": "SELECT e.id AS fid, 'storey' AS kind, e.name, e.type, e.label, e.front, "
    "w.pose[3] AS elevation, s.height FROM storey s JOIN entity e ON e.id = s.entity_id "
    "LEFT JOIN world w ON w.entity_id = e.id WHERE e.map_id = current_map()",
    "elevators": "SELECT e.id AS fid, 'elevator' AS kind, e.name, e.type, e.label, e.front, "
    "pose_yaw(w.pose) AS heading FROM elevator l JOIN entity e ON e.id = l.entity_id "
    "LEFT JOIN world w ON w.entity_id = e.id WHERE e.map_id = current_map()",
    "rooms": "SELECT v.fid, 'room' AS kind, v.name, v.type, v.label, v.storey, e.front, "
    "(SELECT l.name FROM room r JOIN entity l ON l.id = r.elevator_id WHERE r.entity_id = v.fid) "
    "AS elevator, pose_yaw(w.pose) AS heading, w.pose[3] + v.floor - base.z AS floor, "
    f"w.pose[3] + v.ceiling - base.z AS ceiling {_VIEW.format('gis_room')}",
    "doors": "SELECT v.fid, 'connector' AS kind, v.name, CASE WHEN v.form = 'door' OR EXISTS ("
    "SELECT FROM type_closure t WHERE t.sub = v.type AND t.super = v.form) THEN v.type "
    "ELSE v.form END AS type, e.label, v.storey, e.front, v.place_a || ',' || v.place_b AS joins, "
    "v.direction, v.state, v.behaviour, v.width, v.height, v.step, NULLIF(v.permissions, '') "
    f"AS permissions, w.pose[3] - base.z AS floor {_VIEW.format('gis_connector')}",
    "regions": "SELECT v.fid, 'region' AS kind, v.name, v.type, v.label, v.storey, e.front, "
    f"{_HELD_BY_PLACES} AS holder, pose_yaw(w.pose) AS heading, v.low - base.z AS floor, "
    f"greatest(v.high, v.low + 1e-5) - base.z AS ceiling {_VIEW.format('gis_region')}",
    "objects": "SELECT v.fid, e.kind, v.name, v.type, v.label, v.storey, e.front, "
    f"{_HELD} AS holder, pose_yaw(w.pose) AS heading, v.low - base.z AS floor, "
    "CASE WHEN v.high - v.low > 1e-6 THEN v.high - v.low END AS height "
    f"{_VIEW.format('gis_object')}",
}
"""The layers of a file, each with the statement of its columns."""


def write_features(seen: Snapshot, path: Path) -> Path:
    """Write a map to a ``.gpkg`` or ``.geojson`` file; return its path."""
    writers = {".gpkg": _write_geopackage, ".geojson": _write_geojson}
    if path.suffix.lower() not in writers:
        known = " or ".join(writers)
        raise ValueError(f"{path.name}: a map is exported to {known}, not to {path.suffix!r}")
    layers = _layers(seen)
    made = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        writers[path.suffix.lower()](seen, made, layers)
        made.replace(path)
    finally:
        made.unlink(missing_ok=True)
    return path


def _layers(seen: Snapshot) -> dict[str, list[Feature]]:
    with seen.session.transaction(), seen.session.cursor(row_factory=dict_row) as cursor:
        shapes = {row["id"]: row for row in read_shapes(seen)}
        layers: dict[str, list[Feature]] = {}
        for layer, statement in LAYERS.items():
            for row in cursor.execute(f"{statement} ORDER BY 3").fetchall():
                shown = shapes[row.pop("fid")]
                kept = {k: v for k, v in row.items() if v is not None}
                drawn = shown["geometry"]
                if layer == "storeys" and isinstance(drawn, shapely.Point):
                    drawn = None  # a storey without an outline is not drawn
                layers.setdefault(layer, []).append((drawn, {**shown["properties"], **kept}))
    return layers


def _write_geojson(seen: Snapshot, path: Path, layers: dict[str, list[Feature]]) -> None:
    with seen.session.cursor(row_factory=dict_row) as cursor:
        georeference = cursor.execute(
            "SELECT crs, easting, northing, height, rotation FROM map WHERE id = current_map() "
            "AND crs IS NOT NULL"
        ).fetchone()
    every = [feature for features in layers.values() for feature in features]
    features = [geojson_feature(geometry, properties) for geometry, properties in every]
    collection: dict[str, Any] = {
        "type": "FeatureCollection",
        "name": seen.name,
        "features": features,
    }
    if georeference is not None:
        collection["georeference"] = georeference
    path.write_text(json.dumps(collection, ensure_ascii=False), encoding="utf-8")


def _write_geopackage(seen: Snapshot, path: Path, layers: dict[str, list[Feature]]) -> None:
    import warnings

    import pyogrio

    if not layers:
        raise ValueError(f"the map {seen.name} has no entities, and a GeoPackage has layers")
    for layer, features in layers.items():
        columns = list(dict.fromkeys(key for _, properties in features for key in properties))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a map's frame has no CRS
            pyogrio.raw.write(
                path,
                np.array([shapely.to_wkb(geometry) for geometry, _ in features], dtype=object),
                [_column([p.get(key) for _, p in features]) for key in columns],
                columns,
                field_mask=[np.array([p.get(key) is None for _, p in features]) for key in columns],
                layer=layer,
                driver="GPKG",
                geometry_type="Unknown",
                append=path.exists(),
                layer_options={"FID": "fid"},
            )


def _column(values: list[Any]) -> np.ndarray[Any, Any]:
    """The values of a column: numbers, truth values or text; anything else as JSON text."""
    given = [value for value in values if value is not None]
    for of_type, dtype, empty in ((bool, np.bool_, False), (int, np.int64, 0)):
        if all(type(value) is of_type for value in given):
            return np.array([empty if v is None else v for v in values], dtype=dtype)
    if all(type(value) in (int, float) for value in given):
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    texts = [v if isinstance(v, str | None) else json.dumps(v) for v in values]
    return np.array(texts, dtype=object)
