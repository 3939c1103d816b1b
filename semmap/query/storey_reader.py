"""Read the contents of storeys: the one reader for pictures, grids and fields.

A storey contains what reaches into its heights, whichever storey its holder is on: a shelf through
the ceiling is an obstacle above. A map without storeys is one storey that has the map's name.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy import text

from semmap.geometry.floor_level import floor_level
from semmap.geometry.mesh import box_mesh
from semmap.geometry.overlay import united
from semmap.geometry.pose import Pose
from semmap.geometry.voxels import Voxels
from semmap.query.meshes import models_points, models_triangles
from semmap.query.outline_walls import with_outline_walls
from semmap.query.snapshot import Snapshot
from semmap.query.storey_scene import (
    FRAME,
    IN_OPENING,
    NO_TRIANGLES,
    Bounds,
    EntityKind,
    FloorArea,
    SceneEntity,
    StoreyScene,
)
from semmap.query.supertypes import read_supertypes
from semmap.suggestions import suggestion

BELOW, TOP = 0.5, 3.0
"""Metres below a storey's floor, and above the floor of the highest one, that belong to it."""

LEAF = (0.05, 2.1)
"""Thickness and height, metres, of a shut door without a mesh."""

ROOM_HEIGHT, DOOR_WIDTH = 2.5, 0.9
"""Metres, where the map knows none."""

LANDING = 0.05
"""Metres by which the floor of a room is above the foot of a way to it, and from it to the way."""

FLAT = 0.1
"""Metres; what is lower has no height of its own."""

VOXEL_SIZE = 0.05
"""Metres of the voxels of point clouds."""

FLOOR_TYPES = ("floor", "ground")
"""Entities of these types carry the floor of a storey without rooms."""

_STOREYS = """
SELECT e.name, e.id, s.elevation, s.elevation - :below AS low, coalesce(min(s.elevation) OVER (
    ORDER BY s.elevation GROUPS BETWEEN 1 FOLLOWING AND UNBOUNDED FOLLOWING
), s.elevation + :top) AS high
FROM storey s JOIN entity e ON e.id = s.entity_id
WHERE e.map_id = current_map() ORDER BY s.elevation, e.id
"""

CARRIED = """WITH RECURSIVE carried (id) AS (
    SELECT p.entity_id FROM placement p JOIN entity a ON a.id = p.holder_id AND a.kind = 'agent'
    WHERE a.map_id = current_map()
    UNION SELECT p.entity_id FROM carried c JOIN placement p ON p.holder_id = c.id
)"""
"""What agents carry, for a statement that follows."""

_ENTITIES = f"""
{CARRIED}
SELECT e.id, e.name, e.kind, coalesce(e.type, e.kind) AS type, e.label, e.properties, e.front,
       w.pose, w.storey_id, h.name AS storey, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
       ST_AsBinary(w.footprint) AS footprint, e.id IN (SELECT id FROM carried) AS carried,
       r.floor, r.ceiling, c.form, coalesce(c.state, leaf.state) AS state, c.width,
       c.pose_a, c.pose_b, lower(g.valid) AS since, upper(g.valid) AS until,
       CASE WHEN e.kind = ANY(:meshed) THEN
       (SELECT array_agg(em.model_id ORDER BY em.model_id) FROM entity_model em
        JOIN model m ON m.id = em.model_id
        WHERE em.entity_id = e.id AND m.triangles > 0
          AND NOT (e.kind = 'room' AND m.kind = 'polygon')
          AND (em.role = 'visual' OR NOT EXISTS (SELECT FROM entity_model v
               WHERE v.entity_id = e.id AND v.role = 'visual'))) END AS models,
       CASE WHEN e.kind = ANY(:clouded) THEN
       (SELECT array_agg(em.model_id ORDER BY em.model_id) FROM entity_model em
        JOIN model m ON m.id = em.model_id
        WHERE em.entity_id = e.id AND m.kind = 'cloud') END AS clouds
FROM world w JOIN entity e ON e.id = w.entity_id
     LEFT JOIN entity h ON h.id = w.storey_id
     LEFT JOIN connector c ON c.entity_id = e.id LEFT JOIN room r ON r.entity_id = e.id
     LEFT JOIN region g ON g.entity_id = e.id
     LEFT JOIN LATERAL (
         SELECT d.state FROM connector d JOIN world o ON o.entity_id = d.entity_id
         CROSS JOIN ST_Buffer(opening_of(o.pose, coalesce(d.width, :door) + 2 * :frame), :frame,
                              'endcap=flat') AS across
         WHERE e.kind = 'object' AND d.form IN ('door', 'elevator_door') AND o.map_id = w.map_id
           AND e.type IN (SELECT sub FROM type_closure WHERE super IN ('door', 'door_leaf'))
           AND across && w.footprint AND ground_share(w.footprint, across) >= :in_opening
           AND ST_ZMin(w.box) <= o.pose[3] + :frame AND ST_ZMax(w.box) > o.pose[3] + :frame
         ORDER BY ground_share(w.footprint, across) DESC, d.entity_id LIMIT 1) leaf ON true
WHERE e.map_id = current_map() AND e.kind = ANY(:kinds)
"""

