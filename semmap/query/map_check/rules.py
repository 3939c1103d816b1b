"""The table of rules by which a map is judged; each looks at geometry, none at derived holders."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Literal

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from semmap.geometry.contact import overlap
from semmap.geometry.levels import in_metres, stacked
from semmap.geometry.overlay import common, united, without
from semmap.geometry.pose import Pose
from semmap.query.geometry_notes import listed
from semmap.query.map_check.building import (
    CONTACT,
    FASTENED,
    LINTEL,
    SAME_POINT,
    STEP,
    THICKEST,
    WALL,
)
from semmap.query.map_check.doorways import NARROWEST, PASSAGE, SAME, DoorOpening
from semmap.query.map_check.fixes import Moves, Named, Trials
from semmap.query.map_check.reader import CheckedEntity, once_a_pair, read_checked_entities
from semmap.query.map_check.support import SupportedBuilding
from semmap.query.snapshot import Snapshot

MOSTLY = 0.6
"""Part of a footprint in a room from which it is there, wherever the limits lie exactly."""

FLOOR_AREA = 1.0
"""Square metres of the least floor of a storey."""

CONTENT = 0.95
"""Part of a solid in another from which it is its content: a coarse box of a cupboard is solid."""

SMALLER = 0.8
"""Of the larger box of two: the largest box of a content. What is larger stands in its place."""

AHEAD = 0.35
"""Metres before and behind a door that are in the rooms that it joins, behind walls."""

LEAF = 0.1
"""Metres of the thickest leaf of a door with its handles, and by which it covers its frame."""

DOOR = 0.9
"""Metres of the width of a proposed door."""

LOST = 1000.0
"""Metres above or below all rooms at which no building has a thing."""

Floats = NDArray[np.float64]

Severity = Literal["error", "warning", "note"]

Found = Iterator[tuple[tuple[str, ...], str, str | Moves]]
"""The entities, the sentence and the fix of each finding of a rule; moves are tried first."""


@dataclass(frozen=True)
class Finding:
    """One place where a map disagrees with itself or with physics."""

    kind: str  # of the table of rules, such as floating
    severity: Severity  # an error makes answers wrong, a warning can, a note does not
    entities: tuple[str, ...]  # names
    text: str  # a sentence
    fix: str  # the call or statement that repairs it and passes the check, or a step by hand
    safe: bool = False  # `fix` is SQL that changes only data derived from the geometry

    def __str__(self) -> str:
        return f"{self.severity}: {self.kind}: {self.text}"


def check_map(seen: Snapshot) -> list[Finding]:
    """Return what is wrong with the current map: errors first, then warnings and notes."""
    building = SupportedBuilding(read_checked_entities(seen))
    trials = Trials(building, _moved_findings)
    found = []
    for kind, severity, find in RULES:
        for names, text, fix in find(building):
            call = trials.fix(kind, names, fix) if isinstance(fix, Moves) else fix
            found.append(Finding(kind, severity, names, text, call, call.startswith("SELECT ")))
    return found


def _moved_findings(building: SupportedBuilding) -> Named:
    """The findings that a move of an object or door can make or repair."""
    return frozenset(
        (kind, names) for kind, _, find in RULES if kind in MOVED for names, _, _ in find(building)
    )


def _no_storey(building: SupportedBuilding) -> Found:
    for z, group in building.levels.items():
        names = tuple(e.name for e in group)
        stand = "stands" if len(names) == 1 else "stand"
        text = f"{listed(names)} {stand} at {z:.2f} m, far above all floors: on no storey"
        fix = f"by hand: add a storey at {z:g} m"
        if not building.storeys:
            lowest = min(float(e.low[2]) for e in building.solids)
            fix += f", and one for the lowest floor, at about {lowest:.2f} m"
        yield names, text, fix


def _floating(building: SupportedBuilding) -> Found:
    grouped = {e.name for group in building.levels.values() for e in group}
    for entity in building.floating:
        if entity.name in grouped or any(
            _shared(entity, other) is not None
            for other in building.near(entity, 0.0)
            if not _belongs(building, entity, other)
        ):
            continue  # another rule says so
        gap, name = building.gap_beneath(entity)
        beneath = "the floor" if name is None else name
        air = f"{gap:.2f} m above {beneath}" if np.isfinite(gap) else "over nothing"
        text = f"{entity.name} is {air} and hangs on no wall, ceiling or larger thing"
        drops = {gap, building.above_floor(entity)}
        down = [(0, 0, -drop) for drop in sorted(drops) if np.isfinite(drop)]
        yield (entity.name,), text, Moves(entity, down, "put it on what bears it, or delete it")


def _tipping(building: SupportedBuilding) -> Found:
    for entity in building.solids:
        found = None if entity.row["fixture"] else building.overhang(entity)
        if found is not None:
            away, bearer = found
            text = f"the middle of {entity.name} is {away:.2f} m beside {bearer.name}, so it tips"
            inward = ((bearer.low + bearer.high - entity.low - entity.high) / 2)[:2]
            length = max(float(np.linalg.norm(inward)), 1e-9)
            steps = [min((away + more) / length, 1.0) for more in (0.02, 0.05, 0.1, length)]
            by = [(*(inward * step), 0) for step in steps]
            yield (entity.name, bearer.name), text, Moves(entity, by, f"put it on {bearer.name}")


def _sunk(building: SupportedBuilding) -> Found:
    for entity in building.solids:
        if entity.name in building.sunk:
            place, depth = building.sunk[entity.name]
            floor = f"the floor of {place.name}" if place.kind == "room" else place.name
            text = f"{entity.name} has sunk {depth:.2f} m into {floor}"
            fix = Moves(entity, [(0, 0, depth)], "lift it onto the floor")
            yield (entity.name, place.name), text, fix


def _penetrating(building: SupportedBuilding) -> Found:
    done = set()
    for entity in building.solids:
        for other in building.near(entity, 0.0):
            pair = frozenset((entity.name, other.name))
            if pair in done or _belongs(building, entity, other):
                continue
            done.add(pair)
            number = building.together.get(entity.name)
            if number is not None and number == building.together.get(other.name):
                continue  # another rule says so
            shared = _shared(entity, other)
            if shared is None:
                continue
            small, large = sorted(
                (entity, other), key=lambda e: (building.is_part(e), float(np.prod(e.high - e.low)))
            )
            if (
                small.name in building.sunk
                and large.high[2] <= small.low[2] + FASTENED + (building.sunk[small.name][1])
            ):
                continue  # so is the slab of the floor
            size = " x ".join(f"{v:.2f}" for v in shared)
            text = f"{small.name} and {large.name} share a space of {size} m"
            fix = Moves(small, _apart(small, large, shared), "move one of them away")
            yield (small.name, large.name), text, fix


@once_a_pair
def _shared(one: CheckedEntity, two: CheckedEntity) -> Floats | None:
    """The extents of what two solids share; None if it is thin, or in a coarse model of storage."""
    low, high = np.maximum(one.low, two.low), np.minimum(one.high, two.high)
    if (high - low <= CONTACT).any() or not one.ground.intersects(two.ground):
        return None
    found = overlap(one.faces_over(low, high), two.faces_over(low, high), low, high, CONTACT)
    if found is None:
        return None
    extents, *shares = found
    sizes = [float(np.prod(e.high - e.low)) for e in (one, two)]
    for entity, around, share, size in zip((one, two), (two, one), shares, sizes, strict=True):
        within = (entity.low >= low - CONTACT).all() and (entity.high <= high + CONTACT).all()
        if within and share >= CONTENT and size <= SMALLER * max(sizes) and _stores(around, entity):
            return None
    return extents


def _stores(around: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid stands for one with an inside: by its type, or as its content is stated."""
    stated = entity.row["holder_id"] == around.row["id"] and entity.row["confidence"] is None
    return bool(around.row["storage"]) or (stated and entity.row["relation"] == "in")


