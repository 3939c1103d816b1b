"""Entries for the store, from arguments as a person gives them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from semmap.finite_number import finite_numbers
from semmap.geometry.mesh import Mesh, box_mesh, prism_mesh
from semmap.geometry.overlay import united
from semmap.geometry.pose import Pose
from semmap.ingest.naming import GUESS
from semmap.ingest.openings import BEHAVIOURS, WIDER
from semmap.ingest.stairs import way_entry
from semmap.ingest.store.holder_store import find_surfaces
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import (
    NOT_OUTSIDE,
    OUTSIDE,
    ConnectorDetail,
    Entry,
    Kind,
    PlaceDetail,
    Shape,
    World,
)
from semmap.query.map_check.building import STEP, WALL

if TYPE_CHECKING:
    from navgrid.found_rooms import FoundRooms
    from semmap.api.map import Map
    from semmap.api.map_entity import MapEntity

HEIGHT = {"room": 2.5, "region": 0.01}
"""Metres, of what is drawn without a ceiling."""

CLEARANCE = 0.6
"""Metres from the line of a door at which a robot stands before and behind it."""

IN_ROOM = 0.1
"""Metres from the border of a room at which a post of a door is in the room."""

SIDE = 0.05
"""Metres before and behind a door's line where its places are looked for."""


def polygon_of(outline: Any) -> Any:
    """A Shapely geometry as it is, or the polygon of corners (x, y), which may cross itself."""
    if isinstance(outline, shapely.Geometry):
        return outline
    corners = [finite_numbers(corner) for corner in outline]
    if len(corners) < 3 or any(corner is None or len(corner) < 2 for corner in corners):
        raise ValueError(f"a polygon has three corners (x, y) or more, not {list(outline)}")
    return shapely.Polygon(corners)


def drawn(
    name: str,
    kind: Kind,
    outline: Any,
    floor: float,
    ceiling: float | None,
    type: str | None,
    label: str | None,
) -> Entry:
    """A room or region; its frame lies at a point in it on the floor."""
    polygon = polygon_of(outline)
    if polygon.geom_type not in ("Polygon", "MultiPolygon") or polygon.is_empty:
        raise ValueError(f"the outline of {name} is a {polygon.geom_type}, not a polygon")
    if not polygon.is_valid or polygon.area == 0:
        raise ValueError(f"the outline of {name} is not valid: {shapely.is_valid_reason(polygon)}")
    top = floor + HEIGHT[kind] if ceiling is None else ceiling
    if not (math.isfinite(floor) and math.isfinite(top) and top > floor):
        raise ValueError(f"the ceiling of {name} ({ceiling} m) is not above its floor ({floor} m)")
    point = polygon.representative_point()
    local = shapely.transform(shapely.force_2d(polygon), lambda xy: xy - [point.x, point.y])
    shape = Shape("polygon", prism_mesh(local, 0.0, top - floor), outline=local)
    pose = Pose(float(point.x), float(point.y), floor)
    detail = None
    if kind == "room":
        detail = PlaceDetail(0.0, None if ceiling is None else ceiling - floor)
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
        sides = finite_numbers(size, 3)
        if sides is None or min(sides) <= 0:
            raise ValueError(f"the size of {name} is three lengths above 0, not {tuple(size)}")
        x, y, z = sides
        shapes = [Shape("box", box_mesh((-x / 2, -y / 2, 0), (x / 2, y / 2, z)))]
    elif mesh is not None:
        shapes = _shapes(mesh)
    where = None
    if pose is not None:
        numbers = finite_numbers(pose)
        if numbers is None or len(numbers) not in (3, 4):
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


