"""Rooms one above the other with no slab between: what is at the floor is in the upper one."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap

THINGS = {
    "chair without shape": (None, 3.0, "up"),
    "chair": ((0.4, 0.4, 0.9), 3.0, "up"),
    "rug": ((1.0, 1.0, 0.005), 3.0, "up"),
    "rug that sank": ((1.0, 1.0, 0.008), 2.997, "up"),
    "lamp at the ceiling": ((0.3, 0.3, 0.02), 2.97, "low"),
    "smoke detector without shape": (None, 2.95, "low"),
    "table": ((0.8, 0.8, 0.7), 0.0, "low"),
}
"""The size, the height of the bottom and the room of each."""


@pytest.fixture
def tower(db: semmap.Database) -> semmap.Map:
    made = db.create_map("tower")
    outline = [(0, 0), (9, 0), (9, 6), (0, 6)]
    for name, room, z in (("G", "low", 0.0), ("U", "up", 3.0)):
        made.add_storey(name, elevation=z, height=3)
        made.add_room(room, outline, floor=z, ceiling=z + 3, storey=name)
    for number, (name, (size, z, _)) in enumerate(THINGS.items()):
        made.add_object(name, type="box", size=size, pose=(1 + number, 2, z))
    return made


def rooms(of: semmap.Map) -> dict[str, tuple[str, str]]:
    return {name: (of[name].room.name, of[name].storey.name) for name in THINGS}


def test_each_thing_is_in_its_room_and_stays_there_in_a_file(
    tower: semmap.Map, db: semmap.Database, tmp_path: Path
) -> None:
    truth = {name: (room, "GU"[room == "up"]) for name, (_, _, room) in THINGS.items()}
    assert rooms(tower) == truth
    file = tmp_path / "tower.gpkg"
    tower.export(file)
    again = db.create_map("again")
    again.import_file(file)
    assert rooms(again) == truth


def test_a_stated_room_stays(tower: semmap.Map) -> None:
    stool = tower.add_object("stool", type="chair", in_="up")
    assert stool.holder == tower["up"]
    assert (stool.room, stool.storey) == (tower["up"], tower["U"])
