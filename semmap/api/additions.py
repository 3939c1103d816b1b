"""What is added to a map by hand: entries for the store, from arguments as a person gives them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from semmap.geometry.mesh import Mesh, box_mesh, prism_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.store.holder_store import find_surfaces
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import (
    OUTSIDE,
    ConnectorDetail,
    Entry,
    Kind,
    PlaceDetail,
    Shape,
    StoreyDetail,
    World,
)

if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.api.map_entity import MapEntity

__all__ = ["DoorShape", "add_entry", "door", "region", "room", "spot", "storey", "thing"]

ROOM_HEIGHT = 2.5
"""Metres, where a room has no ceiling."""

REGION_HEIGHT = 0.01

SIDE = 0.05
"""Metres before and behind a door's line where its places are looked for."""


def storey(name: str, elevation: float, height: float | None) -> Entry:
    """A storey; its frame lies at its floor."""
    return Entry(name, "storey", pose=Pose(z=elevation), detail=StoreyDetail(elevation, height))


def room(
    name: str,
    outline: Any,
    floor: float,
    ceiling: float | None,
    type: str | None,
    label: str | None,
) -> Entry:
    """A room, its frame at a point in it on the floor."""
    place = PlaceDetail(0.0, None if ceiling is None else ceiling - floor)
    return _drawn(name, "room", outline, floor, ceiling, ROOM_HEIGHT, type, label, place)


def region(
    name: str,
    outline: Any,
    floor: float,
    ceiling: float | None,
    type: str | None,
    label: str | None,
) -> Entry:
    """A region, its frame at a point in it."""
    return _drawn(name, "region", outline, floor, ceiling, REGION_HEIGHT, type, label, None)


def _drawn(
    name: str,
    kind: Kind,
    outline: Any,
    floor: float,
    ceiling: float | None,
    height: float,
    type: str | None,
    label: str | None,
    detail: PlaceDetail | None,
) -> Entry:
    polygon = outline if isinstance(outline, shapely.Geometry) else shapely.Polygon(outline)
    if polygon.geom_type not in ("Polygon", "MultiPolygon") or polygon.is_empty:
        raise ValueError(f"the outline of {name} is a {polygon.geom_type}, not a polygon")
    if not polygon.is_valid or polygon.area == 0:
        raise ValueError(f"the outline of {name} is not valid: {shapely.is_valid_reason(polygon)}")
    top = floor + height if ceiling is None else ceiling
    if not (math.isfinite(floor) and math.isfinite(top) and top > floor):
        raise ValueError(f"the ceiling of {name} ({ceiling} m) is not above its floor ({floor} m)")
    point = polygon.representative_point()
    local = shapely.transform(shapely.force_2d(polygon), lambda xy: xy - [point.x, point.y])
    shape = Shape("polygon", prism_mesh(local, 0.0, top - floor), outline=local)
    pose = Pose(float(point.x), float(point.y), floor)
    return Entry(name, kind, type=type, label=label, pose=pose, shapes=[shape], detail=detail)


def thing(
    name: str,
    kind: Kind,
    type: str | None,
    mesh: Any,
    size: Sequence[float] | None,
    pose: Sequence[float] | None,
    label: str | None,
    properties: Mapping[str, Any] | None,
) -> Entry:
    """An object or agent with its geometry; `pose` None: its place follows from its holder."""
    if mesh is not None and size is not None:
        raise ValueError(f"{name} has a mesh or a size, not both")
    shapes = []
    if size is not None:
        x, y, z = (float(v) for v in size)
        if not (min(x, y, z) > 0 and math.isfinite(x + y + z)):
            raise ValueError(f"the size of {name} is three lengths above 0, not {tuple(size)}")
        shapes = [Shape("box", box_mesh((-x / 2, -y / 2, 0), (x / 2, y / 2, z)))]
    elif mesh is not None:
        shapes = _shapes(mesh)
    where = None
    if pose is not None:
        numbers = [float(v) for v in pose]
        if len(numbers) not in (3, 4) or not all(map(math.isfinite, numbers)):
            raise ValueError(f"the pose of {name} is (x, y, z, yaw), finite, not {tuple(pose)}")
        yaw = numbers[3] if len(numbers) == 4 else 0.0
        where = Pose.planar(numbers[0], numbers[1], yaw, numbers[2])
    return Entry(
        name,
        kind,
        type=type,
        label=label,
        pose=where,
        shapes=shapes,
        properties=dict(properties or {}),
    )


def _shapes(mesh: Any) -> list[Shape]:
    if isinstance(mesh, Mesh):
        return [Shape("mesh", mesh)]
    if isinstance(mesh, str | Path):
        from semmap.ingest.meshes.mesh_file import read_mesh_world

        entries = read_mesh_world(Path(mesh), as_="object").entries
        return [shape for entry in entries for shape in entry.shapes]
    vertices = np.asarray(mesh.vertices, dtype=float)
    return [Shape("mesh", Mesh(vertices, np.asarray(mesh.faces, dtype=np.int32)))]


@dataclass(frozen=True)
class DoorShape:
    """The geometry of a connector, in the map's frame: metres, and two points (x, y).

    `width` None: the length of the line.
    """

    line: Sequence[Sequence[float]]
    width: float | None
    height: float
    clearance: float


