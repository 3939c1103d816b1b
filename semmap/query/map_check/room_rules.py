"""Rules on rooms and storeys: drawn twice, one above the other, without a floor or a door."""

from __future__ import annotations

import itertools
from collections import Counter
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from semmap.geometry.levels import are_floors, in_metres, stacked
from semmap.geometry.overlay import common, united, without
from semmap.query.geometry_notes import listed
from semmap.query.map_check.building import (
    CONTACT,
    SAME_POINT,
    STEP,
    WALL,
)
from semmap.query.map_check.fixes import Found
from semmap.query.map_check.reader import CheckedEntity
from semmap.query.map_check.support import SupportedBuilding

FLOOR_AREA, THICK = 4.0, 0.6
"""Square metres of the least floor of a storey; metres of the thickest top of a wall, no floor."""

DOOR = 0.9
"""Metres of the width of a proposed door."""

LOW, HATCH = 1.5, 0.9
"""Metres of the least height of rooms in which people go, and of doors for robots and goods."""


def room_pairs(building: SupportedBuilding, same: bool) -> Found:
    """Rooms that overlap, or that are the same place."""
    for number, room in enumerate(building.rooms):
        for n in np.sort(building.room_tree.query(room.ground)):
            other = building.rooms[n]
            low = max(building.floor(room), building.floor(other))
            high = min(building.ceiling(room), building.ceiling(other))
            if n <= number or high - low <= STEP:
                continue
            shared = common(room.ground, other.ground)
            lower = min(building.ceiling(r) - building.floor(r) for r in (room, other))
            is_same = shared.area >= 0.95 * united([room.ground, other.ground]).area
            is_same &= high - low >= lower / 2
            if is_same != same or shared.buffer(-WALL / 2).is_empty:
                continue
            what = f"overlap in {shared.area:.2f} m2, from {low:.2f} to {high:.2f} m"
            what = "are the same place" if same else what
            text = f"the rooms {room.name} and {other.name} {what}"
            fix = "by hand: delete one of them, or draw it again in gis_room"
            yield (room.name, other.name), text, fix


def rooms_above_rooms(building: SupportedBuilding) -> Found:
    """Rooms one above the other with no storey between them."""
    heights = sorted((float(e.pose.z), e.name) for e in building.storeys if e.pose is not None)
    levels: dict[str | None, list[CheckedEntity]] = {}
    for room in building.rooms:
        below = [name for z, name in heights if z <= building.floor(room) + STEP]
        levels.setdefault(below[-1] if below else None, []).append(room)
    for storey, rooms in levels.items():
        floors = [building.floor(room) for room in rooms]
        found = stacked([room.outline for room in rooms], floors)
        if found:
            names = tuple(rooms[n].name for n in found)
            at = in_metres(sorted({round(floors[n], 2) for n in found}))
            held = "no storey" if storey is None else f"one storey, {storey}"
            text = f"the rooms {listed(names)} lie one above the other at {at}, on {held}"
            yield names, text, f"by hand: add a storey at each of {at}"


def rooms_off_storey(building: SupportedBuilding) -> Found:
    """Rooms whose floors are not on the storeys that hold them."""
    heights = {e.name: float(e.pose.z) for e in building.storeys if e.pose is not None}
    for room in building.rooms:
        held = next((e.name for e in room.chain if e.name in heights), None)
        if held is None:
            continue
        floor = building.floor(room)
        above = min((z for z in heights.values() if z > heights[held] + STEP), default=np.inf)
        if heights[held] - STEP <= floor < above:
            continue
        text = (
            f"the floor of {room.name} is at {floor:.2f} m, but it belongs to the storey {held}, "
            f"which is at {heights[held]:.2f} m"
        )
        lower = [name for name, z in heights.items() if z <= floor + STEP]
        right = max(lower, key=lambda name: heights[name], default=None)
        fix = f"by hand: add a storey at {floor:g} m, and put {room.name} on it"
        if right is not None:
            number = next(e.row["id"] for e in building.storeys if e.name == right)
            fix = f"map.execute('SELECT put({room.row['id']}, {number})')  # on {right}"
        yield (room.name, held), text, fix