def _belongs(building: SupportedBuilding, one: CheckedEntity, two: CheckedEntity) -> bool:
    """Whether both are parts of the building, or one is a fixture: those are built in."""
    fixed = bool(one.row["fixture"]) or bool(two.row["fixture"])
    return fixed or (building.is_part(one) and building.is_part(two))


def _one_point(building: SupportedBuilding) -> Found:
    for group in building.one_point:
        names = tuple(e.name for e in group)
        x, y, z = group[0].stand
        last, apart = group[-1], max(group, key=lambda e: float(np.prod(e.high - e.low)))
        by = [d for d in _beside(last, apart) if len(group) == 2]
        fix = Moves(last, by, "move one of them away, or delete it if it is the same")
        away = max(float(np.abs(e.stand - group[0].stand).max()) for e in group)
        text = f"{listed(names)} are at one point: {x:.3f}, {y:.3f}, {z:.3f}"
        if away > SAME_POINT:
            text += f", up to {away:.3f} m apart, and of one size"
        yield names, text, fix


def _outside(building: SupportedBuilding) -> Found:
    outdoors = []
    for entity in [*building.objects, *building.agents] if building.rooms else ():
        if building.is_part(entity) or building.distance_to_rooms(entity) <= WALL:
            continue
        middle = (entity.low + entity.high) / 2
        within = building.built_over.covers(shapely.Point(*middle[:2]))
        if within or abs(middle[2]) > LOST:
            where = f"{middle[0]:.2f}, {middle[1]:.2f}, {middle[2]:.2f}"
            text = f"{entity.name} is in the building ({where}), but in no room"
            fix = "by hand: move it into a room, or add a room there"
            yield (entity.name,), text, fix
        else:
            outdoors.append(entity.name)
    if outdoors:
        count = f"{len(outdoors)} object{'s are' if len(outdoors) > 1 else ' is'} outside"
        text = f"{count} of the building: {listed(outdoors)}"
        yield tuple(outdoors), text, "by hand: add rooms where robots are to reach them"