def door(
    map: Map,
    name: str,
    places: tuple[str, str | None],
    line: Sequence[Sequence[float]],
    height: float | None,
    clearance: float,
    **detail: Any,
) -> Entry:
    """A connector, x of whose frame points from the first place to the other; as `Map.add_door`."""
    rooms = [map[place] for place in places if place is not None]
    ends = np.asarray(line, dtype=float)
    if ends.shape != (2, 2) or not np.isfinite(ends).all() or np.allclose(ends[0], ends[1]):
        raise ValueError(f"the line of {name} is two points (x, y), not {line}")
    climbs = detail["type"] in ("stairs", "ramp")
    if not climbs:
        _check_across(name, rooms, ends)
    floors = [_floor(map, room) for room in rooms]
    if height is None:
        height = min(floors)
    for room, floor in zip(rooms, floors, strict=True):
        if not climbs and abs(floor - height) > STEP:
            raise ValueError(
                f"{name} is at {height:g} m, but the floor of {room.name} is at {floor:g} m: give "
                "its height, or join rooms of one storey; stairs and ramps join others "
                '(form="stairs")'
            )
    rises = [floor - height if climbs else 0.0 for floor in (*floors, height)][:2]
    along = ends[1] - ends[0]
    length = float(np.hypot(*along))
    normal = np.array([along[1], -along[0]]) / length
    middle = ends.mean(axis=0)
    sides = [_nearer(map, room, ends, normal) for room in rooms]
    if sides[0] > 0 or (sides[0] == 0 and sides[1:] == [-1]):
        normal = -normal
    yaw = math.atan2(normal[1], normal[0])
    reaches = [clearance + SIDE] * 2
    for number, room in enumerate(rooms):  # in the room, and not in a thick wall
        away = room.footprint.distance(shapely.Point(middle)) if room.footprint else 0.0
        reaches[number] += max(0.0, away - (clearance if climbs else WALL))
    place_a, place_b = places
    detail.setdefault("behaviour", BEHAVIOURS[detail["type"]])
    if detail["width"] is None:
        detail["width"] = length
    if detail["width"] > length + WIDER:
        raise ValueError(
            f"{name} is {detail['width']:g} m wide, but its line is {length:.2f} m long from post "
            "to post: correct one of them"
        )
    fault = map._rows(
        "SELECT door_fault(%s, %s, ST_MakeLine(ST_MakePoint(%s, %s), ST_MakePoint(%s, %s)), %s)",
        *(detail["type"], detail["width"], *ends.ravel().tolist(), [room.id for room in rooms]),
    )[0][0]
    if fault is not None:
        raise ValueError(f"{name} {fault}")
    return Entry(
        name,
        "connector",
        pose=Pose.planar(float(middle[0]), float(middle[1]), yaw, height),
        detail=ConnectorDetail(
            (place_a, OUTSIDE if place_b is None else place_b),
            (Pose(-reaches[0], z=rises[0]), Pose.planar(reaches[1], 0, math.pi, rises[1])),
            **detail,
        ),
    )


def _floor(map: Map, room: MapEntity) -> float:
    """The z of a room's floor in the map's frame."""
    statement = (
        "SELECT w.pose[3] + r.floor FROM world w JOIN room r USING (entity_id) WHERE entity_id = %s"
    )
    found = map._rows(statement, room.id)
    return float(found[0][0]) if found else 0.0


def _check_across(name: str, rooms: Sequence[MapEntity], ends: Any) -> None:
    """Refuse a line that leads from one room into another, in place of that from post to post."""
    outlines = [room.footprint for room in rooms if room.footprint is not None]
    if len(outlines) != 2 or rooms[0] == rooms[1]:
        return
    inner = [outline.buffer(-IN_ROOM) for outline in outlines]
    posts = shapely.points(ends)
    for first, second in (posts, posts[::-1]):
        if inner[0].contains(first) and inner[1].contains(second):
            raise ValueError(
                f"the line of {name} leads from {rooms[0].name} into {rooms[1].name}: draw the "
                "opening in the wall, from post to post"
            )


ROOMS_OF_TYPES = """
SELECT s.name, array_agg(f.type) AS rooms
FROM semantic_type s CROSS JOIN unnest(s.found_in) f (type)
WHERE f.type = ANY (subtypes('room')) GROUP BY s.name
"""
"""By type of objects, the types of rooms in which they usually are."""


