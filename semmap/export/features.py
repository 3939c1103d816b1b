"""A map as features, as `semmap.ingest.annotation` reads them: every format is written of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray
from psycopg.rows import dict_row

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.geometry.tin import to_mesh
from semmap.ingest.annotation.annotation import ROOM_HEIGHT
from semmap.ingest.annotation.draft_world import NESTED, USED_PROPERTIES
from semmap.ingest.georeference import out_of_frame
from semmap.ingest.world import unique_name
from semmap.query.entity_shapes import read_shapes
from semmap.query.meshes import models_points, models_triangles
from semmap.query.snapshot import Snapshot

_STOREYS = (
    "WITH floor AS MATERIALIZED (SELECT s.name, b.pose[3] AS z, count(*) OVER () AS number "
    "FROM entity s LEFT JOIN world b ON b.entity_id = s.id "
    "WHERE s.map_id = current_map() AND s.kind = 'storey')"
)
_BASE = (
    "LEFT JOIN floor ON floor.name = v.storey OR v.storey IS NULL AND floor.number = 1 "
    "CROSS JOIN LATERAL (SELECT coalesce(floor.z, 0)) base (z)"
)
"""The height above which the file has the heights of a feature of the view `v`."""

_OFF = "CASE WHEN v.storey IS NULL THEN base.z ELSE 0 END"
"""What is subtracted from heights above the storey, else above the map's origin."""

_HOLDER = (
    "(SELECT {} FROM placement p JOIN entity h ON h.id = p.holder_id WHERE p.entity_id = v.fid "
    "AND (p.confidence IS NULL OR e.kind = 'agent') AND h.kind IN ({}))"
)
"""The stated holder; a derived one is derived again, but not that of an agent."""

_HOLDERS = "'room', 'storey', 'object', 'agent'"
_HELD = _HOLDER.format("h.name", _HOLDERS)
_RELATION = _HOLDER.format("NULLIF(p.relation, 'in')", _HOLDERS)

_VIEW = (
    "FROM {} v JOIN entity e ON e.id = v.fid LEFT JOIN world w ON w.entity_id = v.fid "
    f"{_BASE} WHERE v.map = (SELECT name FROM map WHERE id = current_map())"
)


def _time(end: str) -> str:
    """When a region begins or ends to be valid; null where that is open."""
    at = f"{end}(r.valid) AT TIME ZONE 'UTC'"
    return (
        f"""(SELECT to_char({at}, 'YYYY-MM-DD"T"HH24:MI:SS.US"Z"') FROM region r """
        "WHERE r.entity_id = v.fid)"
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
    f"AS elevator, pose_yaw(w.pose) AS heading, v.floor - {_OFF} AS floor, "
    f"v.ceiling - {_OFF} AS ceiling, CASE WHEN v.ceiling IS NULL "
    f"THEN coalesce(ST_ZMax(w.box) - base.z, v.floor - {_OFF} + {ROOM_HEIGHT}) END AS top "
    f"{_VIEW.format('gis_room')}",
    "doors": "SELECT v.fid, 'connector' AS kind, v.name, CASE WHEN v.form = 'door' OR EXISTS ("
    "SELECT FROM type_closure t WHERE t.sub = v.type AND t.super = v.form) THEN v.type "
    "ELSE v.form END AS type, e.label, v.storey, e.front, ARRAY[v.place_a, v.place_b] AS joins, "
    "pose_yaw(w.pose) AS heading, v.direction, v.state, v.behaviour, v.width, v.height, v.step, "
    "(SELECT NULLIF(c.permissions, '{}') FROM connector c WHERE c.entity_id = v.fid) "
    "AS permissions, (SELECT c.pose_b[3] - c.pose_a[3] FROM connector c WHERE c.entity_id = v.fid "
    "AND c.form IN ('stairs', 'ramp')) AS rise, "
    f"w.pose[3] - base.z AS floor {_VIEW.format('gis_connector')}",
    "regions": "SELECT v.fid, 'region' AS kind, v.name, v.type, v.label, v.storey, e.front, "
    f"{_HELD} AS holder, pose_yaw(w.pose) AS heading, v.low - base.z AS floor, "
    f"greatest(v.high, v.low + 1e-5) - base.z AS ceiling, {_time('lower')} AS valid_from, "
    f"{_time('upper')} AS valid_until {_VIEW.format('gis_region')}",
    "objects": "SELECT v.fid, e.kind, v.name, v.type, v.label, v.storey, e.front, "
    f"{_HELD} AS holder, {_RELATION} AS relation, pose_yaw(w.pose) AS heading, "
    "v.low - base.z AS floor, CASE WHEN v.high - v.low > 1e-6 THEN v.high - v.low END AS height, "
    f"base.z AS base {_VIEW.format('gis_object')}",
}
"""The layers of a file, each with the statement of its columns."""