def storeys_at_one_height(building: SupportedBuilding) -> Found:
    """Storeys at one elevation that share their ground, or of which one has none."""
    for one, two in combinations(building.storeys, 2):
        assert one.pose is not None
        assert two.pose is not None
        if abs(one.pose.z - two.pose.z) > CONTACT:
            continue
        grounds = [united(r.outline for r in building.rooms if s in r.chain) for s in (one, two)]
        if all(ground.area for ground in grounds):
            over, other = (ground.convex_hull for ground in grounds)
            if over.intersection(other).area < min(over.area, other.area) / 2:
                continue  # beside each other, as two buildings
        text = f"the storeys {one.name} and {two.name} are both at {one.pose.z:.2f} m"
        empty = [s for s, ground in zip((one, two), grounds, strict=True) if not ground.area]
        if len(empty) == 1:
            text += f", and {empty[0].name} has no room"
        fix = "by hand: correct the elevation of one of them, or delete it"
        yield (one.name, two.name), text, fix


def rooms_without_door(building: SupportedBuilding) -> Found:
    """Rooms into which no door leads, and rooms that doors join with each other alone."""
    shafts: dict[int, int] = {}  # the first cabin of each elevator: all of them are one
    rooms = {
        room.row["id"]: shafts.setdefault(room.row["elevator_id"] or -room.row["id"], n)
        for n, room in enumerate(building.rooms)
    }
    ends = [(d.row["place_a"], d.row["place_b"]) for d in building.doors]
    links = [(rooms[a], rooms[b]) for a, b in ends if a in rooms and b in rooms]
    outward = {a if a in rooms else b for a, b in ends if (a in rooms) != (b in rooms)}
    graph = coo_array((np.ones(len(links)), np.reshape(links, (-1, 2)).T), (len(rooms),) * 2)
    of_group = connected_components(graph, directed=False)[1] if rooms else np.empty(0, int)
    members: dict[int, list[CheckedEntity]] = {}
    for room in building.rooms:
        members.setdefault(of_group[rooms[room.row["id"]]], []).append(room)
    groups = list(members.values())
    entered = [group for group in groups if any(room.row["id"] in outward for room in group)]
    for group in groups if len(groups) > 1 else ():
        names = tuple(room.name for room in group)
        if len(group) == 1 and group not in entered:
            yield names, f"no door leads to the room {names[0]}", _door(building, group)
        elif group not in (entered or [max(groups, key=len)]):
            text = f"doors join the rooms {listed(names)} with each other alone"
            yield names, text, _door(building, group)


def one_way_rooms(building: SupportedBuilding) -> Found:
    """Rooms that doors of one direction let nobody enter, or let nobody leave."""
    outside, rooms = 0, {}
    shafts: dict[int, int] = {}
    for number, room in enumerate(building.rooms, 1):
        rooms[room.row["id"]] = shafts.setdefault(room.row["elevator_id"] or -number, number)
    ways = np.zeros((len(building.rooms) + 1,) * 2, np.bool_)
    for door in building.doors:
        a, b = (rooms.get(door.row[f"place_{end}"], outside) for end in "ab")
        ways[a, b] |= door.row["direction"] != "backward"
        ways[b, a] |= door.row["direction"] != "forward"
    both = connected_components(ways, directed=False)[1]
    circles = connected_components(ways, directed=True, connection="strong")[1]
    for number in np.unique(both):
        main = np.bincount(circles[both == number]).argmax()
        reached, left = (
            breadth_first_order(w, int(np.flatnonzero(circles == main)[0]))[0]
            for w in (ways, ways.T)
        )
        for room in building.rooms:
            k = rooms[room.row["id"]]
            if both[k] != number or circles[k] == main:
                continue
            why = [] if k in reached else [f"no door leads into {room.name}"]
            why += [] if k in left else [f"no door leads out of {room.name}"]
            fix = "by hand: correct the direction of its doors, or add a door"
            if why:
                yield (room.name,), f"{' and '.join(why)}: others have one direction", fix


def improbable_heights(building: SupportedBuilding) -> Found:
    """Rooms and doors so low that nobody stands or passes there."""
    for room in building.rooms:
        height = building.ceiling(room) - building.floor(room)
        if height < LOW:
            text = f"the ceiling of {room.name} is {height:.2f} m above its floor"
            yield (room.name,), text, "by hand: correct its floor or ceiling"
    for door in building.doors:
        height = door.row["clear_height"]
        if height is not None and height < HATCH and door.row["form"] != "ramp":
            text = f"the door {door.name} is {height:.2f} m high"
            yield (door.name,), text, "by hand: correct its height, if it is higher"


def _door(building: SupportedBuilding, group: list[CheckedEntity]) -> str:
    """A door from rooms to the nearest other one, in the middle of their longest common wall."""
    fixes = (_door_to(building, room, other) for room, other in _level_pairs(building, group))
    by_hand = "by hand: draw a door in gis_connector, or add stairs: no other room is beside it"
    return next((fix for fix in fixes if fix is not None), by_hand)


