"""Rooms that are drawn as outlines where the map has no walls are bounded by their outlines."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely

import semmap
from navgrid.costmap import Costmap
from planner.live_topology import LiveTopology
from planner.route import NoRouteError
from planner.route_planner import RoutePlanner

CELL = 0.05
ROBOT = Path(__file__).parents[2] / "examples/office/delivery_robot.urdf"
ENDS = (1, 2, 0), (7, 2, 0)


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as found:
        yield found


def two_rooms(db: semmap.Database, gap: float = 2.0, deep: float = 0.1) -> semmap.Map:
    """A room in which a wardrobe leaves a gap at the upper side, and one behind a door."""
    here = db.create_map("zwei")
    here.add_room("großer Saal", shapely.box(0, 0, 8, 4), floor=0, ceiling=3)
    here.add_room("Nebenraum", shapely.box(8 + deep, 0, 10, 4), floor=0, ceiling=3)
    here.add_door("Tür", "großer Saal", "Nebenraum", ((8 + deep / 2, 1), (8 + deep / 2, 2)))
    long = 4 - gap
    here.add_object("Schrank", type="wardrobe", size=(0.6, long, 2), pose=(4, long / 2, 0, 0))
    return here


def add_walls(here: semmap.Map) -> None:
    """Walls around both rooms, outside of their outlines, with an opening at the door."""
    sides = {
        "oben": (-0.1, 4, 10.1, 4.1),
        "unten": (-0.1, -0.1, 10.1, 0),
        "links": (-0.1, 0, 0, 4),
        "rechts": (10, 0, 10.1, 4),
        "davor": (8, 0, 8.1, 1),
        "dahinter": (8, 2, 8.1, 4),
    }
    for name, (x0, y0, x1, y1) in sides.items():
        size, middle = (x1 - x0, y1 - y0, 3), ((x0 + x1) / 2, (y0 + y1) / 2, 0, 0)
        here.add_object(name, type="wall", size=size, pose=middle)


def metres(here: semmap.Map) -> float | None:
    try:
        return here.route(*ENDS).metres
    except NoRouteError:
        return None


def test_a_slab_over_rooms_is_no_wall_of_them(db: semmap.Database) -> None:
    """However low it hangs above the robot, it cannot reach through an outline."""
    here = two_rooms(db, 0.55)
    assert metres(here) is None
    here.add_object("Decke", type="ceiling", size=(10.4, 4.4, 0.3), pose=(5, 2, 2.2, 0))
    assert metres(here) is None


@pytest.mark.parametrize("gap", [0.3, 0.55, 0.65, 0.8, 1.1])
def test_a_gap_beside_an_outline_is_as_wide_as_beside_a_wall(
    db: semmap.Database, gap: float
) -> None:
    here = two_rooms(db, gap)
    drawn = metres(here)
    add_walls(here)
    built = metres(here)
    assert (drawn is None) == (built is None) == (gap < 0.7)
    if drawn is not None and built is not None:
        assert drawn == pytest.approx(built, abs=2 * CELL)


@pytest.mark.parametrize("seed", range(6))
def test_the_cells_of_outlines_are_occupied_except_in_doorways(
    db: semmap.Database, seed: int
) -> None:
    """Oracle: the squares of cells that the borders meet, by Shapely."""
    chance = random.Random(seed)
    deep = chance.choice([0.0, 0.1, 0.33])
    here = two_rooms(db, deep=deep)
    (made,) = here.grids()
    x0, y0 = made.grid.origin
    rows, columns = np.indices(made.cells.shape)
    squares = shapely.box(
        x0 + columns * CELL, y0 + rows * CELL, x0 + (columns + 1) * CELL, y0 + (rows + 1) * CELL
    )
    borders = shapely.union_all([shapely.box(0, 0, 8, 4), shapely.box(8 + deep, 0, 10, 4)])
    lines = shapely.union_all(
        [shapely.box(0, 0, 8, 4).boundary, shapely.box(8 + deep, 0, 10, 4).boundary]
    )
    way = shapely.box(7, 1, 9, 2)
    cut = lines.difference(way)
    away = shapely.distance(squares, cut)
    far = (away > 0.02) & (shapely.distance(squares, shapely.box(3.7, 0, 4.3, 2)) > 0)
    assert (made.cells[far] != 100).all()
    middles = shapely.centroid(squares)
    in_wall = shapely.distance(cut, middles) < 0.45 * CELL
    assert (made.cells[in_wall] == 100).all()
    assert (made.cells[shapely.within(squares, way) & shapely.within(squares, borders)] == 0).all()


def test_a_room_inside_another_and_an_open_side_of_a_walled_room_have_no_wall(
    db: semmap.Database,
) -> None:
    here = two_rooms(db)
    here.add_room("Ecke", shapely.box(5, 2.5, 7, 3.5), floor=0, ceiling=3)
    (made,) = here.grids()
    row, column = made.grid.cell(6, 2.5)
    assert (made.cells[row - 2 : row + 3, column] == 0).all()
    add_walls(here)
    here["links"].delete()
    (made,) = here.grids()
    row, column = made.grid.cell(0.0, 2.0)
    assert (made.cells[row, column : column + 2] != 100).all()


def cells(costmap: Costmap) -> dict[tuple[int, int], int]:
    """The costs by the numbers of the cells from the origin of the map on."""
    first = np.round(np.divide(costmap.grid.origin[::-1], CELL)).astype(int)
    return {tuple((at + first).tolist()): int(c) for at, c in np.ndenumerate(costmap.master)}


@pytest.mark.parametrize("walled", [False, True])
def test_a_part_of_a_storey_has_the_walls_of_the_whole(db: semmap.Database, walled: bool) -> None:
    here = two_rooms(db)
    if walled:
        add_walls(here)
    whole = here.costmap(ROBOT)
    boxes = {(8.1, 0, 10, 4): {"rooms": ["Nebenraum"]}, (2, 2, 5, 4): {"bounds": (2, 2, 5, 4)}}
    for (x0, y0, x1, y1), options in boxes.items():
        part, all_of_it = cells(here.costmap(ROBOT, **options)), cells(whole)
        for row in range(round(y0 / CELL), round(y1 / CELL)):
            for column in range(round(x0 / CELL), round(x1 / CELL)):
                assert part[row, column] == all_of_it[row, column]
        assert 254 in part.values()


def test_what_follows_the_map_takes_over_walls(db: semmap.Database) -> None:
    """With walls on the other sides, the upper side is open: a robot may reach over it."""
    here = two_rooms(db, 0.5)
    live, seen = LiveTopology(here), []

    def compare() -> None:
        live.catch_up()
        routed = []
        for planner in (RoutePlanner.of_live(live), RoutePlanner.of_map(here)):
            try:
                planner.route(*ENDS)
                routed.append(True)
            except NoRouteError:
                routed.append(False)
        assert routed[0] == routed[1]
        seen.append(routed[0])

    compare()
    add_walls(here)
    compare()
    here["oben"].delete()
    compare()
    for name in ("unten", "links"):
        here[name].delete()
    compare()
    assert seen == [False, False, True, False]