def door(
    name: str,
    place_a: str,
    place_b: str | None,
    shape: DoorShape,
    distances: Sequence[Callable[[float, float], float]],
    form: Any,
    direction: Any,
    state: Any,
) -> Entry:
    """A connector; `distances` are those of a point to its places, in their order."""
    ends = np.asarray(shape.line, dtype=float)
    if ends.shape != (2, 2) or not np.isfinite(ends).all() or np.allclose(ends[0], ends[1]):
        raise ValueError(f"the line of {name} is two points (x, y), not {shape.line}")
    along = ends[1] - ends[0]
    length = float(np.hypot(*along))
    normal = np.array([along[1], -along[0]]) / length
    middle = ends.mean(axis=0)
    sides = [_nearer(distance, middle, normal) for distance in distances]
    if sides[0] > 0 or (sides[0] == 0 and sides[1:] == [-1]):
        normal = -normal  # x of the connector's frame points from place_a to place_b
    yaw = math.atan2(normal[1], normal[0])
    reach = shape.clearance + SIDE
    return Entry(
        name,
        "connector",
        pose=Pose.planar(float(middle[0]), float(middle[1]), yaw, shape.height),
        detail=ConnectorDetail(
            (place_a, OUTSIDE if place_b is None else place_b),
            (Pose(-reach), Pose.planar(reach, 0, math.pi)),
            type=form,
            direction=direction,
            state=state,
            width=length if shape.width is None else shape.width,
        ),
    )


def _nearer(distance: Callable[[float, float], float], middle: Any, normal: Any) -> int:
    """1 if the place is on the side to which `normal` points, -1 if on the other, 0 if on both."""
    ahead, behind = middle + SIDE * normal, middle - SIDE * normal
    return int(np.sign(distance(*map(float, behind)) - distance(*map(float, ahead))))


def spot(map: Map, holder: MapEntity, relation: str) -> tuple[float, float, float]:
    """A point on the highest surface of a holder, or on its floor; metres, map frame."""
    if relation == "on":
        rows = map.execute(
            "SELECT ST_X(p), ST_Y(p), z FROM (SELECT ST_PointOnSurface(ST_Force2D(pose_apply("
            "ST_Force3D(s.outline), w.pose))) AS p, w.pose[3] + s.height AS z, s.height, "
            "ST_Area(s.outline) AS area FROM entity_model em JOIN support_surface s "
            "ON s.model_id = em.model_id JOIN world w ON w.entity_id = em.entity_id "
            "WHERE em.entity_id = %s AND s.height IS NOT NULL) t "
            "ORDER BY z DESC, area DESC LIMIT 1",
            holder.id,
        )
        if rows:
            return rows[0]
    rows = map.execute(
        "SELECT ST_X(p), ST_Y(p), CASE WHEN %s = 'on' THEN ST_ZMax(w.box) "
        "ELSE coalesce(w.pose[3] + r.floor, ST_ZMin(w.box)) END "
        "FROM world w LEFT JOIN room r ON r.entity_id = w.entity_id, "
        "LATERAL (SELECT ST_PointOnSurface(w.footprint)) t (p) "
        "WHERE w.entity_id = %s AND w.footprint IS NOT NULL",
        relation,
        holder.id,
    )
    if not rows:
        raise ValueError(f"{holder.name} has no geometry: give a pose")
    return rows[0]


def add_entry(
    map: Map,
    entry: Entry,
    *,
    on: str | None = None,
    in_: str | None = None,
    storey: str | None = None,
) -> MapEntity:
    """Store one entry, and state its holder where one is given; all of it or nothing."""
    if not entry.name:
        raise ValueError(f"the {entry.kind} needs a name")
    if on is not None and in_ is not None:
        raise ValueError(f"{entry.name} is on {on} or in {in_}, not both")
    if entry.name in map:
        raise ValueError(f"the map has an entity {entry.name} already")
    stated = on if on is not None else in_
    relation = "in" if on is None else "on"
    holder = map[stated] if stated is not None else None
    if holder is not None and entry.pose is None:
        x, y, z = map.spot(holder, relation)
        low = min((float(s.mesh.bounds[0, 2]) for s in entry.shapes if s.mesh), default=0.0)
        entry.pose = Pose(float(x), float(y), float(z) - low)
    with map.transaction():
        map_id = map.execute("SELECT current_map()")[0][0]
        session = map.connection
        store_world(session, map_id, World(map.name, Path(), [entry]))
        made = map[entry.name]
        find_surfaces(session, map_id, made.id)
        if entry.kind in ("object", "agent", "room", "region") and entry.pose is not None:
            if holder is not None:
                map.execute("SELECT put(%s, %s, %s)", made.id, holder.id, relation)
            elif entry.kind in ("room", "region"):
                _into_storey(map, made, storey)
    return made


def _into_storey(map: Map, made: MapEntity, storey: str | None) -> None:
    """A room or region is held by the storey that is named, else the one on whose floor it is."""
    if storey is not None:
        below = map[storey].id
    else:
        rows = map.execute(
            "SELECT s.entity_id FROM storey s JOIN world w ON w.entity_id = s.entity_id "
            "JOIN world r ON r.entity_id = %s WHERE w.map_id = r.map_id "
            "AND w.pose[3] <= ST_ZMin(r.box) + 0.5 ORDER BY w.pose[3] DESC LIMIT 1",
            made.id,
        )
        if not rows:
            return
        below = rows[0][0]
    map.execute("SELECT put(%s, %s)", made.id, below)