_ON_STOREY = """
  AND CASE WHEN e.kind IN ('room', 'region') AND CAST(:storey AS bigint) IS NOT NULL
      THEN coalesce(w.storey_id = :storey, ST_ZMin(w.box) < :high AND ST_ZMax(w.box) >= :low)
      ELSE ST_ZMin(w.box) < :high AND ST_ZMax(w.box) >= :low END
"""

_IN_BOUNDS = "  AND w.box && ST_MakeEnvelope(:x0, :y0, :x1, :y1)\n"

_OF_TYPES = """
  AND EXISTS (SELECT FROM type_closure t WHERE t.sub = coalesce(e.type, e.kind)
              AND t.super = ANY(:types))
"""

OBJECTS: tuple[EntityKind, ...] = ("object",)
_KINDS: tuple[EntityKind, ...] = ("room", "object", "region", "connector", "agent")
_MESHED: tuple[EntityKind, ...] = ("room", "object", "connector")


def read_storey_names(seen: Snapshot) -> list[str]:
    """Return the names of the map's storeys, the lowest first; its own where it has none."""
    return [storey.name for storey in _storeys(seen)]


def read_scene(
    seen: Snapshot,
    storey: str,
    *,
    bounds: Bounds | None = None,
    rooms: Sequence[str] | None = None,
    margin: float = 0.0,
    moment: datetime | None = None,
    voxels: Mapping[int, Voxels] | None = None,
    assume_sizes: bool = False,
) -> StoreyScene:
    """Return what stands on a storey, or on a part of it; not what agents carry and move.

    Parameters
    ----------
    bounds : (x0, y0, x1, y1), metres: only what is in or near this rectangle
    rooms : only these rooms, their doorways and what is in or near them
    margin : metres around bounds or rooms that are read as well
    moment : leave out regions that do not hold then
    voxels : by id, the geometry of objects, walls of rooms and doors, in place of all meshes
    assume_sizes : give objects without geometry a typical box for their type

    Raises
    ------
    LookupError
        There is no such storey, or it has no such room.
    """
    reading = _Reading(seen, moment=moment, voxels=voxels, assume_sizes=assume_sizes)
    level = _with_floor(reading, storey)
    where, values = _ON_STOREY, level.values
    if rooms is not None:
        bounds = _bounds_of_rooms(seen, rooms, level, bounds)
    if bounds is not None:
        x0, y0, x1, y1 = bounds
        where += _IN_BOUNDS
        values |= {"x0": x0 - margin, "y0": y0 - margin, "x1": x1 + margin, "y1": y1 + margin}
    entities = tuple(e for e in reading.entities(where, values) if not e.carried)
    floors = _floor_areas(entities, rooms)
    known = None if bounds is None else (x0 - margin, y0 - margin, x1 + margin, y1 + margin)
    entities = with_outline_walls(entities, floors, known)
    return StoreyScene(storey, level.elevation, entities, floors, level.band)