_MODELS = (
    "SELECT e.id, e.name, w.pose, array_agg(m.id ORDER BY m.id) AS models, "
    "bool_or(m.kind = 'cloud') AS cloud, "
    "count(*) > 1 OR bool_or(m.kind NOT IN ('box', 'polygon')) AS meshed "
    "FROM entity e JOIN world w ON w.entity_id = e.id JOIN entity_model em ON em.entity_id = e.id "
    "JOIN model m ON m.id = em.model_id WHERE e.map_id = current_map() "
    "AND e.kind IN ('object', 'agent') AND (m.triangles > 0 OR m.kind = 'cloud') "
    "GROUP BY e.id, w.pose ORDER BY e.name"
)

SAME = 1e-9
"""Metres, and lengths of quaternions, below which a pose is none."""


@dataclass(frozen=True)
class MapFeature:
    """An entity: its geometry, the keys that its kind has, and its free properties.

    `pose` is that of its frame in the map's frame, `holder` what holds it, derived or not.
    """

    geometry: shapely.Geometry | None
    keys: dict[str, Any]
    free: dict[str, Any]
    pose: Pose | None = None
    holder: str | None = None

    @property
    def name(self) -> str:
        """The name of the entity."""
        return str(self.keys["name"])

    @property
    def places(self) -> list[str]:
        """The two places that a door joins."""
        given = self.keys["joins"]
        return given.split(",") if isinstance(given, str) else given

    @property
    def properties(self) -> dict[str, Any]:
        """Keys and free properties; those under a name that has a meaning are nested."""
        taken = {*USED_PROPERTIES[self.keys["kind"]], *self.keys, NESTED}
        plain = {k: v for k, v in self.free.items() if k not in taken and not _changes(v)}
        rest = {k: v for k, v in self.free.items() if k not in plain}
        return {**plain, **self.keys, **({NESTED: rest} if rest else {})}


def _changes(value: Any) -> bool:
    """Return whether a property is not read as it is: null, or text that could be JSON."""
    return value is None or (isinstance(value, str) and value[:1] in ("{", "["))


@dataclass
class MapFeatures:
    """A map: its features by layer, its meshes by the paths that features name.

    `lanes` lead from region to region, with properties. Coordinates are metres of the map's frame,
    or of the `crs`, x or longitude first.
    """

    name: str
    layers: dict[str, list[MapFeature]] = field(default_factory=dict)
    meshes: dict[str, Mesh] = field(default_factory=dict)  # points, if it has no faces
    lanes: list[tuple[str, str, dict[str, Any]]] = field(default_factory=list)
    georeference: dict[str, float] | None = None
    crs: str | None = None

    def all(self, *layers: str) -> list[MapFeature]:
        """The features of some layers, by default of all."""
        return [each for name in layers or self.layers for each in self.layers.get(name, ())]

    def floor_of(self, each: MapFeature) -> float:
        """Return the height of a feature's floor, metres above the map's origin."""
        storeys = {s.name: s.keys.get("elevation", 0.0) for s in self.all("storeys")}
        alone = next(iter(storeys)) if len(storeys) == 1 else ""
        below = storeys.get(str(each.keys.get("storey", alone)), 0.0)
        return float(below + each.keys.get("floor", 0.0))

    def write_meshes(self, path: Path) -> None:
        """Write the meshes beside a file: OBJ, and PLY of point clouds."""
        for name, mesh in self.meshes.items():
            file = path.parent / name
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(_obj(mesh) if len(mesh.faces) else _ply(mesh))


def _obj(mesh: Mesh) -> bytes:
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return str(made.export(file_type="obj", digits=12, header=None)).encode()


def _ply(points: Mesh) -> bytes:
    """Points as PLY, in double precision, which trimesh reads but does not write."""
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points.vertices)}\n{axes}"
    return f"{head}end_header\n".encode() + points.vertices.astype("<f8").tobytes()


