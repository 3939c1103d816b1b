"""A costmap without a free cell is refused, and the error names the cause."""

from __future__ import annotations

import pytest

from navgrid.costmap import Costmap
from navgrid.costmap_output import NoFreeCellError, check_free, drivable
from navgrid.grid import Grid
from tests.navgrid.scenes import BASE, part, region, room, scene, sheet, solid, square

GRID = Grid((0.0, 0.0), 0.1, (40, 60))
HALL = room("hall", 0, 0, 6, 4)


def test_a_costmap_with_a_free_cell_passes() -> None:
    check_free(Costmap(scene(floors=(HALL,)), [BASE], GRID))


def test_a_floor_above_the_rooms_floor_is_named_with_its_height() -> None:
    raised = solid(1, (-1, -1, -0.1), (7, 5, 0.034), "crate")
    costmap = Costmap(scene(raised, floors=(HALL,)), [BASE], GRID)
    with pytest.raises(NoFreeCellError, match=r"solid1 .* its top is 0\.034 m above the floor"):
        check_free(costmap)


def test_a_blocked_region_that_covers_everything_is_named() -> None:
    zone = region(1, HALL.outline.buffer(1), "blocked_region")
    with pytest.raises(NoFreeCellError, match=r"region1 .*blocked_regions.* check its type"):
        check_free(Costmap(scene(zone, floors=(HALL,)), [BASE], GRID))


def test_a_grid_outside_of_every_room_is_named() -> None:
    away = room("away", 100, 100, 101, 101)
    with pytest.raises(NoFreeCellError, match="outside of every room and doorway"):
        check_free(Costmap(scene(floors=(away,)), [BASE], GRID))


def test_a_robot_that_is_too_wide_is_told_its_radius() -> None:
    wide = part("wide", 0.0, 0.3, square(2.5))
    posts = [solid(n, (n, 1.9, 0), (n + 0.2, 2.1, 1), "post") for n in range(1, 6)]
    rug = sheet(20, [(0, 0, 0), (6, 0, 0), (6, 4, 0), (0, 4, 0)], "floor")
    costmap = Costmap(scene(*posts, rug, floors=(HALL,)), [wide], GRID)
    with pytest.raises(NoFreeCellError, match=r"part wide keeps 2\.50 m from them"):
        check_free(costmap)


def test_storeys_without_a_free_cell_are_left_out_unless_all_are() -> None:
    hall = Costmap(scene(floors=(HALL,)), [BASE], GRID)
    away = Costmap(scene(floors=(room("away", 100, 100, 101, 101),)), [BASE], GRID)
    free, closed = drivable([hall, away])
    assert free == [hall]
    assert len(closed) == 1
    assert "outside of every room and doorway" in closed[0]
    with pytest.raises(NoFreeCellError, match="outside of every room"):
        drivable([away, away])