def _room_pairs(building: SupportedBuilding, same: bool) -> Found:
    for number, room in enumerate(building.rooms):
        for n in np.sort(building.room_tree.query(room.ground)):
            other = building.rooms[n]
            low = max(building.floor(room), building.floor(other))
            high = min(building.ceiling(room), building.ceiling(other))
            if n <= number or high - low <= STEP:
                continue
            shared = common(room.ground, other.ground)
            is_same = shared.area >= 0.95 * united([room.ground, other.ground]).area
            if is_same != same or shared.buffer(-WALL / 2).is_empty:
                continue
            what = "are the same place" if same else f"overlap in {shared.area:.2f} m2"
            text = f"the rooms {room.name} and {other.name} {what}"
            fix = "by hand: delete one of them, or draw it again in gis_room"
            yield (room.name, other.name), text, fix


def _stacked(building: SupportedBuilding) -> Found:
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


def _off_storey(building: SupportedBuilding) -> Found:
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


def _no_door(building: SupportedBuilding) -> Found:
    joined = {p for d in building.doors for p in (d.row["place_a"], d.row["place_b"])}
    for room in building.rooms if len(building.rooms) > 1 else ():
        if room.row["id"] not in joined:
            yield (room.name,), f"no door leads to the room {room.name}", _door(building, room)


def _door(building: SupportedBuilding, room: CheckedEntity) -> str:
    """A door to the nearest room beside a room, in the middle of their longest common wall."""
    floor = building.floor(room)
    level = [r for r in building.rooms if r is not room and abs(building.floor(r) - floor) <= STEP]
    for other in sorted(level, key=lambda r: (r.ground.distance(room.ground), r.name)):
        edges = without(room.ground.boundary, other.ground)
        beside = edges.intersection(other.ground.buffer(WALL - SAME_POINT, cap_style="flat"))
        points = shapely.get_coordinates(room.ground)
        walls = [
            part
            for pair in itertools.pairwise(points)
            for part in shapely.get_parts(shapely.LineString(pair).intersection(beside))
            if part.length >= DOOR
        ]
        if walls:
            wall = max(walls, key=lambda part: float(part.length))
            ends = [
                tuple(float(v) for v in wall.interpolate(wall.length / 2 + d).coords[0])
                for d in (-DOOR / 2, DOOR / 2)
            ]
            line = ", ".join(f"({x:.3f}, {y:.3f})" for x, y in ends)
            name, taken = f"door of {room.name}", {e.name for e in building.entities}
            while name in taken:
                name += "_"
            return (
                f"map.add_door({name!r}, {room.name!r}, {other.name!r}, ({line}), "
                f"height={floor:.3f})"
            )
    return "by hand: draw its door in gis_connector; no room is beside it on its floor"