def read_storeys(
    seen: Snapshot,
    storey: str | None = None,
    *,
    moment: datetime | None = None,
    voxels: Mapping[int, Voxels] | None = None,
    assume_sizes: bool = False,
) -> list[StoreyScene]:
    """Return the storeys of the map with their contents, the lowest first, or only one of them.

    Each mesh is read once, on however many storeys it shows. The parameters are those of
    `read_scene`.

    Raises
    ------
    LookupError
        There is no map, it is empty, or it has no storey of that name.
    """
    stated = _storeys(seen)
    if storey is not None:
        _find(storey, stated)
    if not seen.connection.execute(
        text("SELECT EXISTS (SELECT FROM entity WHERE map_id = current_map())")
    ).scalar():
        raise LookupError("the map is empty: semmap import FILE fills it")
    reading = _Reading(seen, moment=moment, voxels=voxels, assume_sizes=assume_sizes)
    pairs = reading.pairs()
    inventories: dict[str, list[SceneEntity]] = {s.name: [] for s in stated}
    for row, entity in pairs:
        inventories[_home(row, stated)].append(entity)
    found = []
    for name in inventories if storey is None else [storey]:
        level = _with_floor(reading, name)
        here = tuple(e for row, e in pairs if not e.carried and _is_on(row, level))
        inventory = tuple(inventories[name])
        floors = _floor_areas(here)
        here = with_outline_walls(here, floors)
        found.append(StoreyScene(name, level.elevation, here, floors, level.band, inventory))
    return found


def read_entities(
    seen: Snapshot,
    ids: Iterable[int] | None = None,
    *,
    kinds: Collection[EntityKind] | None = None,
    storey: str | None = None,
    moment: datetime | None = None,
    triangles: bool = True,
    carried: bool = False,
    assume_sizes: bool = False,
) -> list[SceneEntity]:
    """Return placed entities of the map with their geometry, in the order of their ids.

    Only those of some `ids` and `kinds`, and in the scene of a `storey`, where these are given;
    with `carried`, also what agents carry; without `triangles`, no meshes. The other parameters are
    those of `read_scene`.

    Raises
    ------
    LookupError
        There is no such storey.
    """
    reading = _Reading(seen, moment=moment, triangles=triangles, assume_sizes=assume_sizes)
    where, values = "", {}
    if ids is not None:
        where, values = "  AND e.id = ANY(:ids)\n", {"ids": [*ids]}
    if storey is not None:
        where += _ON_STOREY
        values |= _with_floor(reading, storey).values
    found = reading.entities(where, values, kinds=kinds)
    return [e for e in found if carried or not e.carried]


@dataclass(frozen=True)
class _Storey:
    """A storey, or the whole of a map without any; its floor and the heights z that are its own."""

    name: str
    id: int | None = None
    elevation: float = -math.inf
    band: tuple[float, float] = (-math.inf, math.inf)

    @property
    def values(self) -> dict[str, Any]:
        """The parameters of `_ON_STOREY`."""
        return {"storey": self.id, "low": self.band[0], "high": self.band[1]}


def _storeys(seen: Snapshot) -> list[_Storey]:
    """The storeys as the map states them, the lowest first."""
    rows = seen.connection.execute(text(_STOREYS), {"below": BELOW, "top": TOP}).all()
    return [_Storey(r.name, r.id, r.elevation, (r.low, r.high)) for r in rows] or [
        _Storey(seen.name)
    ]


def _find(name: str, storeys: Sequence[_Storey]) -> _Storey:
    for storey in storeys:
        if storey.name == name:
            return storey
    raise LookupError(_unknown("storey", name, [s.name for s in storeys]))


