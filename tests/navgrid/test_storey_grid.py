from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import box

from navgrid.grid import Grid
from navgrid.storey_grid import covered, heights, storey_grid
from semmap.draw.view import RegionView, StoreyView
from tests.draw.storeys import thing, two_rooms


def at(made, x, y):
    column, row = (
        (v - o) / made.grid.resolution for v, o in zip((x, y), made.grid.origin, strict=True)
    )
    return int(made.cells[int(np.floor(row)), int(np.floor(column))])


def test_rooms_are_free_walls_occupied_and_the_rest_unknown():
    made = storey_grid(two_rooms())
    assert at(made, 2.0, 0.5) == 0
    assert at(made, 4.1, 1.5) == 0  # in the doorway
    assert at(made, 4.03, 0.5) == 100
    assert at(made, 4.1, 0.5) == 100  # inside of the wall
    assert at(storey_grid(two_rooms(), increment=0.05), 4.1, 0.5) == -1  # which planes leave out
    assert at(made, -0.25, 1.0) == -1
    assert at(storey_grid(two_rooms(), free_outside=True), -0.25, 1.0) == 0


def test_furniture_is_occupied_carpets_ceilings_floors_and_robots_are_not():
    made = storey_grid(two_rooms())
    assert at(made, 6.03, 1.4) == 100
    for name, x, y in (("rug", 1.52, 1.5), ("robot", 1.02, 2.4), ("ceiling", 2.0, 1.5)):
        assert at(made, x, y) == 0, name


@pytest.mark.parametrize(("state", "value"), [("open", 0), ("closed", 100), ("locked", 100)])
def test_a_door_stands_in_the_way_unless_it_is_open(state, value):
    assert at(storey_grid(two_rooms(state=state)), 4.09, 1.5) == value


def test_a_blocked_region_is_occupied_as_a_whole_and_no_other():
    made = storey_grid(two_rooms())
    x, y = np.meshgrid(np.arange(0.225, 0.8, 0.05), np.arange(0.225, 1.0, 0.05))
    assert all(at(made, a, b) == 100 for a, b in zip(x.ravel(), y.ravel(), strict=True))
    assert at(made, 3.4, 2.5) == 0  # home


def test_only_what_lies_in_the_interval_counts_above_the_storeys_floor():
    for z in (0.0, 6.4, -3.0):
        assert at(storey_grid(two_rooms(z)), 6.03, 1.4) == 100
        assert at(storey_grid(two_rooms(z), interval=(0.8, 1.8)), 6.03, 1.4) == 0


def test_the_same_storey_at_another_height_has_the_same_grid():
    low, high = storey_grid(two_rooms(0.0)), storey_grid(two_rooms(8.0))
    assert low.grid == high.grid
    np.testing.assert_array_equal(low.cells, high.cells)


def test_a_storey_of_nothing_says_what_it_lacks():
    with pytest.raises(ValueError, match="storey attic has neither rooms nor anything"):
        storey_grid(StoreyView("attic"))
    lone = StoreyView("yard", objects=[thing("box", ("container",), (0, 0, 0), (1, 1, 1))])
    assert set(np.unique(storey_grid(lone).cells)) == {0, 100}  # without rooms nothing is unknown


@given(st.floats(-3, 3), st.floats(0, 3), st.floats(0.01, 1.0))
def test_planes_reach_from_end_to_end_in_steps_of_at_most_the_increment(low, length, increment):
    planes = heights((low, low + length), increment)
    assert planes[0] == low
    assert planes[-1] == pytest.approx(low + length, abs=2e-9)
    assert (np.diff(planes) <= increment + 1e-9).all()
    assert (np.diff(planes) > 0).all()
    assert len(planes) <= length / increment + 2


@pytest.mark.parametrize(
    ("interval", "increment"), [((1.0, 0.5), 0.1), ((0, 1), 0.0), ((0, float("nan")), 0.1)]
)
def test_an_interval_that_is_none_is_refused(interval, increment):
    with pytest.raises(ValueError, match=r"give (its lower end|one above zero)"):
        heights(interval, increment)


coordinate = st.integers(-30, 30).map(lambda i: i * 0.11)


@given(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=6))
def test_covered_cells_are_those_whose_square_the_polygon_meets(points):
    outline = shapely.MultiPoint(points).convex_hull
    if outline.geom_type != "Polygon":
        return
    grid = Grid((-1.0, -2.0), 0.25, (17, 11))
    inside = covered(outline, grid)
    for row, column in np.ndindex(grid.shape):
        x, y = -1.0 + 0.25 * column, -2.0 + 0.25 * row
        square = box(x, y, x + 0.25, y + 0.25)
        if outline.intersection(square).area > 1e-9:
            assert inside[row, column]
        elif outline.distance(square) > 1e-9:
            assert not inside[row, column]


def test_a_region_beyond_the_rooms_widens_the_grid():
    more = RegionView("yard", box(20, 0, 21, 1), ("blocked_region",), True)
    storey = two_rooms()
    made = storey_grid(replace(storey, regions=[*storey.regions, more]))
    assert at(made, 20.5, 0.5) == 100


def test_what_lies_between_planes_is_found():
    shelf = thing("shelf", ("shelf",), (1.0, 1.0, 0.96), (2.0, 1.3, 0.975))
    storey = replace(two_rooms(), objects=[shelf])
    assert at(storey_grid(storey), 1.5, 1.15) == 100
    assert at(storey_grid(storey, increment=0.05), 1.5, 1.15) == 0


@pytest.mark.parametrize("interval", [(0.0, 1.8), (-0.1, 0.5), (-1.0, 0.0)])
def test_an_interval_that_holds_the_floor_says_so(interval):
    with pytest.raises(ValueError, match="holds the floor"):
        storey_grid(two_rooms(), interval)
