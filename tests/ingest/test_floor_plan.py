"""Rooms out of lines: hand-made plans, and random ones whose rooms are known by construction."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Polygon, affinity

from semmap.ingest.floor_plan import bridge_gaps, enclose, rooms_beside


def lines(*pairs):
    return [LineString(pair) for pair in pairs]


def ring(polygon):
    return lines(*itertools.pairwise(polygon.exterior.coords))


HOUSE = ring(shapely.box(0, 0, 6, 3))


def test_a_wall_with_a_door_makes_two_rooms():
    walls = [*HOUSE, *lines(((4, 0), (4, 1)), ((4, 2), (4, 3)))]
    door = LineString([(4, 1), (4, 2)])
    plan = enclose(walls, [door])
    assert [room.area for room in plan.rooms] == pytest.approx([12, 6])
    sides = rooms_beside(plan.rooms, door)
    assert (sides.left, sides.right) == (0, 1)
    assert rooms_beside(plan.rooms, door.reverse()).left == 1
    assert plan.openings == []


@pytest.mark.parametrize(("gap", "rooms"), [(0.049, 2), (0.05, 2), (0.06, 1)])
def test_gaps_up_to_five_centimetres_are_closed(gap, rooms):
    walls = [*HOUSE, *lines(((4, 0), (4, 1)), ((4, 2), (4, 3)))]
    plan = enclose(walls, lines(((4, 1 + gap), (4, 2))))
    assert len(plan.rooms) == rooms
    assert sum(room.area for room in plan.rooms) == pytest.approx(18)


def test_bridges_are_the_shortest_and_none_is_made_where_lines_meet():
    (bridge,) = bridge_gaps(lines(((0, 0), (1, 0)), ((1.03, -1), (1.03, 1))), 0.05)
    assert bridge.length == pytest.approx(0.03)
    assert bridge_gaps(HOUSE, 0.05) == []


def test_an_exterior_door_has_a_room_on_one_side():
    plan = enclose(HOUSE)
    sides = rooms_beside(plan.rooms, LineString([(1, 0), (2, 0)]))
    assert (sides.left, sides.right) == (0, None)
    away = rooms_beside(plan.rooms, LineString([(1, 20), (2, 20)]))
    assert (away.left, away.right) == (None, None)


def test_a_floor_outline_closes_a_room_whose_wall_is_missing():
    assert enclose(HOUSE[:3]).rooms == []
    (room,) = enclose(HOUSE[:3], floors=[shapely.box(0, 0, 6, 3)]).rooms
    assert room.area == pytest.approx(18)


def test_the_crack_between_wall_and_floor_belongs_to_the_room():
    (room,) = enclose(
        HOUSE, floors=[Polygon([(0.08, 0.12), (5.9, 0.1), (5.9, 2.9), (0.1, 2.9)])]
    ).rooms
    assert room.area == pytest.approx(18, abs=1e-3)


def test_a_floor_that_sticks_out_below_the_wall_adds_nothing():
    (room,) = enclose(HOUSE, floors=[shapely.box(-0.1, -0.1, 6.1, 3.1)]).rooms
    assert room.area == pytest.approx(18, abs=1e-3)


def test_two_floors_meet_in_an_opening_where_the_wall_between_them_stops():
    walls = [*HOUSE, *lines(((4, 0), (4, 1.9)))]
    floors = [shapely.box(0, 0, 4.04, 3), shapely.box(4.04, 0, 6, 3)]
    plan = enclose(walls, floors=floors)
    assert sorted(room.area for room in plan.rooms) == pytest.approx([6, 12], abs=0.1)
    (opening,) = plan.openings
    assert opening.border.length == pytest.approx(1.1, abs=0.05)  # the bridge of 4 cm counts
    assert opening.rooms == (0, 1)


def test_a_face_without_floor_is_not_a_room():
    walls = [*HOUSE, *lines(((4, 0), (4, 3)))]
    plan = enclose(walls, floors=[shapely.box(0, 0, 4, 3)])
    assert [room.area for room in plan.rooms] == pytest.approx([12])
    assert [face.area for face in plan.floorless] == pytest.approx([6])


def test_a_column_is_not_a_room_but_a_small_room_with_a_door_is():
    column = ring(shapely.box(1, 1, 2, 2))
    plan = enclose([*HOUSE, *column])
    assert [face.area for face in plan.solid] == pytest.approx([1])
    assert [room.area for room in plan.rooms] == pytest.approx([17])
    closet = enclose([*HOUSE, *column[1:]], [column[0]])
    assert sorted(room.area for room in closet.rooms) == pytest.approx([1, 17])


def test_a_face_below_half_a_square_metre_is_not_a_room():
    duct = ring(shapely.box(1, 1, 1.7, 1.7))
    plan = enclose([*HOUSE, *duct[1:]], [duct[0]])
    assert [room.area for room in plan.rooms] == pytest.approx([18 - 0.49])


def test_the_space_around_a_cabin_in_its_shaft_is_not_a_room():
    shaft = [*HOUSE, *lines(((4, 0), (4, 1)), ((4, 2), (4, 3)))]
    cabin = shapely.box(4.5, 0.5, 5.5, 2.5)
    door = LineString([(4.2, 2), (4.2, 1)]).reverse()  # the cabin to its right
    plan = enclose(shaft, cabins=[cabin], cabin_doors=[door])
    assert [room.area for room in plan.rooms] == pytest.approx([12], abs=0.4)
    assert len(plan.solid) == 1


def test_a_cabin_that_stands_free_is_cut_out_of_its_room():
    cabin = shapely.box(2, 1, 3, 2)
    plan = enclose(HOUSE, cabins=[cabin], cabin_doors=lines(((1.9, 1.1), (1.9, 1.9))))
    (room,) = plan.rooms
    assert room.area == pytest.approx(17)
    assert not room.contains(cabin.centroid)


def test_nothing_encloses_nothing():
    assert enclose([]).rooms == []
    assert enclose(lines(((0, 0), (1, 0)))).rooms == []


@dataclass
class Plan:
    """A grid of rooms: their areas, and for each door the two cells that it joins."""

    walls: list[LineString]
    doors: list[LineString]
    areas: list[float]
    centres: list[tuple[float, float]]
    joins: list[set[int]]

    def moved(self, matrix):
        def move(geometries):
            return [affinity.affine_transform(g, matrix) for g in geometries]

        centres = [(p.x, p.y) for p in move([shapely.Point(c) for c in self.centres])]
        return Plan(move(self.walls), move(self.doors), self.areas, centres, self.joins)


@st.composite
def plans(draw):
    """Columns and rows of random size; each inner wall with a door or none, a door also outward.

    Vertical walls run through; horizontal ones, and the parts of a wall beside its door, miss
    their neighbours by up to 5 cm.
    """
    steps = st.lists(st.floats(1.6, 6), min_size=1, max_size=3)
    xs, ys = (np.cumsum([0, *draw(steps)]) for _ in "xy")
    gaps = st.one_of(st.just(0.0), st.floats(1e-9, 0.0499))
    walls, doors, joins = [], [], []
    columns, rows = len(xs) - 1, len(ys) - 1

    def cell(i, j):
        return i * rows + j if 0 <= i < columns and 0 <= j < rows else -1

    def wall(a, b, sides, inset):
        a, b = np.array(a), np.array(b)
        along = (b - a) / np.linalg.norm(b - a)
        a, b = a + inset * along, b - inset * along
        length = np.linalg.norm(b - a)
        if not draw(st.booleans()):
            walls.append(LineString([a, b]))
            return
        width = draw(st.floats(0.6, 1.2))
        start = draw(st.floats(0.1, length - width - 0.1))
        before, after = draw(gaps), draw(gaps)
        walls.append(LineString([a, a + start * along]))
        walls.append(LineString([a + (start + width) * along, b]))
        ends = (a + (start + before) * along, a + (start + width - after) * along)
        doors.append(LineString(ends if draw(st.booleans()) else ends[::-1]))
        joins.append(sides)

    for i, x in enumerate(xs):
        for j in range(rows):
            wall((x, ys[j]), (x, ys[j + 1]), {cell(i - 1, j), cell(i, j)}, 0.0)
    for j, y in enumerate(ys):
        for i in range(columns):
            wall((xs[i], y), (xs[i + 1], y), {cell(i, j - 1), cell(i, j)}, draw(gaps))
    areas = [w * h for w in np.diff(xs) for h in np.diff(ys)]
    centres = [(x, y) for x in (xs[:-1] + xs[1:]) / 2 for y in (ys[:-1] + ys[1:]) / 2]
    return Plan(walls, doors, areas, centres, joins)


@settings(deadline=None, max_examples=30)
@given(plans(), st.floats(-3.14, 3.14), st.floats(-100, 100), st.floats(-100, 100))
def test_random_grids_of_rooms(plan, yaw, x, y):
    c, s = np.cos(yaw), np.sin(yaw)
    plan = plan.moved([c, -s, s, c, x, y])
    found = enclose(plan.walls, plan.doors)
    assert len(found.rooms) == len(plan.areas)
    tree = shapely.STRtree(found.rooms)
    room_of = [int(tree.query(shapely.Point(p), "within")[0]) for p in plan.centres]
    assert len(set(room_of)) == len(room_of)
    for cell, room in enumerate(room_of):
        assert found.rooms[room].area == pytest.approx(plan.areas[cell], rel=1e-3)
    for door, cells in zip(plan.doors, plan.joins, strict=True):
        sides = rooms_beside(found.rooms, door)
        assert {sides.left, sides.right} == {room_of[i] if i >= 0 else None for i in cells}


@settings(deadline=None, max_examples=20)
@given(plans(), st.randoms(use_true_random=False))
def test_rooms_come_in_the_same_order_however_the_lines_do(plan, random):
    shuffled = [w if random.random() < 0.5 else w.reverse() for w in plan.walls]
    random.shuffle(shuffled)
    first, second = enclose(plan.walls, plan.doors), enclose(shuffled, plan.doors)
    assert all(
        a.equals_exact(b, 1e-3, normalize=True)
        for a, b in zip(first.rooms, second.rooms, strict=True)
    )
