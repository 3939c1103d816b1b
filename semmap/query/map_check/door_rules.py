"""Rules on doors: their place in walls, and the robots that pass them."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from itertools import combinations

import numpy as np
import shapely
import shapely.ops

from semmap.geometry.overlay import common
from semmap.geometry.pose import Pose
from semmap.geometry.walk import EXACT, walked_faces
from semmap.query.geometry_notes import listed
from semmap.query.map_check.building import (
    FASTENED,
    LINTEL,
    SAME_POINT,
    STEP,
    THICKEST,
    WALL,
)
from semmap.query.map_check.doorways import NARROWEST, PASSAGE, SAME, DoorOpening
from semmap.query.map_check.fixes import Found, Moves
from semmap.query.map_check.reader import CheckedEntity, Floats
from semmap.query.map_check.room_rules import DOOR
from semmap.query.map_check.support import SupportedBuilding

AHEAD = 0.35
"""Metres before and behind a door that are in the rooms that it joins, behind walls."""

LEAF = 0.1
"""Metres of the thickest leaf of a door with its handles, and by which it covers its frame."""

OVERLAP = 0.1
"""Metres of their openings that two doors side by side share at most: leaves of one frame."""

PART = 0.2
"""Of the width of an opening: frames and open leaves take less of it, one leaf of several more."""

FRAME, ACROSS = 0.2, 0.9
"""Metres around an opening where its shut leaf is, and the part of the ground that is there."""


def _wall_at(building: SupportedBuilding, door: CheckedEntity) -> float:
    """How far a door may be from its rooms: the thickness of their wall there, if it is thick.

    Measured across the opening, a tenth of its width within its posts; no third room is in it.
    """
    assert door.pose is not None
    rooms = [*building.drawn_rooms(door).values()]
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


def far_doors(building: SupportedBuilding) -> Found:
    """Doors away from the rooms that they join."""
    for door in building.doors:
        assert door.pose is not None
        stairs = door.row["form"] in ("stairs", "ramp")
        half = (door.row["width"] or 0.0) / 2
        opening = shapely.LineString(door.pose.apply([[0, -half, 0], [0, half, 0]])[:, :2])
        wall = WALL if stairs else _wall_at(building, door)
        for end, room in building.drawn_rooms(door).items():
            stand = door.pose @ Pose(*door.row[f"pose_{end}"])
            here = shapely.Point(stand.x, stand.y) if stairs else opening
            gap = float(here.distance(room.ground))
            faces_it = room.ground.distance(shapely.Point(stand.x, stand.y)) <= FASTENED
            reach = wall if faces_it else WALL  # in a thick wall, who faces it is in the room
            rise = abs((stand.z if stairs else door.pose.z) - building.floor(room))
            if gap <= reach and rise <= STEP:
                continue
            how = f"{gap:.2f} m beside" if gap > reach else f"{rise:.2f} m above or below"
            text = f"the door {door.name} is {how} the room {room.name}, which it joins"
            yield (door.name, room.name), text, _door_moves(building, door, room, here)


def no_passage(building: SupportedBuilding) -> Found:
    """Doors too narrow, that end beside a room, or that join a room with itself from outside."""
    off = {names[0] for names, *_ in far_doors(building)}
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
    for other in building.drawn_rooms(door).values():
        if other is not room:
            one, two = shapely.ops.nearest_points(room.outline, other.outline)
            beside = shapely.ops.nearest_points(other.outline, edge)[0]
            spots += [((edge.x + beside.x) / 2, (edge.y + beside.y) / 2)]
            spots += [((one.x + two.x) / 2, (one.y + two.y) / 2)]
    heights = {z, building.floor(room)}
    by = [
        (u - x, v - y, w - z) for w in sorted(heights, key=lambda w: abs(w - z)) for u, v in spots
    ]
    return Moves(door, by, "draw it again in gis_connector, in the wall of both of its rooms")


def blocked_doors(building: SupportedBuilding, structure: bool) -> Found:
    """Doors in whose opening parts of the building stand, or else other things."""
    for door, opening, shut in _shut_doors(building):
        if _is_fast(building, door, shut[0]) != structure:
            continue
        assert door.pose is not None
        names = tuple(sorted(e.name for e in shut))
        stand = "stands" if len(names) == 1 else "stand"
        passes = opening.passing([*opening.solids])  # also by what else is there
        where = "before" if all(_is_in_a_room(building, door, e) for e in shut) else "in"
        text = f"{listed(names)} {stand} {where} the opening of {door.name}: {passes}"
        fix = "by hand: move it, if it is there"
        if structure:
            fix = "by hand: give the wall an opening there, or move or delete the door or the wall"
        elif _is_in_opening(door, shut[0]):
            fix = "by hand: if it is the leaf of the door, give it the type door_leaf; else move it"
        yield (door.name, *names), text, fix


def _is_in_a_room(building: SupportedBuilding, door: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid is in a room of a door, and not in the wall between them."""
    rooms = building.drawn_rooms(door).values()
    return any(room.ground.buffer(SAME_POINT).covers(entity.ground) for room in rooms)