def read_map(
    seen: Snapshot, *, folder: str | None = None, boxes: bool = False, crs: Any = None
) -> MapFeatures:
    """Return the features of a map.

    Parameters
    ----------
    folder : of meshes beside the file; without one, objects are the prisms of their footprints
    boxes : whether boxes and prisms have meshes, too
    crs : of the coordinates; by default the map's frame

    Raises
    ------
    ValueError
        `crs` is unknown, or the map has no georeference.
    """
    found = MapFeatures(seen.name)
    with seen.session.transaction(), seen.session.cursor(row_factory=dict_row) as cursor:
        found.georeference = cursor.execute(
            "SELECT crs, easting, northing, height, rotation FROM map WHERE id = current_map() "
            "AND crs IS NOT NULL"
        ).fetchone()
        crs = _known_crs(found, crs)
        shapes = {row["id"]: row for row in read_shapes(seen)}
        found.lanes = cursor.connection.execute(_LANES).fetchall()
        placed = dict(cursor.connection.execute(_POSES).fetchall())
        meshes = {}
        if folder is not None:
            meshes = read_meshes(seen, found, folder, boxes)
        for layer, statement in LAYERS.items():
            for row in cursor.execute(f"{_STOREYS} {statement} ORDER BY 3").fetchall():
                number = row.pop("fid")
                shown, base = shapes[number], row.pop("base", None)
                keys = {k: v for k, v in row.items() if v is not None}
                for key in ("joins", "permissions"):
                    if key in keys and not any("," in each for each in keys[key]):
                        keys[key] = ",".join(keys[key])
                drawn = shown["geometry"]
                if layer == "storeys" and isinstance(drawn, shapely.Point):
                    drawn = None  # a storey without an outline is not drawn
                pose = Pose(*placed[number]) if number in placed else None
                if number in meshes:
                    keys["mesh"] = meshes[number]
                if base is not None and pose is not None:
                    keys |= _own_frame(drawn, keys, pose, base)
                feature = MapFeature(drawn, keys, shown["properties"], pose, shown["holder"])
                found.layers.setdefault(layer, []).append(feature)
    return found if crs is None else _on_earth(found, crs)


_LANES = (
    "SELECT a.name, b.name, l.properties FROM link l JOIN entity a ON a.id = l.from_id "
    "JOIN entity b ON b.id = l.to_id WHERE a.map_id = current_map() AND l.relation = 'lane' "
    "ORDER BY a.name, b.name"
)
"""The lanes that Open-RMF drew, from region to region."""

_POSES = "SELECT entity_id, pose FROM world WHERE map_id = current_map()"


def _own_frame(
    drawn: shapely.Geometry, keys: Mapping[str, Any], pose: Pose, base: float
) -> dict[str, Any]:
    """Return the key `pose` of a frame that is not at the centroid of a drawing, at its floor."""
    middle = drawn.centroid
    level = Pose.planar(middle.x, middle.y, keys["heading"], base + keys["floor"])
    own = level.inverse() @ pose
    tilted = math.hypot(own.qx, own.qy) > SAME
    if max(map(abs, own[:6])) < SAME or (tilted and drawn.area > 0 and "mesh" not in keys):
        return {}
    return {"pose": list(own)}


def read_meshes(seen: Snapshot, found: MapFeatures, folder: str, boxes: bool) -> dict[int, str]:
    """Add the meshes of objects to a map, each once; return the paths by the ids of objects."""
    with seen.session.cursor(row_factory=dict_row) as cursor:
        rows = [
            row
            for row in cursor.execute(_MODELS).fetchall()
            if boxes or row["meshed"] or np.hypot(*row["pose"][3:5]) > SAME
        ]
    ids = {model for row in rows for model in row["models"]}
    triangles, points = models_triangles(seen.session, ids), models_points(seen.session, ids)
    taken: set[str] = set()
    by_models: dict[tuple[int, ...], str] = {}
    for row in rows:
        key = tuple(row["models"])
        if key not in by_models:
            parts = [triangles[model] for model in key if model in triangles]
            clouds = [points[model] for model in key if model in points]
            mesh = (
                to_mesh(np.concatenate(parts))
                if parts
                else Mesh(np.concatenate(clouds), np.empty((0, 3), np.int32))
            )
            plain = f"{folder}/{_FILE.sub('_', row['name'])[:80]}"
            name = unique_name(plain, taken)
            taken.add(name)
            by_models[key] = name + (".obj" if parts else ".ply")
            found.meshes[by_models[key]] = mesh
    return {row["id"]: by_models[tuple(row["models"])] for row in rows}


_FILE = re.compile(r"[^A-Za-z0-9_-]")
"""What a name of a file does not have."""


def _known_crs(found: MapFeatures, crs: Any) -> str | None:
    """Return the name of a CRS; a ValueError refuses one that is unknown or has no place."""
    if crs is None:
        return None
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        code = CRS.from_user_input(crs)
    except CRSError:
        raise ValueError(
            f"crs is {crs!r}: give an EPSG code such as 4326 or 'EPSG:32632'"
        ) from None
    if found.georeference is None:
        raise ValueError(
            f"the map {found.name} has no georeference, so it has no coordinates in a CRS: import "
            "a file that has one, or leave out crs"
        )
    return str(code.to_string())


def _on_earth(found: MapFeatures, crs: str) -> MapFeatures:
    """Return a map in the coordinates of a CRS; headings are counted from the grid's east."""
    frame = found.georeference
    assert frame is not None

    def moved(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return out_of_frame(points, crs, frame)

    for layer, features in found.layers.items():
        found.layers[layer] = [
            replace(
                each,
                geometry=each.geometry and shapely.transform(each.geometry, moved),
                keys={
                    k: v + frame["rotation"] if k == "heading" else v for k, v in each.keys.items()
                },
            )
            for each in features
        ]
    found.crs = crs
    return found