def _with_floor(reading: _Reading, name: str) -> _Storey:
    """A storey with its floor: as its rooms or the map state it, else measured on its meshes."""
    storey = _find(name, _storeys(reading.seen))
    lowest = _lowest_room(reading.seen, storey)
    if lowest is not None and storey.id is not None:
        return storey
    floor = _measured_floor(reading, storey) if lowest is None else lowest
    if storey.id is None:
        floor = floor or 0.0
        return replace(storey, elevation=floor, band=(floor - BELOW, floor + TOP))
    return storey if floor is None else replace(storey, elevation=floor)


def _lowest_room(seen: Snapshot, storey: _Storey) -> float | None:
    """The lowest floor that a room of a storey states."""
    statement = (
        "SELECT min(w.pose[3] + r.floor) FROM entity e JOIN room r ON r.entity_id = e.id "
        "JOIN world w ON w.entity_id = e.id WHERE e.map_id = current_map()" + _ON_STOREY
    )
    floor: float | None = seen.connection.execute(text(statement), storey.values).scalar_one()
    return floor


def _measured_floor(reading: _Reading, storey: _Storey) -> float | None:
    """The floor that the meshes of a storey without rooms show, None where they show none."""
    stated = storey.elevation
    near = None if storey.id is None else (stated - BELOW, stated + BELOW)
    types = storey.values | {"types": [*FLOOR_TYPES]}
    ground = reading.entities(_ON_STOREY + _OF_TYPES, types, OBJECTS)
    found = floor_level([_faces(e) for e in ground if not e.carried], near=near)
    if found is None:
        others = reading.entities(_ON_STOREY, storey.values, OBJECTS)
        found = floor_level([], [_faces(e) for e in others if not e.carried], near=near)
    return found


def _faces(entity: SceneEntity) -> NDArray[np.float64]:
    """The triangles of an entity or in its voxels, or else the upper faces of these."""
    if entity.voxels is None or len(entity.triangles):
        return entity.triangles
    inside = entity.voxels.triangles
    return entity.voxels.top_faces() if inside is None else inside


def _home(row: Any, storeys: Sequence[_Storey]) -> str:
    """The storey to which an entity belongs: its holder's, else the highest not above it."""
    if row.storey is not None:
        return str(row.storey)
    below = [s for s in storeys if s.elevation <= row.low + BELOW]
    return (below or [*storeys[:1]])[-1].name


def _is_on(row: Any, level: _Storey) -> bool:
    """The condition `_ON_STOREY`, for a row that is already read."""
    if row.kind in ("room", "region") and level.id is not None and row.storey_id is not None:
        return bool(row.storey_id == level.id)
    return bool(row.low < level.band[1] and row.high >= level.band[0])


def _bounds_of_rooms(
    seen: Snapshot, rooms: Sequence[str], level: _Storey, bounds: Bounds | None
) -> Bounds:
    """The rectangle around rooms, and within bounds where they are given."""
    found = seen.connection.execute(
        text(
            "SELECT e.name, ST_XMin(w.box), ST_YMin(w.box), ST_XMax(w.box), ST_YMax(w.box) "
            "FROM world w JOIN entity e ON e.id = w.entity_id "
            "WHERE e.map_id = current_map() AND e.kind = 'room'" + _ON_STOREY
        ),
        level.values,
    )
    known = {name: box for name, *box in found}
    for room in rooms:
        if room not in known:
            raise LookupError(_unknown("room", room, [*known]))
    boxes = np.array([known[room] for room in rooms])
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    if bounds is not None:
        low, high = np.maximum(low, bounds[:2]), np.minimum(high, bounds[2:])
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _unknown(what: str, name: str, names: Sequence[str]) -> str:
    near = suggestion(name, names, f"there are: {', '.join(names) or 'none'}")
    return f"there is no {what} named {name}{near}"