def _wall_at(building: SupportedBuilding, door: CheckedEntity) -> float:
    """How far a door may be from its rooms: the thickness of their wall there, if it is thick.

    Measured across the opening, a tenth of its width within its posts; no third room is in it.
    """
    assert door.pose is not None
    ends = [building.by_id.get(door.row[f"place_{end}"]) for end in "ab"]
    rooms = [room for room in ends if room is not None and room.kind == "room" and room.outline]
    inner = 0.4 * (door.row["width"] or 0.0)
    if len(rooms) < 2 or rooms[0] is rooms[1] or not inner:
        return WALL
    thick = WALL
    for y in (-inner, inner):
        reach = THICKEST + FASTENED
        across = shapely.LineString(door.pose.apply([[-reach, y, 0], [reach, y, 0]])[:, :2])
        faces = [across.intersection(room.outline) for room in rooms]
        if any(face.is_empty for face in faces) or shapely.distance(*faces) > THICKEST:
            return WALL
        wall = shapely.shortest_line(*faces)
        for number in building.room_tree.query(wall, predicate="intersects"):
            other = building.rooms[number]
            level = abs(building.floor(other) - building.floor(rooms[0])) <= STEP
            if other not in rooms and level and wall.intersection(other.outline).length > 0.1:
                return WALL
        thick = max(thick, wall.length + FASTENED)
    return thick


def _far_doors(building: SupportedBuilding) -> Found:
    for door in building.doors:
        assert door.pose is not None
        stairs = door.row["form"] in ("stairs", "ramp")
        half = (door.row["width"] or 0.0) / 2
        opening = shapely.LineString(door.pose.apply([[0, -half, 0], [0, half, 0]])[:, :2])
        reach = WALL if stairs else _wall_at(building, door)
        for end in "ab":
            room = building.by_id.get(door.row[f"place_{end}"])
            if room is None or room.outline is None or room.kind != "room":
                continue
            stand = door.pose @ Pose(*door.row[f"pose_{end}"])
            here = shapely.Point(stand.x, stand.y) if stairs else opening
            gap = float(here.distance(room.outline))
            rise = abs((stand.z if stairs else door.pose.z) - building.floor(room))
            if gap <= reach and rise <= STEP:
                continue
            how = f"{gap:.2f} m beside" if gap > reach else f"{rise:.2f} m above or below"
            text = f"the door {door.name} is {how} the room {room.name}, which it joins"
            yield (door.name, room.name), text, _door_moves(building, door, room, here)


def _no_passage(building: SupportedBuilding) -> Found:
    """Doors too narrow, that end beside a room, or that join a room with itself from outside."""
    off = {names[0] for names, *_ in _far_doors(building)}
    for door in building.doors:
        assert door.pose is not None
        rooms = [building.by_id.get(door.row[f"place_{end}"]) for end in "ab"]
        outlines = [r.outline for r in rooms if r is not None and r.outline is not None]
        width = door.row["width"] or 0.0
        flat = door.pose.apply(
            [[0, -width / 2, 0], [0, width / 2, 0], [-AHEAD, 0, 0], [AHEAD, 0, 0]]
        )
        spots = shapely.points(flat[:, :2])
        beside = max((float(shapely.distance(spots[:2], o).max()) for o in outlines), default=0.0)
        why = None
        if 0 < width < NARROWEST:
            why = f"is {width:.2f} m wide"
        elif door.row["form"] not in ("door", "elevator_door") or door.name in off:
            continue  # another rule says so
        elif rooms[1] is None and (inside := _behind_exit(building, door, rooms[0])) is not None:
            why = f"leads outside, but {inside} is on its other side"
        elif rooms[0] is rooms[1] and not shapely.covers(outlines[:1], spots[2:]).all():
            why = "joins a room with itself, and is not in it"
        elif beside > max(_wall_at(building, door) + SAME_POINT, width / 10):  # the rest is wide
            why = f"ends {beside:.2f} m beside a room that it joins"
        if why is not None:
            fix = "by hand: draw it again in gis_connector, in the wall of its rooms, or delete it"
            yield (door.name,), f"the door {door.name} {why}", fix


