"""The judge of `Map.check`: faults are planted in a sound building, and it finds these alone."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator

import shapely

import semmap
from semmap.geometry.mesh import prism_mesh
from tests.buildings.beliefs import undone
from tests.buildings.building import OUTSIDE, Building, Item, room_of

Finding = tuple[str, frozenset[str]]

ONE_WAY = "one-way room"


def judge_faults(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """Of ten faults, the check finds each, and nothing else."""
    chance = random.Random(f"faults of {building.seed}")
    before = _found(place)
    with undone(place):
        planted = {
            *_floats(building, place, chance),
            *_meet(building, place, chance),
            *_is_off(building, place, chance),
            *_overlaps(building, place, chance),
            *_is_outside(building, place),
        }
        shut_in = [*_is_walled_up(building, place, chance, {n for _, who in planted for n in who})]
        planted |= {*shut_in}
        free = _free(building, place)
        for plant in (_near_twins, _piles, _sinks, _tips):
            planted |= {*plant(free, place, chance)}
        after = _found(place)
        poor = [*_poor_fixes(place, after)]
        shut = place.sql(
            "SELECT e.name FROM connector c JOIN entity e ON e.id = c.entity_id JOIN world w "
            "ON w.entity_id = e.id WHERE e.map_id = current_map() "
            "AND NOT is_at_its_rooms(c, w.pose)"
        )
        poor += [found for _, names in shut_in for found in _leads_through(building, place, names)]
        off = {min(names - {*_rooms(place)}) for kind, names in after if kind.startswith("door ")}
        if off != {name for (name,) in shut}:
            poor.append(f"routes refuse {shut}, not {off}")
    wrong = [f"not found: {kind} {sorted(names)}" for kind, names in planted - after]
    grown = {(kind, who) for kind, who in after for k, names in before if k == kind and who > names}
    new = after - before - planted - grown  # rooms that are cut off, and one more with them
    cut = {names for kind, names in before if kind == "room without a door"}
    if cut:  # the annex makes another group of rooms as large as the largest one
        largest = {*_rooms(place)}.difference({"annex"}, *cut)
        new -= {("room without a door", frozenset(largest))}
    was, now = ({names for kind, names in found if kind == ONE_WAY} for found in (before, after))
    if was - now:  # with the annex, another circle of rooms is the largest one
        new = {(kind, names) for kind, names in new if kind != ONE_WAY}
    elif any("annex" in names and names - {"annex"} in was for _, names in planted):
        new -= {(ONE_WAY, frozenset({"annex"}))}
    wrong += [f"invented: {kind} {sorted(names)}" for kind, names in new]
    return len(planted), wrong + poor


def _rooms(place: semmap.Map) -> set[str]:
    return {room.name for room in place.rooms}


def _poor_fixes(place: semmap.Map, before: set[Finding]) -> Iterator[str]:
    """The proposed calls that do not remove their finding, or add another one."""
    for found in place.check():
        if found.fix.startswith("by hand"):
            continue
        with undone(place):
            if found.safe:
                place.execute(found.fix)
            else:
                eval(found.fix, {"map": place})
            after = _found(place)
        names = set(found.entities)
        left = {(kind, who) for kind, who in after if kind == found.kind and who == names}
        new = {(kind, who) for kind, who in after - before if not who < names}
        if left | new:
            yield f"poor fix of {found}: {found.fix}: {left | new}"


def _found(place: semmap.Map) -> set[Finding]:
    return {(each.kind, frozenset(each.entities)) for each in place.check()}


def _clear(building: Building, item: Item, low: float, high: float, away: float) -> bool:
    """Whether nothing else is near a thing between two heights."""
    return not any(
        other.low < high and other.high > low and other.ground.distance(item.ground) < away
        for other in building.items
        if other.name not in (item.name, item.on)
    )


def _small(building: Building) -> list[Item]:
    """What stands on furniture, in the middle of one room, without a neighbour."""
    found = []
    for item in building.items:
        rooms = room_of(building, item) if item.on and item.points is None else set()
        if len(rooms) == 1:
            outline = building.room(min(rooms)).outline
            inside = outline.contains(item.ground) and outline.exterior.distance(item.ground) > 0.2
            if inside and _clear(building, item, item.low, item.high + 0.6, 0.2):
                found.append(item)
    return found


def _floats(building: Building, place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """A small thing in the air over its table."""
    small = _small(building)
    if small:
        item = chance.choice(small)
        x, y = item.centre
        pose = place[item.name].pose
        assert pose is not None
        place[item.name].move_to(x, y, pose.z + chance.uniform(0.15, 0.4))
        yield "floating", frozenset({item.name})


def _meet(building: Building, place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """Another thing exactly where one is."""
    floats = random.Random(f"faults of {building.seed}")
    small = _small(building)
    taken = floats.choice(small) if small else None
    small = [item for item in small if item is not taken]
    if small:
        item = chance.choice(small)
        size = (0.05, 0.04, 0.03)
        place.add_object("twin", size=size, pose=(*item.centre, item.low, building.angle))
        yield "things at one point", frozenset({"twin", item.name})


def _is_off(building: Building, place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """A door half a metre beside its wall, into one of its rooms."""
    doors = [d for d in building.doors if not d.climbs and OUTSIDE not in d.rooms]
    if doors:
        door = chance.choice(doors)
        (ax, ay), (bx, by) = door.ends
        far = chance.choice(door.rooms)
        turn = 0.5 / door.width
        middle = [(ax + bx) / 2, (ay + by) / 2]
        spots = [(middle[0] - s * (by - ay), middle[1] + s * (bx - ax)) for s in (turn, -turn)]
        (near,) = set(door.rooms) - {far}
        outline = building.room(near).outline
        x, y = min(spots, key=lambda spot: outline.distance(shapely.Point(spot)))
        pose = place[door.name].pose
        assert pose is not None
        place[door.name].move_to(x, y, pose.z)
        yield "door away from its room", frozenset({door.name, far})


def _is_walled_up(
    building: Building, place: semmap.Map, chance: random.Random, taken: set[str]
) -> Iterator[Finding]:
    """A wall across the opening of a door at which nothing stands."""
    things = [item.ground for item in building.items if item.what == "thing"]
    doors = [
        (door, line.buffer(0.03, cap_style="square"))
        for door in building.doors
        if not door.climbs and OUTSIDE not in door.rooms and door.name not in taken
        if (line := shapely.LineString(door.ends)).distance(shapely.union_all(things)) > 0.5
    ]
    if doors:
        door, ground = chance.choice(doors)
        floor = building.room(door.rooms[0]).floor
        mesh = prism_mesh(ground, floor, floor + 2.0)
        place.add_object("bricks", mesh=mesh, pose=(0, 0, 0), type="wall")
        yield "blocked door", frozenset({door.name, "bricks"})


def _leads_through(building: Building, place: semmap.Map, names: frozenset[str]) -> Iterator[str]:
    """A route through a door that is walled up."""
    (door,) = (door for door in building.doors if door.name in names)
    for ends in (door.rooms, door.rooms[::-1]):
        try:
            route = place.route(*ends)
        except ValueError:
            continue
        if any(step.connector.name == door.name for step in route.doors):
            yield f"a route from {ends[0]} to {ends[1]} leads through the wall in {door.name}"


def _overlaps(building: Building, place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """A room in another one, where nothing is."""
    for room in chance.sample(building.rooms, len(building.rooms)):
        taken = [
            item.ground
            for item in building.items
            if item.what in ("thing", "wall")
            and item.low < room.ceiling
            and item.high > room.floor - 0.1
        ]
        free = room.outline.buffer(-0.95).difference(shapely.union_all(taken).buffer(0.95))
        if room.elevator is None and not free.is_empty:
            at = free.representative_point()
            x, y = at.x, at.y
            square = shapely.box(x - 0.6, y - 0.6, x + 0.6, y + 0.6)
            place.add_room(
                "annex", square, floor=room.floor, ceiling=room.ceiling, storey=room.storey
            )
            line = ((x - 0.4, y - 0.6), (x + 0.4, y - 0.6))
            place.add_door("annex_door", "annex", room.name, line, height=room.floor)
            yield "overlapping rooms", frozenset({"annex", room.name})
            return


def _is_outside(building: Building, place: semmap.Map) -> Iterator[Finding]:
    """A thing on the ground, far from all rooms."""
    _, floor, _ = building.storeys[0]
    whole = shapely.union_all([item.ground for item in building.items])
    x = whole.bounds[2] + 4 + math.sqrt(2)
    place.add_object("stray", size=(0.3, 0.3, 0.3), pose=(x, whole.centroid.y, floor))
    yield "outside of all rooms", frozenset({"stray"})


Spot = tuple[float, float, float, str]
"""A point of the floor, its height, and its room."""


def _free(building: Building, place: semmap.Map) -> Iterator[Spot]:
    """Points of floors with 0.8 m between them, 0.4 m from what is in rooms and from walls."""
    annex = place["annex"].footprint if "annex" in {room.name for room in place.rooms} else None
    for room in building.rooms:
        taken = [
            item.ground
            for item in building.items
            if item.what in ("thing", "stub", "wall")
            and item.low < room.ceiling
            and item.high > room.floor - 0.1
        ]
        taken += [] if annex is None else [annex.buffer(0.3)]
        taken += [  # before a door they would be in its way
            shapely.LineString(door.ends).buffer(0.3)
            for door in building.doors
            if room.name in door.rooms or door.climbs
        ]
        free = room.outline.buffer(-0.4).difference(shapely.union_all(taken).buffer(0.4))
        while room.elevator is None and not free.is_empty:
            at = free.representative_point()
            yield at.x, at.y, room.floor, room.name
            free = free.difference(at.buffer(0.8))


def _near_twins(
    free: Iterator[Spot], place: semmap.Map, chance: random.Random
) -> Iterator[Finding]:
    """Two things of one size less than 3 cm apart."""
    for x, y, z, _ in itertools.islice(free, 1):
        sides = chance.uniform(0.1, 0.4), chance.uniform(0.1, 0.4), chance.uniform(0.1, 0.7)
        turn, away = chance.uniform(-3, 3), chance.uniform(0.003, 0.025)
        angle = chance.uniform(-3, 3)
        place.add_object("copy_a", size=sides, pose=(x, y, z, turn))
        beside = (x + away * math.cos(angle), y + away * math.sin(angle))
        place.add_object("copy_b", size=sides, pose=(*beside, z, turn))
        yield "things at one point", frozenset({"copy_a", "copy_b"})


def _piles(free: Iterator[Spot], place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """A table in the air with a mug on it: the table alone is wrong."""
    for x, y, z, _ in itertools.islice(free, 1):
        up = z + chance.uniform(0.1, 0.8)
        place.add_object("high_table", size=(0.5, 0.4, 0.6), pose=(x, y, up, chance.uniform(-3, 3)))
        place.add_object("high_mug", size=(0.08, 0.08, 0.1), on="high_table")
        yield "floating", frozenset({"high_table"})


def _sinks(free: Iterator[Spot], place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """A box whose lower part, or all of it, is below the floor."""
    for x, y, z, room in itertools.islice(free, 1):
        down = z - chance.choice([0.5, chance.uniform(0.07, 0.5)])
        place.add_object("sunk", size=(0.4, 0.3, 0.5), pose=(x, y, down, chance.uniform(-3, 3)))
        yield "sunk", frozenset({"sunk", room})


def _tips(free: Iterator[Spot], place: semmap.Map, chance: random.Random) -> Iterator[Finding]:
    """Two mugs over the edges of a table: one with most of its foot beside it, one with less."""
    for x, y, z, _ in itertools.islice(free, 1):
        turn = chance.uniform(-3, 3)
        place.add_object("low_table", size=(0.5, 0.4, 0.6), pose=(x, y, z, turn))
        for name, beside in (("tips", 0.27), ("stays", -0.23)):  # of 0.25 to the edge
            at = (x + beside * math.cos(turn), y + beside * math.sin(turn), z + 0.6)
            place.add_object(name, size=(0.1, 0.1, 0.1), pose=(*at, turn))
        yield "tipping", frozenset({"tips", "low_table"})