def add_found_rooms(map: Map, found: FoundRooms) -> FoundRooms:
    """Add the rooms and doorways of a storey that were found; return those that were added.

    A doorway that is no sound door is left out, and `problem` says why.
    """
    for room in found.rooms:
        heights = found.elevation, room.ceiling
        made = drawn(room.name, "room", room.outline, *heights, room.type, None)
        made.properties["found"] = {
            "confidence": round(room.confidence, 3),
            "shown_by": list(room.shown_by),
        }
        add_entry(map, made, storey=found.storey if found.storey in map else None)
    added, faults = [], []
    for way in found.doorways:
        detail = {"width": None, "type": "door", "behaviour": BEHAVIOURS[way.type]}
        line = way.line.coords[:]
        try:
            made = door(map, way.name, way.rooms, line, found.elevation, CLEARANCE, **detail)
        except ValueError as error:
            faults.append(str(error))
            continue
        made.type = way.type
        assert isinstance(made.detail, ConnectorDetail)
        made.detail.height = way.height
        made.properties["found"] = {"confidence": round(way.confidence, 3)}
        if way.leaf is not None:
            leaf = map[way.leaf]
            made.label = leaf.label or leaf.name
            made.properties = {**leaf.properties, **made.properties}
            made.properties.pop(GUESS, None)
            made.properties["found"]["shown_by"] = [leaf.name]
        add_entry(map, made)
        added.append(way)
    if not faults:
        return found
    return replace(found, doorways=tuple(added), problem="; ".join(faults))


def add_found_stairs(map: Map, found: FoundRooms) -> None:
    """Add the stairs from a storey to the next one that were found, whose rooms the map has."""
    for stairs in found.stairs:
        made = way_entry(stairs.name, "stairs", stairs.ends, stairs.rooms, stairs.floors)
        made.properties["found"] = {"shown_by": [stairs.treads]}
        if found.storey in map and made.pose is not None:
            made.holder, made.pose = found.storey, Pose(z=-found.elevation) @ made.pose
        add_entry(map, made)


def add_found_lifts(map: Map, found: FoundRooms) -> None:
    """Make the rooms that were found one above another the cabins of a lift."""
    for lift in found.lifts:
        lowest = map.rooms[lift.cabins[0]].pose
        made = Entry(lift.name, "elevator", "elevator", pose=lowest)
        made.properties["found"] = {"confidence": lift.confidence}
        elevator = add_entry(map, made)
        for name in lift.cabins:
            cabin = map.rooms[name]
            cabin.type = "elevator_cabin"
            map._write(
                "UPDATE room SET elevator_id = %s WHERE entity_id = %s", elevator.id, cabin.id
            )
            map._write(
                "UPDATE connector SET form = 'elevator_door', behaviour = 'call_elevator' "
                "WHERE %s IN (place_a, place_b)",
                cabin.id,
            )


def _nearer(map: Map, room: MapEntity, ends: Any, normal: Any) -> int:
    """1 if the room is on the side to which `normal` points, -1 if on the other, 0 if on both."""
    middle = ends.mean(axis=0)
    ahead, behind = middle + SIDE * normal, middle - SIDE * normal
    row = map._rows(
        "SELECT ST_Distance(footprint, ST_MakePoint(%s, %s)), "
        "ST_Distance(footprint, ST_MakePoint(%s, %s)) FROM world WHERE entity_id = %s",
        *behind.tolist(),
        *ahead.tolist(),
        room.id,
    )
    if not row or row[0][0] is None:
        raise ValueError(f"{room.name} has no outline")
    to_behind, to_ahead = row[0]
    return int(np.sign(to_behind - to_ahead))


def spot(
    map: Map, holder: MapEntity, relation: str, size: Sequence[float] = (0, 0, 0), moved: int = 0
) -> tuple[float, float, float]:
    """A free point on the highest surface of a holder, or on its floor; as `Map.spot`."""
    rows = []
    if relation == "on" or holder.kind == "object":
        rows = map._rows(_BOARDS, relation == "on", size[2], holder.id)
    rows = rows or map._rows(
        "SELECT ST_AsBinary(w.footprint), CASE WHEN %s = 'on' THEN ST_ZMax(w.box) "
        "ELSE coalesce(w.pose[3] + r.floor, ST_ZMin(w.box)) END "
        "FROM world w LEFT JOIN room r ON r.entity_id = w.entity_id "
        "WHERE w.entity_id = %s AND w.footprint IS NOT NULL",
        relation,
        holder.id,
    )
    if not rows:
        raise ValueError(f"{holder.name} has no geometry: give a pose")
    for outline, z in rows:
        found = _free_point(map, shapely.from_wkb(bytes(outline)), z, holder.id, size, moved)
        if found is not None:
            if relation == "in":
                _check_inside(map, holder, (*found, z + max(size[2], SPOT) / 2))
            return (*found, z)
    what = f"{size[0]:.2f} x {size[1]:.2f} m"
    raise ValueError(f"{relation} {holder.name} no place of {what} is free: give a pose")