def _behind_exit(
    building: SupportedBuilding, door: CheckedEntity, room: CheckedEntity | None
) -> str | None:
    """The room in which a robot would be that takes a door outside; None if it is outside."""
    if door.pose is None or room is None or room.outline is None:
        return None
    ways = door.pose.apply([[x, 0, 0] for x in (0, AHEAD, PASSAGE, -AHEAD, -PASSAGE)])[:, :2]
    middle, *sides = ways
    inner = shapely.covers(room.outline, shapely.points(sides[::2]))
    if inner.all():
        return str(room.name)
    for within, end in zip(inner, sides[1::2], strict=True):
        way = shapely.LineString([middle, end]).difference(room.outline)
        for number in building.room_tree.query(way) if not within else ():
            other = building.rooms[number]
            level = other is not room and abs(building.floor(other) - building.floor(room)) <= STEP
            if level and way.intersection(other.outline).length > FASTENED:
                return str(other.name)
    return None


def _door_moves(
    building: SupportedBuilding, door: CheckedEntity, room: CheckedEntity, here: shapely.Geometry
) -> Moves:
    """To the wall of the room, to the middle between it and the other one, and to its floor."""
    assert door.pose is not None
    x, y, z = door.pose.translation
    edge = shapely.ops.nearest_points(room.outline, here.centroid)[0]
    spots = [(edge.x, edge.y)]
    for end in "ab":
        other = building.by_id.get(door.row[f"place_{end}"])
        if other is not None and other is not room and other.outline is not None:
            one, two = shapely.ops.nearest_points(room.outline, other.outline)
            beside = shapely.ops.nearest_points(other.outline, edge)[0]
            spots += [((edge.x + beside.x) / 2, (edge.y + beside.y) / 2)]
            spots += [((one.x + two.x) / 2, (one.y + two.y) / 2)]
    heights = {z, building.floor(room)}
    by = [
        (u - x, v - y, w - z) for w in sorted(heights, key=lambda w: abs(w - z)) for u, v in spots
    ]
    return Moves(door, by, "draw it again in gis_connector, in the wall of both of its rooms")


def _blocked(building: SupportedBuilding, structure: bool) -> Found:
    """Doors in whose opening parts of the building stand, or else other things."""
    for door, opening, shut in _shut_doors(building):
        if _is_fast(building, door, shut[0]) != structure:
            continue
        assert door.pose is not None
        names = tuple(sorted(e.name for e in shut))
        stand = "stands" if len(names) == 1 else "stand"
        passes = opening.passing([*opening.solids])  # also by what else is there
        text = f"{listed(names)} {stand} in the opening of {door.name}: {passes}"
        fix = "by hand: move it, if it is there"
        if structure:
            fix = "by hand: give the wall an opening there, or move or delete the door or the wall"
        elif _is_in_opening(door, shut[0]):
            fix = "by hand: if it is the leaf of the door, give it the type door_leaf; else move it"
        yield (door.name, *names), text, fix