class _Reading:
    """Reads entities for one call; each mesh is fetched once."""

    def __init__(
        self,
        seen: Snapshot,
        *,
        moment: datetime | None = None,
        triangles: bool = True,
        voxels: Mapping[int, Voxels] | None = None,
        assume_sizes: bool = False,
    ) -> None:
        self.seen = seen
        self._sizes = _typical_sizes(seen) if assume_sizes else {}
        self._moment = moment
        self._given = voxels or {}
        self._clouded = [*_MESHED] if triangles else []
        self._meshed = self._clouded if voxels is None else []
        self._models: dict[int, NDArray[np.float64]] = {}
        self._clouds: dict[int, NDArray[np.float64]] = {}

    def entities(
        self,
        where: str = "",
        values: dict[str, Any] | None = None,
        kinds: Collection[EntityKind] | None = None,
    ) -> list[SceneEntity]:
        """The entities that meet a condition, with their geometry, in the order of their ids."""
        return [entity for _, entity in self.pairs(where, values, kinds)]

    def pairs(
        self,
        where: str = "",
        values: dict[str, Any] | None = None,
        kinds: Collection[EntityKind] | None = None,
    ) -> list[tuple[Any, SceneEntity]]:
        """As `entities`, each with its row."""
        rows = self.seen.connection.execute(
            text(_ENTITIES + where + "ORDER BY e.id"),
            {"kinds": [*(kinds or _KINDS)], "meshed": self._meshed, "clouded": self._clouded}
            | {"door": DOOR_WIDTH, "frame": FRAME, "in_opening": IN_OPENING}
            | (values or {}),
        ).all()
        session = self.seen.session
        models = {m for row in rows for m in row.models or ()} - self._models.keys()
        clouds = {m for row in rows for m in row.clouds or ()} - self._clouds.keys()
        self._models |= models_triangles(session, models) if models else {}
        self._clouds |= models_points(session, clouds) if clouds else {}
        types = read_supertypes(self.seen, {row.type for row in rows})
        footprints = shapely.from_wkb(
            np.array([None if r.footprint is None else bytes(r.footprint) for r in rows], object)
        )
        found = [
            (row, self._entity(row, footprint, types.get(row.type, (row.kind,))))
            for row, footprint in zip(rows, footprints, strict=True)
        ]
        return [(row, entity) for row, entity in found if entity.holds_at(self._moment)]

    def _entity(self, row: Any, footprint: Any, types: tuple[str, ...]) -> SceneEntity:
        pose = Pose(*row.pose)
        parts = [_placed(self._models[m], pose) for m in row.models or () if m in self._models]
        voxels = None if parts else self._voxels(row, pose)
        own: dict[str, Any] = {}
        if row.kind == "room":
            floor = pose.z + row.floor
            top = row.high if row.ceiling is None else pose.z + row.ceiling
            own = {"floor": floor, "ceiling": _top(floor, top)}
        elif row.kind == "region":
            own = {"floor": row.low, "ceiling": _top(row.low, row.high)}
        elif row.kind == "connector":
            sides = (pose @ Pose(*row.pose_a), pose @ Pose(*row.pose_b))
            own = {"form": row.form, "width": row.width, "sides": sides}
            if not parts and voxels is None and self._meshed:
                parts = [_leaf(pose, sides, row.width)]
        elif row.kind == "object" and not parts and (voxels is None or voxels.corners is None):
            size = next((self._sizes[t] for t in types if t in self._sizes), None)
            if size is not None:
                stand = Pose.planar(pose.x, pose.y, pose.yaw + row.front, pose.z)
                parts, own = [_upright_box(*size, stand)], {"assumed": True}
                footprint = shapely.MultiPoint(parts[0].reshape(-1, 3)[:, :2]).convex_hull
        return SceneEntity(
            row.id,
            row.name,
            row.kind,
            types,
            np.concatenate(parts) if parts else NO_TRIANGLES,
            footprint,
            row.properties,
            row.state,
            (row.since, row.until),
            pose,
            row.label,
            row.storey,
            carried=row.carried,
            voxels=voxels,
            **own,
        )

    def _voxels(self, row: Any, pose: Pose) -> Voxels | None:
        """The given voxels of an entity, or those of its point clouds."""
        if row.id in self._given:
            return self._given[row.id]
        points = [pose.apply(self._clouds[m]) for m in row.clouds or () if m in self._clouds]
        return Voxels.of_points(np.concatenate(points), VOXEL_SIZE) if points else None