_BOARDS = """
SELECT ST_AsBinary(ST_Force2D(pose_apply(ST_Force3D(s.outline), w.pose))), w.pose[3] + s.height
FROM entity_model em JOIN support_surface s ON s.model_id = em.model_id
JOIN world w ON w.entity_id = em.entity_id CROSS JOIN LATERAL (
    SELECT coalesce(min(u.height), ST_ZMax(w.box) - w.pose[3]) - s.height FROM support_surface u
    WHERE u.model_id = s.model_id AND u.height > s.height + 0.02
      AND ST_Intersects(u.outline, ST_PointOnSurface(s.outline))) c (clear)
WHERE s.height IS NOT NULL AND (%s OR c.clear >= greatest(%s, 0.03)) AND em.entity_id = %s
ORDER BY s.height DESC, ST_Area(s.outline) DESC
"""
"""The level surfaces of a holder, the highest first; in it, those below others or its top."""


def _check_inside(map: Map, holder: MapEntity, point: tuple[float, float, float]) -> None:
    """Refuse the inside of what is solid: an object that is no storage furniture or container."""
    solid = map._rows(
        "SELECT 1 FROM entity e WHERE id = %s AND kind = 'object' AND NOT EXISTS (SELECT "
        "FROM type_closure WHERE sub = e.type AND super IN ('storage_furniture', 'container')) "
        "AND shape_distance(id, %s, %s, %s) = 0",
        holder.id,
        *point,
    )
    if solid:
        raise ValueError(
            f"{holder.name} is solid, so nothing is put in it: put it on {holder.name}, or let "
            "its type be one of storage_furniture or container"
        )


SPOT = 0.02
"""Metres between the points of a surface that are tried, and the least side of a thing."""

TOUCH = 1e-6
"""Metres by which a thing is narrower than it is, so that it may touch others and the edge."""

_IN_THE_WAY = """
SELECT ST_AsBinary(coalesce(w.footprint, ST_MakePoint(w.pose[1], w.pose[2])))
FROM world w JOIN entity e ON e.id = w.entity_id
WHERE e.map_id = current_map() AND has_room(e.kind, e.type)
AND e.id <> %s AND e.id <> %s AND w.box && ST_MakeEnvelope(%s, %s, %s, %s)
AND ST_ZMin(w.box) < %s AND (ST_ZMax(w.box) > %s OR w.footprint IS NULL AND ST_ZMax(w.box) >= %s)
AND NOT coalesce(ST_Covers(w.footprint, ST_GeomFromWKB(%s)), false)
AND NOT e.id IN (SELECT holders_of(ARRAY[%s::bigint]))
"""


def _free_point(
    map: Map, surface: Any, z: float, holder: int, size: Sequence[float], moved: int
) -> tuple[float, float] | None:
    """The free point that is nearest to the middle of a surface, or None if others are in the way.

    In the middle, a thing may be larger than the surface, as a tray on a stool.
    """
    half_x, half_y = (max(side, SPOT) / 2 - TOUCH for side in size[:2])
    low, top = z + SPOT / 4, z + max(size[2], SPOT)
    middle = surface.point_on_surface()
    x0, y0, x1, y1 = surface.union(middle.buffer(max(half_x, half_y))).bounds
    rows = map._rows(
        _IN_THE_WAY, moved, holder, x0, y0, x1, y1, top, low, z - low + z, surface.wkb, holder
    )
    taken = united(shapely.from_wkb(bytes(row[0])) for row in rows)
    spacing = max(SPOT, math.sqrt(surface.area / 10_000))
    shapely.prepare([surface, taken])
    x0, y0, x1, y1 = surface.bounds
    grid = np.meshgrid(np.arange(x0, x1, spacing), np.arange(y0, y1, spacing))
    x = np.append(middle.x, grid[0].ravel())
    y = np.append(middle.y, grid[1].ravel())
    ground = shapely.box(x - half_x, y - half_y, x + half_x, y + half_y)
    fits = ~shapely.intersects(taken, ground)
    fits[1:] &= shapely.covers(surface, ground[1:])
    if not fits.any():
        return None
    distance = np.where(fits, np.hypot(x - middle.x, y - middle.y), np.inf)
    best = int(np.argmin(distance))
    return float(x[best]), float(y[best])


