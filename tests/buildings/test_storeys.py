"""Storeys that a world does not state: found from floors in use, or asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.importer import read_world
from semmap.ingest.storeys import found_storeys
from semmap.ingest.world import Entry, Shape
from tests.buildings.building import Building, random_building
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


@pytest.mark.parametrize("held", [False, True])
def test_storeys_of_a_scene_whose_floors_hold_the_furniture(held: bool) -> None:
    """The poses of what a node holds are in the frame of that node."""
    entries = []
    for number, z in enumerate((0.0, 3.2, 6.4)):
        floor, desk = (
            box_mesh((-5, -4, 0), (5, 4, 0.02)),
            box_mesh((-0.5, -0.5, 0), (0.5, 0.5, 0.7)),
        )
        shape = Shape("mesh", floor)
        entries.append(Entry(f"floor{number}", "object", shapes=[shape], pose=Pose(z=z)))
        at = Pose(2, 1, 0.02)
        entry = Entry(f"desk{number}", "object", shapes=[Shape("mesh", desk)])
        entry.holder = f"floor{number}" if held else None
        entry.pose = at if held else Pose(z=z) @ at
        entries.append(entry)
    storeys, _ = found_storeys(entries)
    assert [s.detail.elevation for s in storeys] == pytest.approx([0.01, 3.21, 6.41], abs=0.011)


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


def rack(building: Building, x: float, y: float, depth: float, long: float) -> None:
    """Two boards above each other on which pallets stand, and a pallet on the floor."""
    for number, z in enumerate((0.0, 2.2, 4.4)):
        if z:
            building.add("board", "thing", (x, y, x + depth, y + long), z - 0.04, z)
        for k in range(3):
            side = y + 0.5 + 1.5 * k
            building.add(f"pallet{number}", "thing", (x, side, x + 1, side + 1), z, z + 0.8)


@pytest.mark.parametrize("floor", [True, False])
@pytest.mark.parametrize(("depth", "long"), [(1.2, 12.0), (2.0, 8.0), (2.5, 6.0)])
@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_boards_of_racks_are_no_storeys(
    floor: bool, depth: float, long: float, angle: float, tmp_path: Path
) -> None:
    building = Building(0, angle, (3.0, -2.0))
    if floor:
        building.add("hall", "floor", (0, 0, 20, 16), -0.1, 0.0)
    rack(building, 2, 1, depth, long)
    rack(building, 9, 1, depth, long)
    storeys, notes = found_storeys(read_world(building.write(tmp_path)[0]).entries)
    assert storeys == []
    assert bool(notes) == (depth > 2.4)  # as wide as a room: it asks


def test_a_platform_in_a_hall_is_asked_about(tmp_path: Path) -> None:
    building = Building(0, 0.0, (0.0, 0.0))
    building.add("hall", "floor", (0, 0, 20, 16), -0.1, 0.0)
    building.add("platform", "floor", (0, 0, 6, 5), 2.7, 2.8)
    for z in (0.0, 2.8):
        for x in (1, 3):
            building.add("desk", "thing", (x, 1, x + 1, 2), z, z + 0.7)
    storeys, notes = found_storeys(read_world(building.write(tmp_path)[0]).entries)
    assert storeys == []
    assert notes[0].startswith("things stand at 0, 2.8 m")


@pytest.mark.parametrize("count", [2, 3, 4])
def test_half_levels_are_asked_about(count: int, tmp_path: Path) -> None:
    """Two stacks of floors beside each other, of which one is half a storey higher."""
    building = Building(0, 0.3, (0.0, 0.0))
    for number in range(count):
        x, z = 6.0 * (number % 2), 1.4 * number
        building.add("deck", "floor", (x, 0, x + 6, 5), z - 0.2, z)
        building.add("bench", "thing", (x + 1, 1, x + 2, 2), z, z + 0.5)
    storeys, notes = found_storeys(read_world(building.write(tmp_path)[0]).entries)
    assert [s.detail.elevation for s in storeys] == pytest.approx([0, 2.8][: len(storeys)])
    assert len(storeys) == (2 if count > 2 else 0)
    between = "1.4, 4.2" if count > 3 else "1.4"
    assert notes[-1].startswith(f"things stand on floors at {between} m, less than 2 m above")


def levels_without_floors(count: int = 3) -> Building:
    """A table and a chair on each level, no floors, and no storeys that a file would state."""
    building = Building(0, 0.0, (0.0, 0.0))
    for number in range(count):
        z = 3.0 * number
        building.add("table", "thing", (1 + number, 1, 2.2 + number, 1.8), z, z + 0.75)
        building.add("chair", "thing", (5, 1, 5.5, 1.5), z, z + 0.9)
    return building


def test_few_things_above_each_other_are_asked_about_everywhere(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = levels_without_floors()
    world, _ = building.write(tmp_path)
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        summary = database.import_file(world, map="b")
        assert any("things stand at 0, 3, 6 m" in note for note in summary.notes)
        place = database.map("b")
        (note,) = place.grid().notes
        assert note.startswith("things stand at 3, 6 m")
        found = place.check()
        assert [(each.kind, set(each.entities)) for each in found] == [
            ("things without a storey", {"table_1", "chair_1"}),
            ("things without a storey", {"table_2", "chair_2"}),
        ]
        for number in range(3):
            place.add_storey(f"storey {number}", elevation=3.0 * number)
        assert {each.kind for each in place.check()} == {"storey without a floor"}  # nor a room
        assert [made.notes for made in place.grids()] == [[], [], []]


def test_lamps_and_devices_are_no_level(tmp_path: Path) -> None:
    building = levels_without_floors(1)
    for x in (1, 6):
        building.add("lamp", "thing", (x, 4, x + 0.3, 4.3), 2.2, 2.6)
    assert found_storeys(read_world(building.write(tmp_path)[0]).entries) == ([], [])


def test_lintels_are_no_level(tmp_path: Path) -> None:
    """Of four doorways in walls of one storey; the same pieces without walls are noted."""

    def pieces(walls: bool) -> list[str]:
        building = levels_without_floors(1)
        for number in range(4):
            x = 2.0 * number
            if walls:
                building.add("wall", "wall", (x, 3, x + 1.1, 3.15), 0, 2.7)
            building.add("piece", "thing", (x + 1.1, 3, x + 2, 3.15), 2.1, 2.7)
        (folder := tmp_path / str(walls)).mkdir()
        return found_storeys(read_world(building.write(folder)[0]).entries)[1]

    assert pieces(walls=True) == []
    assert pieces(walls=False)[0].startswith("things stand at 0, 2.1 m")
