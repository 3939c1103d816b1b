"""Storeys that a world does not state: found from floors in use, or asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap
from semmap.ingest.importer import read_world
from semmap.ingest.storeys import found_storeys
from tests.buildings.building import random_building
from tests.conftest import MakeDatabase

SEEDS = range(24)


@pytest.mark.parametrize("seed", SEEDS)
def test_floors_in_use_are_storeys(seed: int, tmp_path: Path) -> None:
    building = random_building(seed)
    world = read_world(building.write(tmp_path)[0])
    storeys, notes = found_storeys(world.entries)
    used = [
        elevation
        for _, elevation, _ in building.storeys
        if any(
            item.what in ("thing", "wall") and abs(item.low - elevation) < 1e-9
            for item in building.items
        )
    ]
    if len(used) > 1:
        assert [s.detail.elevation for s in storeys] == pytest.approx(used, abs=1e-3)
        assert f"{len(used)} storeys are found" in notes[0]
    else:
        assert storeys == []


def test_things_above_each_other_without_floors_are_asked_about(tmp_path: Path) -> None:
    building = random_building(0)
    building.items = [i for i in building.items if i.what not in ("floor", "ceiling")]
    storeys, notes = found_storeys(read_world(building.write(tmp_path)[0]).entries)
    assert storeys == []
    assert "state them in a GeoJSON file" in notes[0]


def test_one_level_is_no_storey(worlds: Path) -> None:
    for world in ("small_house/worlds/small_house.world", "bookstore/worlds/bookstore.world"):
        assert found_storeys(read_world(worlds / world).entries) == ([], [])


def test_stated_storeys_replace_found_ones(make_database: MakeDatabase, tmp_path: Path) -> None:
    building = random_building(0)
    world, rooms = building.write(tmp_path)
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        summary = database.import_file(world, map="b")
        place = database.map("b")
        assert len(place.storeys) == len(building.storeys)
        assert any("storeys are found" in note for note in summary.notes)
        assert database.import_file(world, map="b").unchanged == summary.added
        things = [item for item in building.items if item.what == "thing" and item.on is None]
        for item in things:
            holder = place[item.name].storey
            assert holder is not None
            assert holder.name == f"storey_{_level(building, item)}"
        database.import_file(rooms, map="b")
        assert [s.name for s in place.storeys] == [name for name, *_ in building.storeys]
        for item in things:
            storey = place[item.name].storey
            assert storey is not None
            assert storey.name == f"s{_level(building, item)}"


def _level(building, item):  # type: ignore[no-untyped-def]
    """The number of the highest storey that begins below an item's middle."""
    return max(k for k, (_, z, _) in enumerate(building.storeys) if z <= (item.low + item.high) / 2)