def _top(floor: float, top: float) -> float:
    """The z of a room's or region's upper end; of a flat one, at the usual height."""
    return top if top - floor > FLAT else floor + ROOM_HEIGHT


def _typical_sizes(seen: Snapshot) -> dict[str, tuple[float, float, float]]:
    """Depth, width and height of the types that have a typical size, metres."""
    rows = seen.connection.execute(
        text("SELECT name, typical_size FROM semantic_type WHERE typical_size IS NOT NULL")
    )
    found = {name: (size[0], size[1], size[2]) for name, size in rows}
    if not found:
        raise LookupError("no type has a typical size yet: import a file again, which loads them")
    return found


def _placed(triangles: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Triangles in the map's frame; corners that are equal stay equal to the last bit."""
    r, t = pose.rotation_matrix, (pose.x, pose.y, pose.z)
    if (pose.qx, pose.qy, pose.qz) == (0.0, 0.0, 0.0):
        return np.add(triangles, t, dtype=np.float64)
    x, y, z = np.moveaxis(triangles, 2, 0)
    found = np.empty_like(triangles)
    for k in range(3):
        found[..., k] = x * r[k, 0] + y * r[k, 1] + z * r[k, 2] + t[k]
    return found


def _leaf(frame: Pose, sides: tuple[Pose, Pose], width: float | None) -> NDArray[np.float64]:
    """The box of a connector's opening, for a connector without a mesh."""
    a, b = sides
    thick, high = LEAF
    heading = np.arctan2(b.y - a.y, b.x - a.x) if (a.x, a.y) != (b.x, b.y) else frame.yaw
    middle = Pose.planar((a.x + b.x) / 2, (a.y + b.y) / 2, float(heading), min(a.z, b.z))
    return _upright_box(thick, width or DOOR_WIDTH, high, middle)


def _upright_box(depth: float, width: float, height: float, pose: Pose) -> NDArray[np.float64]:
    """A box on the point at which something stands, its depth along the front."""
    box = box_mesh((-depth / 2, -width / 2, 0.0), (depth / 2, width / 2, height))
    return _placed(box.triangles, pose)


def _floor_areas(
    entities: Sequence[SceneEntity], rooms: Sequence[str] | None = None
) -> tuple[FloorArea, ...]:
    """Rooms (only some), and the doorways between the poses before and behind each connector."""
    found = [
        FloorArea(e.name, e.footprint, e.floor)
        for e in entities
        if e.kind == "room" and e.footprint is not None and e.floor is not None
        if rooms is None or e.name in rooms
    ]
    inside = united(area.outline for area in found).buffer(0.5)
    count = len(found)
    for door in entities:
        if door.sides is None:
            continue
        a, b = door.sides
        line = shapely.LineString([(a.x, a.y), (b.x, b.y)])
        if line.length and (rooms is None or inside.intersects(line)):
            doorway = line.buffer((door.width or DOOR_WIDTH) / 2, cap_style="flat")
            foot = min(a.z, b.z)
            ends = shapely.MultiPoint([(a.x, a.y), (b.x, b.y)])
            upper = [
                area.outline
                for area in found[:count]
                if area.floor > foot + LANDING and area.outline.distance(ends) <= LANDING
            ]
            if upper:  # the slab of a landing, or of a room behind a step, is no obstacle
                doorway = doorway.difference(united(upper))
            found.append(FloorArea(door.name, doorway, foot))
    return tuple(found)
