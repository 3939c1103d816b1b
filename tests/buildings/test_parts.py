"""Parts of the building by shape: what a name says yields to what covers a room, and comes back."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import shapely
from sqlalchemy import Engine, text

import semmap
from tests.buildings.building import Building, Room
from tests.buildings.judges import judge_rooms, stored
from tests.conftest import Import, MakeDatabase

HOUSE = "small_house/worlds/small_house.world"
ROOMS = Path(__file__).parents[1] / "worlds" / "small_house_rooms.geojson"


def types_of(engine: Engine, pattern: str) -> set[str]:
    with engine.connect() as connection:
        names = connection.execute(
            text("SELECT type FROM entity WHERE name LIKE :pattern"), {"pattern": pattern}
        )
        return set(names.scalars())


def test_carpets_of_the_house_stay_carpets(imported: Import, worlds: Path) -> None:
    with imported((worlds / HOUSE, "house")) as engine:
        assert types_of(engine, "Carpet%") == {"carpet"}
    with imported((worlds / HOUSE, "house"), (ROOMS, "house")) as engine:
        assert types_of(engine, "Carpet%") == {"carpet"}


def test_a_floor_named_as_furniture_is_a_floor_while_a_room_lies_on_it(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = Building(0, 0.3, (5.0, -2.0))
    building.storeys.append(("s", 0.0, 2.5))
    slab = building.add("work_table", "floor", (0, 0, 3, 3), -0.2, 0.0)
    mug = building.add("mug", "thing", (1, 1, 1.1, 1.1), 0.0, 0.1)
    building.rooms.append(Room("r", "s", slab.ground.buffer(-0.1), 0.0, 2.5))
    world, rooms = building.write(tmp_path)
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        database.import_file(world, map="b")
        place = database.map("b")
        before = place[slab.name].type
        assert before not in ("floor", "object")
        database.import_file(rooms, map="b")
        assert place[slab.name].type == "floor"
        holder = place[mug.name].holder
        assert holder is not None
        assert holder.name == "r"
        place["r"].delete()
        database.import_file(world, map="b")
        assert place[slab.name].type == before


def two_rooms(angle: float = 0.0) -> Building:
    """Two rooms with a wall of 0.2 m between them, from x = 3.9 to 4.1; nothing is in them."""
    building = Building(0, angle, (0.0, 0.0))
    building.storeys.append(("s", 0.0, 2.7))
    for name, low, high in (("left", 0.0, 3.9), ("right", 4.1, 8.0)):
        outline = building.outline(shapely.box(low, 0, high, 9))
        building.rooms.append(Room(name, "s", outline, 0.0, 2.7))
    return building


def test_all_ways_say_one_room_of_what_is_as_near_to_two(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = two_rooms(0.3)  # turned: poses that are composed again differ in the last digits
    chance = random.Random(1)
    for k in range(40):
        y, long = 0.22 * k, chance.uniform(0.05, 0.2)
        building.add("zzp", "thing", (3.9, y, 4.1, y + long), 0.0, 1.1)
    with stored(building, make_database().render_as_string(hide_password=False), tmp_path) as place:
        for item in building.items:
            thing = place[item.name]
            rooms = {room for room in ("left", "right") if item.name in names_in(place, room)}
            assert thing.room is not None
            assert rooms == {thing.room.name}
            assert thing.holder is not None
            assert thing.holder.name == thing.room.name
        assert judge_rooms(building, place)[1] == []


def names_in(place: semmap.Map, room: str) -> set[str]:
    """What is in a room by `is_in`."""
    return {
        name
        for (name,) in place.sql(
            "SELECT o.name FROM entity o JOIN entity r ON r.map_id = o.map_id AND r.name = %s "
            "WHERE o.kind = 'object' AND o.map_id = current_map() AND is_in(o.id, r.id)",
            room,
        )
    }


def test_pieces_of_walls_are_walls_under_any_name(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = two_rooms()
    pieces = [
        building.add(name, "wall", (3.9, y, 4.1, y + long), 0.0, 2.7)
        for name, y, long in (
            ("zzp", 0.0, 0.3),
            ("zzp", 1.0, 0.9),
            ("zzp", 2.0, 1.4),
            ("bookcase", 4.0, 1.5),
            ("fridge", 6.0, 0.8),
        )
    ]
    pieces.append(building.add("bookcase", "wall", (-0.2, -0.2, 0.0, 9.2), 0.0, 2.7))
    others = [
        building.add("zzp", "thing", (3.9, 7.0, 4.1, 7.8), 0.0, 2.1),  # a door leaf ends lower
        building.add("fridge", "thing", (3.5, 8.2, 4.1, 8.8), 0.0, 2.6),  # in a room
        building.add("bookcase", "thing", (0.0, 3.0, 0.3, 5.0), 0.0, 2.7),  # in a room
        building.add("column", "thing", (8.0, 3.0, 8.2, 3.2), 0.0, 2.7),  # named as a part
        building.add("curtain", "thing", (8.0, 5.0, 8.1, 7.0), 0.0, 2.6),  # and as a fixture
    ]
    with stored(building, make_database().render_as_string(hide_password=False), tmp_path) as place:
        assert {piece.name: place[piece.name].type for piece in pieces} == {
            piece.name: "wall" for piece in pieces
        }
        assert all(place[piece.name].room is None for piece in pieces)
        assert "wall" not in {place[other.name].type for other in others}


def test_inner_walls_are_walls_where_outlines_meet_in_them_or_they_end_in_a_room(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = Building(0, 0.4, (3.0, -7.0))
    building.storeys.append(("s", 0.0, 2.7))
    for name, low, high in (("left", 0.0, 4.0), ("right", 4.0, 8.0)):
        outline = building.outline(shapely.box(low, 0, high, 20))
        building.rooms.append(Room(name, "s", outline, 0.0, 2.7))
    walls = [
        building.add("zzp", "wall", box, 0.0, top)
        for box, top in (
            ((3.93, 0.0, 4.03, 2.0), 2.5),  # 70 % in one room
            ((4.0, 2.5, 4.1, 4.0), 2.5),  # along the border, in one room alone
            ((3.88, 4.5, 4.1, 4.8), 2.7),  # a short piece of a thick wall
            ((3.8, 5.1, 4.09, 5.3), 2.7),  # a piece that is thicker than it is long
            ((0.0, 6.0, 1.2, 6.1), 2.5),  # from the border into a room
            ((2.0, 8.0, 2.2, 9.5), 2.7),  # free in a room: an outline knows no other walls
        )
    ]
    others = [
        building.add("zzp", "thing", box, low, top)
        for box, low, top in (
            ((0.0, 10.0, 0.3, 11.2), 0.0, 2.2),  # a wardrobe
            ((0.0, 11.5, 0.3, 13.0), 0.0, 2.6),  # and one up to the ceiling
            ((0.0, 13.5, 0.18, 14.5), 0.0, 2.5),  # a flat shelf
            ((0.0, 15.0, 0.05, 17.0), 0.8, 2.0),  # a whiteboard
            ((0.0, 18.0, 1.2, 18.3), 0.0, 2.5),  # shelves that divide the room
            ((3.7, 10.0, 3.98, 11.0), 0.0, 2.6),  # a wardrobe at the other room
            ((2.0, 14.0, 2.15, 14.3), 0.0, 2.6),  # a column or lamp
        )
    ]
    with stored(building, make_database().render_as_string(hide_password=False), tmp_path) as place:
        types = {item.name: place[item.name].type for item in building.items}
        assert [types[wall.name] for wall in walls] == ["wall"] * len(walls)
        assert "wall" not in {types[other.name] for other in others}
        assert {e.name for e in place.find(in_="left")} == {other.name for other in others}
        assert place.find(in_="right") == []


def test_small_tiles_and_planks_are_the_floor_and_bear_nothing(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = two_rooms(0.2)
    tiles = [
        building.add("qqw", "floor", (x, y, x + 0.498, y + 0.498), -0.02, 0.0)
        for x in np.arange(0, 3.9, 0.5)
        for y in np.arange(0, 9, 0.5)
    ]
    tiles += [
        building.add("Diele", "floor", (4.1, y, 8.0, y + 0.197), -0.03, 0.0)
        for y in np.arange(0, 9, 0.2)
    ]
    things = [
        building.add("zzp", "thing", (1.05, 1.05, 1.4, 1.4), 0.0, 0.7),
        building.add("mug", "thing", (5.02, 5.02, 5.1, 5.1), 0.0, 0.1),
        building.add("book", "thing", (6.0, 6.0, 6.2, 6.3), 0.0, 0.03),
        building.add("zzp", "thing", (2.0, 2.0, 2.4, 2.6), 0.0, 0.02),  # a mat on the tiles
    ]
    with stored(building, make_database().render_as_string(hide_password=False), tmp_path) as place:
        assert {place[tile.name].type for tile in tiles} == {"floor"}
        holders = [place[thing.name].holder for thing in things]
        assert [holder and holder.name for holder in holders] == ["left", "right", "right", "left"]
