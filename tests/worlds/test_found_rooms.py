"""Rooms found in the walls of real worlds, compared with those that their makers drew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import semmap
from navgrid.found_rooms import find_rooms
from semmap.query.storey_reader import read_storeys
from tests.buildings.found_rooms import Score, score_doors, score_rooms
from tests.worlds.conftest import HOUSE

DRAWN = ("room", "connector", "region")


@pytest.mark.parametrize("world", ["hotel", "clinic"])
def test_most_drawn_rooms_and_doors_of_a_building_are_found(
    database: str, worlds: Path, world: str
) -> None:
    rooms, doors = Score(), Score()
    with semmap.connect(database) as db:
        db.import_file(worlds / "rmf" / world / f"{world}.building.yaml", map="found")
        with db.map("found").snapshot() as seen:
            scenes = read_storeys(seen)
    for scene in scenes:
        entities = tuple(e for e in scene.entities if e.kind not in DRAWN)
        found = find_rooms(replace(scene, entities=entities, floors=()))
        known = [e for e in scene.entities if e.kind == "room" and "elevator_cabin" not in e.types]
        rooms += score_rooms([e.footprint for e in known], [r.outline for r in found.rooms])
        sides = [e.sides for e in scene.entities if e.kind == "connector" and e.sides]
        doors += score_doors(
            [[pose.translation for pose in pair] for pair in sides],
            [way.line.coords for way in found.doorways],
        )
    # Bathrooms of the hotel, and corners of the clinic's corridor, are drawn as parts of rooms.
    assert rooms.recall >= (0.95 if world == "hotel" else 0.8), rooms
    assert rooms.precision >= 0.6, rooms
    assert doors.recall >= 0.9, doors
    assert doors.precision >= 0.7, doors


def test_a_furnished_world_without_rooms_gets_rooms_types_and_routes(
    database: str, worlds: Path
) -> None:
    with semmap.connect(database) as db:
        house = db.create_map("bare_house")
        house.import_file(worlds / HOUSE)
        assert len(house.rooms) == 0

        house.find_rooms(add=True)

        types = {room.type: room for room in house.rooms}
        assert set(types) == {"balcony", "bedroom", "kitchen"}
        assert house["Bed_01_001"].room == types["bedroom"]
        assert house["Refrigerator_01_001"].room == types["kitchen"]
        assert "Bed_01_001" in types["bedroom"].properties["found"]["shown_by"]
        assert house.route(types["balcony"].name, types["bedroom"].name).metres > 5
        (again,) = house.find_rooms(add=True)
        assert (again.rooms, again.doorways, len(again.known)) == ((), (), 3)

        types["bedroom"].name = "our bedroom"
        (again,) = house.find_rooms(add=True)
        assert again.rooms == ()
        assert "our bedroom" in again.known
