"""The occupancy grid of a storey: by hand, by shapely, and beside the layered costmap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box
from sqlalchemy import Engine

from navgrid.costmap import Costmap
from navgrid.grid import MARGIN, Grid
from navgrid.occupancy_grid import StoreyGrid, plane_heights, storey_grid
from semmap.query.storey_reader import read_storeys
from semmap.query.storey_scene import StoreyScene
from tests.navgrid.scenes import part, region, room, scene, sheet, solid, square, two_rooms
from tests.seen import seen_by


def at(made: StoreyGrid, x: float, y: float) -> int:
    return int(made.cells[made.grid.cell(x, y)])


def with_entities(storey: StoreyScene, *more: object) -> StoreyScene:
    return replace(storey, entities=(*storey.entities, *more))


def test_rooms_are_free_walls_occupied_and_the_rest_unknown() -> None:
    made = storey_grid(two_rooms())
    assert at(made, 2.0, 0.5) == 0
    assert at(made, 4.1, 1.5) == 0  # in the doorway
    assert at(made, 4.03, 0.5) == 100
    assert at(made, 4.1, 0.5) == 100  # inside of the wall
    assert at(storey_grid(two_rooms(), increment=0.05), 4.1, 0.5) == -1  # planes have no inside
    assert at(made, -0.25, 1.0) == -1
    assert at(storey_grid(two_rooms(), free_outside=True), -0.25, 1.0) == 0


def test_furniture_is_occupied_carpets_ceilings_floors_and_robots_are_not() -> None:
    made = storey_grid(two_rooms())
    assert at(made, 6.03, 1.4) == 100
    for name, x, y in (("rug", 1.52, 1.5), ("robot", 1.02, 2.4), ("ceiling", 2.0, 1.5)):
        assert at(made, x, y) == 0, name


@pytest.mark.parametrize(("state", "value"), [("open", 0), ("closed", 100), ("locked", 100)])
def test_a_door_is_an_obstacle_unless_it_is_open(state: str, value: int) -> None:
    assert at(storey_grid(two_rooms(state=state)), 4.09, 1.5) == value


def test_a_blocked_region_is_occupied_as_a_whole_and_other_regions_are_not() -> None:
    for increment in (None, 0.1):
        made = storey_grid(two_rooms(), increment=increment)
        x, y = np.meshgrid(np.arange(0.225, 0.8, 0.05), np.arange(0.225, 1.0, 0.05))
        assert all(at(made, a, b) == 100 for a, b in zip(x.ravel(), y.ravel(), strict=True))
        assert at(made, 3.4, 2.5) == 0  # home


def test_only_heights_in_the_interval_above_the_floor_count() -> None:
    for z in (0.0, 6.4, -3.0):
        assert at(storey_grid(two_rooms(z)), 6.03, 1.4) == 100
        assert at(storey_grid(two_rooms(z), interval=(0.8, 1.8)), 6.03, 1.4) == 0


def test_the_same_storey_at_another_height_has_the_same_grid() -> None:
    low, high = storey_grid(two_rooms(0.0)), storey_grid(two_rooms(8.0))
    assert low.grid == high.grid
    np.testing.assert_array_equal(low.cells, high.cells)


def test_an_empty_storey_is_refused_and_an_object_alone_has_a_grid() -> None:
    with pytest.raises(ValueError, match="storey ground has neither rooms nor obstacles"):
        storey_grid(scene())
    lone = scene(solid(1, (0, 0, 0), (1, 1, 1), "container"))
    assert set(np.unique(storey_grid(lone).cells)) == {0, 100}  # without rooms nothing is unknown


@given(st.floats(-3, 3), st.floats(0, 3), st.floats(0.01, 1.0))
def test_planes_reach_from_end_to_end_at_most_the_increment_apart(
    low: float, length: float, increment: float
) -> None:
    planes = plane_heights((low, low + length), increment)
    assert planes[0] == low
    assert planes[-1] == pytest.approx(low + length, abs=2e-9)
    assert (np.diff(planes) <= increment + 1e-9).all()
    assert (np.diff(planes) > 0).all()
    assert len(planes) <= length / increment + 2


@pytest.mark.parametrize(
    ("interval", "increment"), [((1.0, 0.5), 0.1), ((0, 1), 0.0), ((0, float("nan")), 0.1)]
)
def test_invalid_intervals_are_refused(interval: tuple[float, float], increment: float) -> None:
    with pytest.raises(ValueError, match=r"give (its lower end|one above zero)"):
        plane_heights(interval, increment)


def test_a_region_beyond_the_rooms_widens_the_grid() -> None:
    yard = region(99, box(20, 0, 21, 1), "blocked_region")
    assert at(storey_grid(with_entities(two_rooms(), yard)), 20.5, 0.5) == 100


def test_objects_between_planes_are_found() -> None:
    shelf = solid(99, (1.0, 1.0, 0.96), (2.0, 1.3, 0.975), "shelf")
    storey = with_entities(two_rooms(), shelf)
    assert at(storey_grid(storey), 1.5, 1.15) == 100
    assert at(storey_grid(storey, increment=0.05), 1.5, 1.15) == 0


@pytest.mark.parametrize("interval", [(0.0, 1.8), (-0.1, 0.5), (-1.0, 0.0)])
def test_an_interval_that_contains_the_floor_is_refused(interval: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="contains the floor"):
        storey_grid(two_rooms(), interval)


def test_the_walls_of_a_room_with_a_mesh_are_occupied() -> None:
    hall = solid(1, (0, 0, 0), (6, 4, 3), "hall", kind="room")
    made = storey_grid(scene(hall, floors=(room("hall", 0, 0, 6, 4),)))
    assert at(made, 0.0, 2.0) == 100
    assert at(made, 3.0, 2.0) == 0


def test_an_object_of_the_storey_below_that_reaches_up_is_occupied() -> None:
    tall = solid(1, (1, 1, 0), (7, 1.2, 6), "wall", "building_element")
    upper = scene(tall, floors=(room("hall", 0, 0, 8, 4, 3.0),), elevation=3.0)
    assert at(storey_grid(upper), 4.0, 1.1) == 100


# -- beside the costmap -------------------------------------------------------------------------

boxes = st.tuples(
    st.floats(0, 5),
    st.floats(0, 3.5),
    st.sampled_from([-0.5, 0.0, 0.01, 0.4, 1.7]),
    st.floats(0.05, 1.5),
    st.floats(0.05, 1.0),
    st.sampled_from([0.01, 0.3, 1.0, 4.0]),
    st.floats(-3, 3),
)
TYPES = ["mug", "table", "carpet", "floor", "wall"]


def assert_agree(storey: StoreyScene, interval: tuple[float, float], grid: Grid) -> None:
    """The costmap of a robot that is as high as the interval has the obstacles of the grid."""
    robot = part("robot", *interval, square(0.2))
    costmap = Costmap(storey, [robot], grid)
    occupied = np.any([cells[0] for cells in costmap.occupied.values()], axis=0)
    made = storey_grid(storey, interval, grid=grid)
    np.testing.assert_array_equal(made.cells == 100, occupied)
    np.testing.assert_array_equal(made.cells == -1, costmap.unknown & ~occupied)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(boxes, st.sampled_from(TYPES)), max_size=6),
    st.sampled_from([(0.05, 1.8), (0.03, 0.4), (0.5, 1.2)]),
    st.booleans(),
)
def test_grid_and_costmap_agree(
    drawn: list[tuple[tuple[float, ...], str]], interval: tuple[float, float], with_rooms: bool
) -> None:
    entities = [
        solid(n, (x, y, z), (x + dx, y + dy, z + dz), type_, yaw=yaw)
        for n, ((x, y, z, dx, dy, dz, yaw), type_) in enumerate(drawn)
    ]
    ramp = sheet(90, [(2, 0, 0), (4, 0, 0.16), (4, 4, 0.16), (2, 4, 0)], "floor")
    zone = region(91, box(1, 1, 2, 2), "keepout_zone")
    floors = (room("low", 0, 0, 3, 4), room("high", 4, 0, 6, 4, 0.16)) if with_rooms else ()
    grid = Grid((-0.5, -0.5), 0.1, (50, 80))
    assert_agree(scene(*entities, ramp, zone, floors=floors), interval, grid)


def test_grid_and_costmap_agree_on_the_office(office_world: Engine) -> None:
    with office_world.connect() as connection:
        storeys = read_storeys(seen_by(connection))
    assert len(storeys) == 2
    for storey in storeys:
        grid = storey_grid(storey).grid
        for low in np.arange(0.05, 1.8, 0.25):
            assert_agree(storey, (float(low), float(low) + 0.25), grid)


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_without_rooms_a_grid_covers_the_floor_and_not_the_ground_or_the_storey_above(
    yaw: float,
) -> None:
    hall = solid(1, (0, 0, -0.2), (16, 9, 0), "floor", yaw=yaw)
    table = solid(2, (4, 4, 0), (5.2, 4.8, 0.75), "table")
    ground = solid(3, (-200, -200, -0.5), (200, 200, -0.2), "ground", "building_element")
    above = solid(4, (-30, -30, 3.0), (30, 30, 3.2), "floor")
    made = storey_grid(scene(hall, table, ground, above))
    corners = hall.triangles[:, :, :2].reshape(-1, 2)
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    size, (rows, columns) = made.grid.resolution, made.grid.shape
    assert np.allclose(made.grid.origin, low, atol=size)
    assert np.allclose((columns * size, rows * size), high - low, atol=2 * size)
    y, x = np.argwhere(made.cells == 100).T
    taken = np.array(made.grid.origin) + size * np.column_stack([x + 0.5, y + 0.5])
    assert len(taken) == pytest.approx(1.2 * 0.8 / size**2, rel=0.15)
    assert (np.abs(taken - (4.6, 4.4)) <= (0.6 + size, 0.4 + size)).all()
    assert (made.cells == 0).sum() == made.cells.size - len(taken)


def test_an_empty_floor_is_free() -> None:
    made = storey_grid(scene(solid(1, (0, 0, -0.2), (6, 4, 0), "floor")))
    assert (made.cells == 0).all()
    assert made.cells.size * made.grid.resolution**2 > 6 * 4