def _level_pairs(
    building: SupportedBuilding, group: list[CheckedEntity]
) -> list[tuple[CheckedEntity, CheckedEntity]]:
    """Rooms of a group and others on their floor, the nearest first."""
    pairs = [
        (room, other)
        for room in group
        for other in building.rooms
        if other not in group and abs(building.floor(other) - building.floor(room)) <= STEP
    ]
    return sorted(pairs, key=lambda two: (two[0].ground.distance(two[1].ground), two[1].name))


def _door_to(building: SupportedBuilding, room: CheckedEntity, other: CheckedEntity) -> str | None:
    """The call that adds a door, in the middle of the longest common wall of two rooms."""
    edges = without(room.ground.boundary, other.ground)
    beside = edges.intersection(other.ground.buffer(WALL - SAME_POINT, cap_style="flat"))
    walls = [
        part
        for pair in itertools.pairwise(shapely.get_coordinates(room.ground))
        for part in shapely.get_parts(shapely.LineString(pair).intersection(beside))
        if part.length >= DOOR
    ]
    if not walls:
        return None
    wall = max(walls, key=lambda part: float(part.length))
    ends = [
        tuple(float(v) for v in wall.interpolate(wall.length / 2 + d).coords[0])
        for d in (-DOOR / 2, DOOR / 2)
    ]
    line = ", ".join(f"({x:.3f}, {y:.3f})" for x, y in ends)
    name, taken = f"door of {room.name}", {e.name for e in building.entities}
    while name in taken:
        name += "_"
    floor = building.floor(room)
    return f"map.add_door({name!r}, {room.name!r}, {other.name!r}, ({line}), height={floor:.3f})"


def storeys_without_floor(building: SupportedBuilding) -> Found:
    """Storeys without a room or a floor."""
    for storey in building.storeys:
        assert storey.pose is not None
        z = storey.pose.z
        if any(abs(building.floor(r) - z) <= STEP or storey in r.chain for r in building.rooms):
            continue
        if _has_floor(building, z):
            continue
        fix = "by hand: add a room on it, or delete it"
        yield (storey.name,), f"the storey {storey.name} at {z:.2f} m has no room and no floor", fix


def _has_floor(building: SupportedBuilding, z: float) -> bool:
    """Whether parts of the building have a wide level top there; without rooms, flat solids."""
    boxes = np.array([(e.low, e.high) for e in building.solids]).reshape(-1, 2, 3)
    flat = are_floors(boxes) if not building.rooms else np.zeros(len(boxes), np.bool_)
    tops = [
        shapely.polygons(_level_tops(entity, z)[:, :, :2])
        for entity, is_flat in zip(building.solids, flat, strict=True)
        if entity.low[2] <= z + STEP and entity.high[2] >= z - STEP
        if is_flat or building.is_part(entity)
    ]
    whole = united(np.concatenate([*tops, np.empty(0, object)]))
    wide = whole.buffer(-THICK / 2, join_style="mitre").buffer(THICK / 2, join_style="mitre")
    return bool(max(shapely.area(shapely.get_parts(wide)), default=0) >= FLOOR_AREA)


def _level_tops(entity: CheckedEntity, z: float) -> NDArray[np.float64]:
    """The level faces near a height that face up; all, of a sheet that faces down."""
    faces = entity.triangles[np.ptp(entity.triangles[:, :, 2], axis=1) <= CONTACT]
    a, b, c = (faces[:, k, :2] for k in range(3))
    (x, y), (u, v) = (b - a).T, (c - a).T
    up = x * v - y * u > 0
    near = (np.abs(faces[:, :, 2] - z) <= STEP).all(axis=1)
    return np.asarray(faces[near & (up | ~up.any())])


def shapeless_places(building: SupportedBuilding) -> Found:
    """Rooms and holders without geometry."""
    bearing = Counter(
        e.holder.name
        for e in building.objects
        if e.holder is not None and e.holder.kind == "object" and e.holder.outline is None
    )
    for name, count in sorted(bearing.items()):
        text = f"{name} holds {count} object{'s' * (count > 1)}, but has no geometry to reach"
        yield (name,), text, "by hand: add its mesh or size"
    for entity in building.entities:
        if entity.kind == "room" and entity.outline is None:
            fix = "by hand: delete it, and add it with an outline"
            yield (entity.name,), f"the room {entity.name} has no outline, so no grid", fix
