"""Free space divided into rooms: plans drawn by hand, and the walls of random buildings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from navgrid.room_segments import room_segments, wall_gaps

CELL = 0.05


def plan(width: float, depth: float) -> NDArray[np.bool_]:
    """Outer walls two cells thick, with a metre around them."""
    rows, columns = (round(side / CELL) + 44 for side in (depth, width))
    walls = np.zeros((rows, columns), np.bool_)
    walls[20:-20, 20:-20] = True
    walls[22:-22, 22:-22] = False
    return walls


def wall_across(walls: NDArray[np.bool_], x: float, gap: tuple[float, float]) -> None:
    """A wall from side to side at `x` metres from the left, with a gap."""
    column = 22 + round(x / CELL)
    low, high = (22 + round(y / CELL) for y in gap)
    walls[20:-20, column : column + 2] = True
    walls[low:high, column : column + 2] = False


def inside(walls: NDArray[np.bool_], labels: NDArray[np.int32]) -> list[int]:
    """The numbers of the segments within the outer walls."""
    outer = labels[0, 0]
    return [int(n) for n in np.unique(labels[~walls]) if n not in (0, outer)]


def test_a_wall_with_a_doorway_divides_two_rooms() -> None:
    walls = plan(7, 4)
    wall_across(walls, 3, (1.5, 2.4))

    found = room_segments(walls, CELL)

    left, right = found.labels[60, 40], found.labels[60, 120]
    assert left != right
    assert sorted(inside(walls, found.labels)) == sorted((left, right))
    (door,) = found.passages
    assert set(door.segments) == {left, right}
    assert door.width == pytest.approx(0.9, abs=CELL)
    assert door.ends.mean(axis=0) == pytest.approx((22 + 39, 22 + 60.5), abs=1.5)
    assert door.confidence > 0.5


def test_what_is_wide_or_in_line_with_no_wall_is_no_doorway() -> None:
    walls = plan(8, 4.5)
    column = 22 + round(4 / CELL)
    walls[22 : 22 + 14, column : column + 14] = True  # a column at the wall
    assert len(inside(walls, room_segments(walls, CELL).labels)) == 1

    walls = plan(10, 6)
    wall_across(walls, 5, (1.0, 5.0))
    assert len(inside(walls, room_segments(walls, CELL).labels)) == 1


def test_a_doorway_in_a_corner_leads_to_a_room_from_a_hall_alone() -> None:
    """Beside few other doorways, it is the way behind a screen, or into a niche."""
    walls = plan(7, 4)
    wall_across(walls, 4.5, (3.1, 4.0))
    assert len(inside(walls, room_segments(walls, CELL).labels)) == 1
    with_doorway = walls.copy()
    with_doorway[22 + 15 : 22 + 33, 22 + 90 :][:, :2] = False
    assert len(inside(walls, room_segments(with_doorway, CELL).labels)) == 2
    walls[22 + 30 : 22 + 48, 20:22] = False  # a front door
    assert len(inside(walls, room_segments(walls, CELL).labels)) == 1

    walls = plan(9, 4)
    row = 22 + round(2 / CELL)
    walls[row : row + 2, 20:-20] = True
    for x in (3, 6, 9):
        walls[20:row, 22 + round(x / CELL) :][:, :2] = True
        walls[row : row + 2, 22 + round((x - 0.9) / CELL) : 22 + round(x / CELL)] = False
    found = room_segments(walls, CELL)
    assert len(inside(walls, found.labels)) == 4
    assert [door.confidence for door in found.passages] == [0.5] * 3

    walls = plan(7, 6)  # what is wide is surer
    wall_across(walls, 3, (1.15, 4.85))
    assert len(inside(walls, room_segments(walls, CELL).labels)) == 2

    walls = plan(2, 2)  # from the outside, too
    walls[22 + 18 : 22 + 38, 20:22] = False
    assert len(inside(walls, room_segments(walls, CELL).labels)) == 1


def test_a_lintel_makes_a_wide_passage_a_doorway_but_a_beam_does_not() -> None:
    walls = plan(10, 6)
    wall_across(walls, 5, (1.0, 5.0))
    lintel = walls.copy()
    wall_across(lintel, 5, (0, 0))
    found = room_segments(walls, CELL, lintel)
    assert len(inside(walls, found.labels)) == 2
    (door,) = found.passages
    assert door.width == pytest.approx(4.0, abs=2 * CELL)

    walls, beam = plan(10, 6), plan(10, 6)
    wall_across(beam, 5, (0, 0))
    assert len(inside(walls, room_segments(walls, CELL, beam).labels)) == 1


def test_a_low_partition_divides_nothing_where_walls_are_higher() -> None:
    high = plan(8, 6)
    walls = high.copy()
    row = 22 + round(3 / CELL)
    walls[row : row + 2, 22 + 20 : -22 - 24] = True  # free at both of its ends

    assert len(inside(walls, room_segments(walls, CELL, high).labels)) == 1


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(2.5, 5), min_size=1, max_size=4),
    st.floats(2.5, 6),
    st.floats(0.7, 1.1),
    st.data(),
)
def test_rooms_in_a_row_are_those_that_closed_doors_would_leave(
    widths: list[float], depth: float, width: float, data: st.DataObject
) -> None:
    walls = plan(sum(widths) + 0.1 * (len(widths) - 1), depth)
    closed = walls.copy()
    x = 0.0
    for room in widths[:-1]:
        x += room
        low = data.draw(st.floats(0.2, depth - width - 0.2))
        wall_across(walls, x, (low, low + width))
        wall_across(closed, x, (0, 0))
        x += 0.1
    parts, count = ndimage.label(~closed)

    found = room_segments(walls, CELL)

    assert count == len(widths) + 1
    assert len(inside(walls, found.labels)) == len(widths)
    assert len(found.passages) == len(widths) - 1
    for part in range(1, count + 1):
        numbers = np.bincount(found.labels[parts == part])
        assert numbers.max() >= 0.95 * (parts == part).sum()


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 3), min_size=8, max_size=8))
def test_a_gap_is_found_between_the_rough_ends_of_a_scanned_wall(rough: list[int]) -> None:
    walls = np.zeros((60, 120), np.bool_)
    walls[28:32] = True
    for row, before, behind in zip(range(28, 32), rough[:4], rough[4:], strict=True):
        walls[row, 40 - before : 80 + behind] = False

    (gap,) = wall_gaps(walls, walls, CELL)

    assert gap.ends.mean(axis=0) == pytest.approx((29.5, 59.5), abs=2)
