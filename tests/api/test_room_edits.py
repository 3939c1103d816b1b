"""Rooms merged and split, and found again in the walls: Shapely says which rooms there are."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity

import semmap
from semmap.api.room_edits import joined
from tests.conftest import MakeDatabase

WALL = 0.2
"""Metres of the walls around three rooms of 4 m by 4 m in a row, with doorways of 1 m."""


@pytest.fixture
def row(make_database: MakeDatabase):
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        row = db.create_map("row")
        row.add_storey("ground")
        # x, y of the middle, and sides
        walls = [(6, y, 12.2, WALL) for y in (-0.1, 4.1)] + [(x, 2, WALL, 4) for x in (-0.1, 12.1)]
        walls += [(x, y, WALL, 1.5) for x in (4, 8) for y in (0.75, 3.25)]
        for number, (x, y, wide, deep) in enumerate(walls):
            row.add_object(f"wall{number}", type="wall", size=(wide, deep, 2.5), pose=(x, y, 0))
        row.find_rooms(add=True)
        row.add_object("lamp", type="lamp", size=(0.3, 0.3, 1), pose=(11, 3, 0))
        row.add_object("mug", type="mug", size=(0.1, 0.1, 0.1), pose=(5, 1, 0))
        yield row


def named(row: semmap.Map) -> dict[str, str]:
    """The names of the rooms by their place in the row."""
    rooms = sorted(row.rooms, key=lambda room: room.footprint.centroid.x)
    return dict(zip(("left", "middle", "right"), [room.name for room in rooms], strict=False))


def test_merged_rooms_have_the_doors_and_contents_of_all(row: semmap.Map) -> None:
    names = named(row)
    former = shapely.union_all([row[names[each]].footprint for each in ("middle", "right")])
    assert len(row.doors) == 2
    row.merge_rooms(names["middle"], names["right"])
    both = row[names["middle"]]
    assert former.difference(both.footprint).area < 1e-6
    strip = both.footprint.difference(former)
    assert len(shapely.get_parts(both.footprint)) == 1
    assert strip.difference(shapely.box(7.7, 0, 8.3, 4)).area < 1e-6
    assert both.footprint.covers(shapely.box(7.85, 0.5, 8.15, 3.5)), "also beside the doorway"
    (door,) = row.doors
    assert {place.name for place in door.places} == {names["left"], names["middle"]}
    assert row["lamp"].room == row["mug"].room == both
    assert names["right"] not in row
    assert row.route(names["left"], "lamp").metres > 5
    (again,) = row.find_rooms(add=True)
    assert (again.rooms, again.doorways) == ((), ())
    assert {*again.known} == {names["left"], names["middle"]}
    assert not [fault for fault in row.check() if fault.severity == "error"]


@pytest.mark.parametrize("seed", range(60))
def test_rooms_of_turned_buildings_are_joined(seed: int) -> None:
    """Two in line, whose long walls go on, and two side by side: they touch along their edges."""
    random = np.random.default_rng(seed)
    turn, wall = random.uniform(0, 90), random.uniform(0.05, 0.2)
    corridor, at = shapely.box(37, -12, 49, -10.4), random.uniform(37, 45)
    beyond = shapely.box(49 + wall, -12, 51, -10.4)
    beside = shapely.box(at, -10.4 + wall, at + 4, -6)
    strips = {
        beyond: shapely.box(49, -12, 49 + wall, -10.4),
        beside: shapely.box(at, -10.4, at + 4, -10.4 + wall),
    }
    for room, strip in strips.items():
        turned = [affinity.rotate(each, turn, (0, 0)) for each in (corridor, room, strip)]
        for pair in (turned[:2], turned[1::-1]):
            whole = joined(*pair)
            assert whole.geom_type == "MultiPolygon"
            assert whole.symmetric_difference(shapely.union_all(turned)).area < 1e-3


@pytest.mark.parametrize(
    ("line", "areas"),
    [
        (((2, -1), (2, 9)), [16, 16]),
        (((-1, 2), (11, 2)), [12, 20]),
        (((2, -1), (2, 2.5)), [16, 16]),
    ],
)
def test_a_room_is_split_at_its_inner_corner(
    database: str, line: tuple[tuple[float, float], ...], areas: list[float]
) -> None:
    """The line may run on along a wall: the opening is where it is inside."""
    corners = [(0, 0), (10, 0), (10, 2), (2, 2), (2, 8), (0, 8)]
    with semmap.connect(database) as db:
        hall = db.create_map(f"hall{line}")
        hall.add_room("hall", corners, floor=0, ceiling=2.7)
        new = hall.split_room("hall", "corridor", line)
        found = sorted(room.footprint.area for room in hall.rooms)  # type: ignore[union-attr]
        assert found == pytest.approx(areas)
        (opening,) = hall.doors
        assert {place.name for place in opening.places} == {"hall", "corridor"}
        assert opening.width == pytest.approx(2)
        inside = shapely.LineString(line).intersection(shapely.Polygon(corners))
        assert opening.geometry.distance(inside) < 0.01
        assert new.footprint is not None


def test_a_split_room_is_two_with_an_opening_and_is_found_as_such(row: semmap.Map) -> None:
    names = named(row)
    former = row[names["right"]].footprint
    new = row.split_room(names["right"], "store", [(10.5, -1), (10.5, 5)])
    old = row[names["right"]]
    assert new.footprint.symmetric_difference(former & shapely.box(10.5, 0, 13, 4)).area < 1e-6
    assert new.footprint.union(old.footprint).symmetric_difference(former).area < 1e-6
    assert new.footprint.intersection(old.footprint).area == pytest.approx(0, abs=1e-6)
    assert row["lamp"].room == new
    joins = sorted(sorted(place.name for place in door.places) for door in row.doors)
    beside = [("left", "middle"), ("middle", "right")]
    expected = [sorted(names[each] for each in pair) for pair in beside]
    assert joins == sorted([*expected, sorted([old.name, "store"])])
    assert row.route(names["left"], "store").places[-2:] == [old.name, "store"]
    (again,) = row.find_rooms(add=True)
    assert (again.rooms, again.doorways) == ((), ())
    assert {*again.known} == {*names.values(), "store"}


def test_a_room_split_in_the_middle_is_not_found_as_a_third(row: semmap.Map) -> None:
    names = named(row)
    row.split_room(names["right"], "store", [(10.05, -1), (10.05, 5)])
    (again,) = row.find_rooms(add=True)
    assert (again.rooms, again.doorways) == ((), ())
    row.doors[
        next(d.name for d in row.doors if names["left"] in {p.name for p in d.places})
    ].delete()
    (again,) = row.find_rooms()
    assert [{*door.rooms} for door in again.doorways] == [{names["left"], names["middle"]}]


def test_rooms_of_two_storeys_stay_two(row: semmap.Map) -> None:
    """One above the other, they are 0 m apart on the plan."""
    row.add_storey("first", elevation=3.0)
    upper = row.add_room("upper", shapely.box(0, 0, 4, 4), floor=3.0, storey="first")
    with pytest.raises(ValueError, match="not on one storey"):
        row.merge_rooms(named(row)["left"], "upper")
    assert upper in [*row.rooms]


def test_what_cannot_be_edited_changes_nothing(row: semmap.Map) -> None:
    names = named(row)
    outlines = {room.name: room.footprint for room in row.rooms}
    for edit, message in (
        (lambda: row.merge_rooms(names["left"], names["right"]), "does not lie beside"),
        (lambda: row.merge_rooms(names["left"], ()), "two rooms"),
        (lambda: row.merge_rooms(names["left"], names["left"]), "two rooms"),
        (lambda: row.split_room(names["left"], "new", [(1, 1), (2, 2)]), "does not cut"),
        (lambda: row.split_room(names["left"], "lamp", [(1, -1), (1, 5)]), "lamp"),
    ):
        with pytest.raises(ValueError, match=message):
            edit()
    with pytest.raises(LookupError, match="nowhere"):
        row.merge_rooms(names["left"], "nowhere")
    assert {room.name: room.footprint for room in row.rooms} == outlines
    assert len(row.doors) == 2