def add_entry(
    map: Map,
    entry: Entry,
    *,
    on: str | None = None,
    in_: str | None = None,
    storey: str | None = None,
    define: bool = False,
) -> MapEntity:
    """Store one entry, and state its holder where one is given; all of it or nothing."""
    if not entry.name:
        raise ValueError(f"the {entry.kind} needs a name")
    if entry.name == OUTSIDE:
        raise ValueError(NOT_OUTSIDE)
    if on is not None and in_ is not None:
        raise ValueError(f"{entry.name} is on {on} or in {in_}, not both")
    if entry.name in map:
        raise ValueError(f"the map has an entity {entry.name} already")
    if entry.type is not None and entry.kind != "connector" and not define:
        map.check_type(entry.type, "define=True adds it")
    if entry.type is not None and entry.kind == "object":
        check_object_type(map, entry.name, entry.type)
    stated = on if on is not None else in_
    relation = "in" if on is None else "on"
    holder = map[stated] if stated is not None else None
    if holder is not None and entry.pose is None:
        meshes = [s.mesh.bounds for s in entry.shapes if s.mesh]
        low = np.min([box[0] for box in meshes], axis=0) if meshes else np.zeros(3)
        high = np.max([box[1] for box in meshes], axis=0) if meshes else np.zeros(3)
        x, y, z = map.spot(holder, relation, (high - low).tolist())
        # the middle of its box, not its origin, is put on the point
        x, y = (x, y) - (low + high)[:2] / 2
        entry.pose = Pose(float(x), float(y), float(z - low[2]))
    with map.transaction():
        map_id = map._rows("SELECT current_map()")[0][0]
        session = map.connection
        store_world(session, map_id, World(map.name, Path(), [entry]))
        made = map[entry.name]
        find_surfaces(session, map_id, made.id)
        if entry.kind in ("object", "agent", "room", "region") and entry.pose is not None:
            if holder is not None:
                map._write("SELECT put(%s, %s, %s)", made.id, holder.id, relation)
            elif entry.kind in ("room", "region"):
                _into_storey(map, made, storey)
    return made


def check_object_type(
    map: Map, name: str, type: str, others: Sequence[str] = ("room", "storey", "elevator")
) -> None:
    """Refuse a type of entities of another kind for an object."""
    kinds = "SELECT k FROM unnest(%s::text[]) k WHERE %s = ANY (subtypes(k))"
    for (kind,) in map._rows(kinds, list(others), type):
        raise ValueError(f"{name} is an object, and {type} a type of the kind {kind}")


def _into_storey(map: Map, made: MapEntity, storey: str | None) -> None:
    """A room or region is held by the storey that is named, else the one on whose floor it is.

    ValueError if its floor is below or above the storey that is named.
    """
    rows = map._rows(
        "SELECT s.entity_id, w.pose[3], ST_ZMin(r.box) FROM storey s "
        "JOIN world w ON w.entity_id = s.entity_id JOIN world r ON r.entity_id = %s "
        "WHERE w.map_id = r.map_id ORDER BY w.pose[3]",
        made.id,
    )
    if storey is None:
        below = [number for number, elevation, floor in rows if elevation <= floor + STEP]
    else:
        below = [map[storey].id]
        for elevation, floor in [row[1:] for row in rows if row[0] == below[0]]:
            above = min((row[1] for row in rows if row[1] > elevation + STEP), default=math.inf)
            if not elevation - STEP <= floor < above - 1e-6:
                where = f"is from {elevation:g} to {above:g} m"
                raise ValueError(
                    f"the floor of {made.name}, at {floor:g} m, is not on {storey}, which "
                    f"{where if above < math.inf else f'begins at {elevation:g} m'}: "
                    "give its floor in the map's frame, or leave out the storey"
                )
    if below:
        map._write("SELECT put(%s, %s)", made.id, below[-1])


def hold_rooms(map: Map, storey: MapEntity, elevation: float) -> None:
    """Let a storey hold the rooms and regions on its floor that nothing holds."""
    rows = map._rows(
        "SELECT e.id FROM entity e JOIN placement p ON p.entity_id = e.id "
        "JOIN world w ON w.entity_id = e.id WHERE e.map_id = current_map() "
        "AND e.kind IN ('room', 'region') AND p.holder_id IS NULL "
        "AND abs(ST_ZMin(w.box) - %s) <= %s ORDER BY e.id",
        elevation,
        STEP,
    )
    for (room,) in rows:
        map._write("SELECT put(%s, %s)", room, storey.id)