def _is_fast(building: SupportedBuilding, door: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid is a part of the building that never opens: no curtain, and no leaf."""
    known = bool(entity.row["structure"])
    loose = entity.row["fixture"] or (not known and _is_in_opening(door, entity))
    return building.is_part(entity) and not loose


def _is_in_opening(door: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid is as thin as leaves and within the opening of a door, as leaves are."""
    assert door.pose is not None
    reach = np.abs(door.pose.inverse().apply(entity.hull))[:, :2]
    thick, wide = np.ptp(door.pose.inverse().apply(entity.hull)[:, 0]), (door.row["width"] or DOOR)
    return bool(thick <= LEAF and (reach.max(axis=0) <= [WALL, wide / 2 + LEAF]).all())


@lru_cache(maxsize=1)  # for both rules of the same building
def _shut_doors(
    building: SupportedBuilding,
) -> list[tuple[CheckedEntity, DoorOpening[CheckedEntity], list[CheckedEntity]]]:
    """The doors that are closed by parts of the building, or else by things with them."""
    off = {names[0] for names, *_ in _far_doors(building)}
    found = []
    for door in building.doors:
        if door.name in off or door.row["form"] not in ("door", "elevator_door"):
            continue  # another rule says so
        assert door.pose is not None
        width = door.row["width"] or DOOR
        solids = [e for e in building.at_opening(door.pose, width) if e.row["type"] != "door_leaf"]
        opening = DoorOpening(door.pose, width, {e: e.triangles for e in solids})
        fast = partial(_is_fast, building, door)
        parts = opening.closing(e for e in solids if fast(e))
        if shut := parts or sorted(opening.closing(solids), key=fast):
            found.append((door, opening, shut))
    return found


def _narrow(building: SupportedBuilding) -> Found:
    """Doors whose stated opening is narrower or lower than a robot of which nothing is known."""
    for door in building.doors:
        width, height = door.row["width"] or PASSAGE, door.row["clear_height"] or LINTEL
        if door.row["form"] not in ("door", "elevator_door") or width < NARROWEST:
            continue  # another rule says so
        for size, least, how, who in (
            (width, PASSAGE, "wide", "narrower"),
            (height, LINTEL, "high", "lower"),
        ):
            if size < least - SAME:
                passes = f"only a robot {who} than {size:.2f} m passes"
                text = f"the door {door.name} is {size:.2f} m {how}: {passes}"
                yield (door.name,), text, "by hand: state its clear opening, if it is larger"


def _no_floor(building: SupportedBuilding) -> Found:
    for storey in building.storeys:
        assert storey.pose is not None
        z = storey.pose.z
        if any(abs(building.floor(r) - z) <= STEP or storey in r.chain for r in building.rooms):
            continue
        if any(_is_level(e, z) for e in building.solids):
            continue
        fix = "by hand: add a room on it, or delete it"
        yield (storey.name,), f"the storey {storey.name} at {z:.2f} m has no room and no floor", fix


def _is_level(entity: CheckedEntity, z: float) -> bool:
    faces = entity.triangles
    flat = (np.abs(faces[:, :, 2] - z) <= STEP).all(axis=1) & (
        np.ptp(faces[:, :, 2], axis=1) <= CONTACT
    )
    return float(shapely.area(shapely.polygons(faces[flat][:, :, :2])).sum()) >= FLOOR_AREA


def _shapeless(building: SupportedBuilding) -> Found:
    names = tuple(e.name for e in building.objects if e.outline is None)
    if names:
        count = f"{len(names)} object{'s have' if len(names) > 1 else ' has'}"
        text = f"{count} no geometry, so grids take them as free: {listed(names)}"
        fix = "by hand: import again with the model_path of their models, or assume_sizes=True"
        yield names, text, fix


def _shapeless_places(building: SupportedBuilding) -> Found:
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


def _stale(building: SupportedBuilding) -> Found:
    for entity in building.entities:
        world = entity.row["world"]
        if entity.pose is None:
            continue
        shown = np.array(world if world is not None else [np.inf] * 7, float)
        here = np.array(entity.pose)
        turn = min(np.abs(shown[3:] - here[3:]).max(), np.abs(shown[3:] + here[3:]).max())
        size = 1 + np.abs(here[:3]).max()
        if max(np.abs(shown[:3] - here[:3]).max(), turn) > 1e-6 * size:
            text = f"the world pose of {entity.name} is not its holder's pose times its placement"
            yield (entity.name,), text, f"SELECT refresh_world(ARRAY[{entity.row['id']}])"


def _wrong_room(building: SupportedBuilding) -> Found:
    for entity in [*building.objects, *building.agents]:
        if building.is_part(entity) or (entity.outline is None and entity.low is entity.high):
            continue
        if entity.holder is not None and entity.holder.kind in ("object", "agent"):
            continue  # its room is that of its place, not that of what it stands on
        shares = building.shares(entity)
        said = next((e for e in entity.chain if e.kind == "room"), None)
        says = None if said is None else said.name
        best = max(shares, key=lambda n: shares[n], default=None)
        lost = said is not None and (
            says in {r.name for r in building.rooms}
            and not shares.get(says)
            and entity.ground.distance(building.by_id[said.row["id"]].ground) > STEP
        )
        elsewhere = (
            best not in (None, says)
            and shares[best] >= MOSTLY
            and (says is None or shares.get(says, 0.0) < 1 - MOSTLY)
        )
        if elsewhere and sum(share >= MOSTLY for share in shares.values()) > 1:
            continue  # rooms overlap: another rule says so
        if not lost and not elsewhere:
            continue
        place = "in no room" if best is None else f"in {best} ({shares[best]:.0%} of its ground)"
        held = "no room" if says is None else says
        text = f"the inventory has {entity.name} in {held}, but it is {place}"
        fix = f"SELECT derive_again(ARRAY[{entity.row['id']}])"
        yield (entity.name, *([] if says is None else [says])), text, fix


def _wrong_holder(building: SupportedBuilding) -> Found:
    for entity in building.solids:
        holder = entity.holder
        if holder is None or holder.kind != "object" or not len(holder.triangles):
            continue
        gaps = np.maximum(holder.low - entity.high, entity.low - holder.high)
        apart = float(gaps.max())
        if apart > 2 * CONTACT:
            text = (
                f"the inventory has {entity.name} {entity.row['relation']} {holder.name}, "
                f"but they are {apart:.2f} m apart"
            )
            fix = f"SELECT derive_again(ARRAY[{entity.row['id']}])"
            yield (entity.name, holder.name), text, fix


def _apart(small: CheckedEntity, large: CheckedEntity, shared: Floats) -> list[Floats]:
    """Moves of the smaller one out of the other: by what they share, or past its box."""
    by = [
        sign * (float(shared[axis]) + 0.01) * np.eye(3)[axis] for axis in (0, 1) for sign in (-1, 1)
    ]
    return sorted([*by, *_beside(small, large)], key=lambda d: float(np.linalg.norm(d)))


def _beside(small: CheckedEntity, large: CheckedEntity) -> list[Floats]:
    """Moves of one beside the box of another, and onto it; the shortest first."""
    by = [np.array([0, 0, large.high[2] - small.low[2]])]
    for axis in (0, 1):
        for to in (large.high[axis] - small.low[axis], large.low[axis] - small.high[axis]):
            by.append((to + np.sign(to) * 0.04) * np.eye(3)[axis])
    return sorted(by, key=lambda d: float(np.linalg.norm(d)))


RULES: tuple[tuple[str, Severity, Callable[[SupportedBuilding], Found]], ...] = (
    ("stale pose", "error", _stale),
    ("wrong room", "error", _wrong_room),
    ("wrong holder", "error", _wrong_holder),
    ("identical rooms", "error", partial(_room_pairs, same=True)),
    ("door away from its room", "error", _far_doors),
    ("blocked door", "error", partial(_blocked, structure=True)),
    ("things at one point", "error", _one_point),
    ("room off its storey", "error", _off_storey),
    ("no passage", "warning", _no_passage),
    ("narrow door", "warning", _narrow),
    ("thing in a doorway", "warning", partial(_blocked, structure=False)),
    ("overlapping rooms", "warning", partial(_room_pairs, same=False)),
    ("room without a door", "warning", _no_door),
    ("storey without a floor", "warning", _no_floor),
    ("things without a storey", "warning", _no_storey),
    ("rooms without storeys", "warning", _stacked),
    ("floating", "warning", _floating),
    ("tipping", "warning", _tipping),
    ("sunk", "warning", _sunk),
    ("penetrating", "warning", _penetrating),
    ("place without geometry", "warning", _shapeless_places),
    ("outside of all rooms", "note", _outside),
    ("without geometry", "note", _shapeless),
)
"""By severity, the gravest first."""

MOVED = {
    "door away from its room",
    "blocked door",
    "no passage",
    "thing in a doorway",
    "things at one point",
    "things without a storey",
    "floating",
    "tipping",
    "sunk",
    "penetrating",
    "outside of all rooms",
}
"""The kinds that a move of an object or door can change; holders follow it by themselves."""