def _is_fast(building: SupportedBuilding, door: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid is a part of the building that never opens: no curtain, and no leaf."""
    known = bool(entity.row["structure"])
    loose = entity.row["fixture"] or (not known and _is_in_opening(door, entity))
    return building.is_part(entity) and not loose


def shut_leaves(building: SupportedBuilding) -> Found:
    """Doors that are open by their state, with a leaf across the opening."""
    for door in building.doors:
        if door.row["state"] != "open" or door.row["form"] != "door":
            continue  # the door of an elevator opens by itself
        assert door.pose is not None
        width = door.row["width"] or DOOR
        at = building.at_opening(door.pose, width)
        leaves = {e: e.triangles for e in at if _is_leaf_of(door, e)}
        opening = DoorOpening(door.pose, width, leaves)
        shut = opening.closing(leaves)
        fix = f"map[{door.name!r}].state = 'closed'  # or turn the leaf, if it is open"
        part = ""
        if not shut and (gap := opening.gap(leaves)) < (1 - PART) * width:
            shut = [e for e in leaves if opening.taken(e)]
            part = f"{width - gap:.2f} m of the {width:.2f} m of "
            fix = "by hand: state the clear opening of the door, or turn the leaf, if it is open"
        if shut:
            names = tuple(sorted(e.name for e in shut))
            close = f"{'closes' if len(names) == 1 else 'close'} {part}{door.name}"
            text = f"{listed(names)} {close}, whose state is open: all of it counts as open"
            yield (door.name, *names), text, fix


def _is_leaf_of(door: CheckedEntity, entity: CheckedEntity) -> bool:
    """Whether a solid is a leaf by its type, and stands across the opening of a door."""
    assert door.pose is not None
    half = (door.row["width"] or DOOR) / 2 + FRAME
    corners = door.pose.apply([[x, y, 0] for x in (-FRAME, FRAME) for y in (-half, half)])
    across = shapely.MultiPoint(corners[:, :2]).convex_hull
    share = common(entity.ground, across).area / max(entity.ground.area, SAME)
    low, high = entity.low[2] - door.pose.z, entity.high[2] - door.pose.z
    return bool(entity.row["leaf"] and share >= ACROSS and low <= FRAME < high)


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
    off = {names[0] for names, *_ in far_doors(building)}
    found = []
    for door in building.doors:
        if door.name in off or door.row["form"] not in ("door", "elevator_door"):
            continue  # another rule says so
        assert door.pose is not None
        width = door.row["width"] or DOOR
        floors = [building.floor(room) for room in building.drawn_rooms(door).values()]
        sill = door.pose._replace(z=max(door.pose.z, *floors))  # another rule finds a step to it
        solids = [e for e in building.at_opening(sill, width) if not _is_leaf_of(door, e)]
        shapes = {e: _above_ground(e, floors) for e in solids}
        opening = DoorOpening(sill, width, shapes)
        fast = partial(_is_fast, building, door)
        parts = opening.closing(e for e in solids if fast(e))
        if shut := parts or sorted(opening.closing(solids), key=fast):
            found.append((door, opening, shut))
    return found


def _above_ground(entity: CheckedEntity, floors: list[float]) -> Floats:
    """The faces of a solid without those that a robot of which nothing is known drives on."""
    faces = entity.triangles
    return faces[~walked_faces(faces, floors, DRIVEN, SLOPE)] if entity.row["laid"] else faces


TWICE = 0.1
"""Metres between two doors that are one; leaves of a double door are further apart."""

DRIVEN, SLOPE = 0.02, math.radians(6)
"""Metres of the highest step, and the steepest slope, of a robot of which nothing is known."""


def narrow_doors(building: SupportedBuilding) -> Found:
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


def steps_in_doors(building: SupportedBuilding) -> Found:
    """Doors between rooms whose floors differ by more than a robot drives over."""
    rooms = {room.row["id"]: room for room in building.rooms}
    for door in building.doors:
        ends = [rooms[n] for n in (door.row["place_a"], door.row["place_b"]) if n in rooms]
        if door.row["form"] in ("stairs", "ramp") or len(ends) < 2:
            continue
        step = abs(building.floor(ends[0]) - building.floor(ends[1]))
        if step > DRIVEN + EXACT and not _has_ramp(building, door, ends):
            text = (
                f"the floors of {ends[0].name} and {ends[1].name} differ by {step:.2f} m at the "
                f"door {door.name}: only a robot that takes such a step passes"
            )
            names = (door.name, ends[0].name, ends[1].name)
            fix = "by hand: give a ramp there the type ramp, add stairs, or correct the floors"
            yield names, text, fix


def _has_ramp(building: SupportedBuilding, door: CheckedEntity, ends: list[CheckedEntity]) -> bool:
    """Whether a ramp leads from the floor of one room of a door to that of the other."""
    assert door.pose is not None
    low, high = sorted(building.floor(room) for room in ends)
    return any(
        e.row["ramp"] and e.low[2] <= low + DRIVEN and abs(e.high[2] - high) <= DRIVEN
        for e in building.at_opening(door.pose, door.row["width"] or DOOR)
    )


def level_stairs(building: SupportedBuilding) -> Found:
    """Stairs and ramps that lead to the height from which they come."""
    for door in building.doors:
        assert door.pose is not None
        if door.row["form"] not in ("stairs", "ramp"):
            continue
        ends = [(door.pose @ Pose(*door.row[f"pose_{end}"])).z for end in "ab"]
        rooms = building.drawn_rooms(door)
        floors = [building.floor(room) for room in rooms.values()]
        if max(np.ptp(ends), np.ptp(floors or ends)) > DRIVEN:
            continue
        form = "stairs" if door.row["form"] == "stairs" else "the ramp"
        text = f"both ends of {form} {door.name} are at {ends[0]:.2f} m: nothing is climbed there"
        names = (door.name, *dict.fromkeys(room.name for room in rooms.values()))
        yield names, text, "by hand: join it to the room where it ends, or add it as a door"


def overlapping_doors(building: SupportedBuilding) -> Found:
    """Doors of the same rooms of which one is partly in the opening of the other."""
    twins = {names for names, *_ in doors_at_one_point(building)}
    lines = {}
    for door in building.doors:
        if door.pose is not None and door.row["form"] == "door":
            half = (door.row["width"] or DOOR) / 2
            lines[door] = shapely.LineString(door.pose.apply([[0, -half, 0], [0, half, 0]])[:, :2])
    for one, two in combinations(lines, 2):
        ends = ({door.row["place_a"], door.row["place_b"]} for door in (one, two))
        assert one.pose is not None
        assert two.pose is not None
        if next(ends) != next(ends) or abs(one.pose.z - two.pose.z) > STEP:
            continue
        near = lines[two].buffer(WALL, cap_style="flat")
        shared = lines[one].intersection(near).length
        if shared > OVERLAP and (one.name, two.name) not in twins:
            text = f"the doors {one.name} and {two.name} share {shared:.2f} m of their openings"
            fix = "by hand: delete one of them, or draw it again in gis_connector"
            yield (one.name, two.name), text, fix


def doors_at_one_point(building: SupportedBuilding) -> Found:
    """Doors of the same rooms whose middles are one: one of them is shut or opened in vain."""
    placed = [(door, door.pose[:3]) for door in building.doors if door.pose is not None]
    for (one, here), (two, there) in combinations(placed, 2):
        ends = ({door.row["place_a"], door.row["place_b"]} for door in (one, two))
        if next(ends) == next(ends) and math.dist(here, there) <= TWICE:
            text = f"the doors {one.name} and {two.name} are at one point, and join the same rooms"
            yield (one.name, two.name), text, f"map[{two.name!r}].delete()"
