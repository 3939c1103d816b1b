"""The layered costmap against brute force, point by point; and updated ones against new ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navgrid.costmap import Costmap, Inflation, joined
from navgrid.grid import Grid
from navgrid.headings import MOVES
from navgrid.policy import Policy
from navgrid.terrain import DriveLimits
from semmap.query.storey_scene import SceneEntity
from semmap.robot import Part
from tests.navgrid.scenes import ARM, BASE, POLE, part, room, scene, sheet, solid, square

GRID = Grid((0.0, 0.0), 0.1, (40, 60))
HALL = room("hall", 0, 0, 6, 4)
FALL = Inflation(0.6, 3.0)
TABLE = [
    solid(1, (2, 1, 0.70), (4, 3, 0.75), "table"),
    *(
        solid(2 + k, (x, y, 0), (x + 0.05, y + 0.05, 0.70), "table")
        for k, (x, y) in enumerate([(2.0, 1.0), (3.95, 1.0), (2.0, 2.95), (3.95, 2.95)])
    ),
]


def centres(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r, c = np.mgrid[: grid.shape[0], : grid.shape[1]]
    return (
        grid.origin[0] + (c + 0.5) * grid.resolution,
        grid.origin[1] + (r + 0.5) * grid.resolution,
    )


def brute_cells(
    entities: list[SceneEntity], low: float, high: float, grid: Grid
) -> NDArray[np.bool_]:
    """Cells whose half-open square meets the footprint of an upright box that reaches into [a, b].

    By shapely; what only touches a border is left open (True in the second array).
    """
    found = np.zeros((2, *grid.shape), bool)
    x, y = centres(grid)
    half = grid.resolution / 2
    squares = shapely.box(x - half, y - half, x + half, y + half)
    for box in entities:
        z = box.triangles[:, :, 2]
        if z.max() < low or z.min() > high:
            continue
        outline = shapely.MultiPoint(box.triangles.reshape(-1, 3)[:, :2]).convex_hull
        found[0] |= shapely.area(shapely.intersection(outline, squares)) > 1e-9
        found[1] |= (shapely.distance(squares, outline) < 1e-9) & (
            shapely.area(shapely.intersection(outline, squares)) <= 1e-9
        )
    return found


def brute_cost(
    occupied: NDArray[np.bool_], inscribed: float, reach: float, k: float, res: float
) -> NDArray[np.uint8]:
    """The formula of costmap_2d by the distance to every occupied cell, below 253."""
    cost = np.zeros(occupied.shape, np.uint8)
    at = np.argwhere(occupied)
    if not len(at):
        return cost
    rows, columns = occupied.shape
    most = math.ceil(reach / res - 1e-9)
    for r in range(rows):
        for c in range(columns):
            squared = int(((at - (r, c)) ** 2).sum(axis=1).min())
            if squared > most * most:
                continue
            d = math.sqrt(squared) * res
            if math.sqrt(squared) <= inscribed / res + 1e-9:
                cost[r, c] = 252
            else:
                cost[r, c] = int(252 * math.exp(-k * (d - inscribed)))
    return cost


def brute_headings(
    occupied: NDArray[np.bool_], footprint: NDArray[np.float64], padding: float, grid: Grid
) -> NDArray[np.bool_]:
    """(2, 16, rows, columns): where a turned footprint surely meets cells, and where perhaps."""
    found = np.zeros((2, 16, *grid.shape), bool)
    r, c = np.nonzero(occupied)
    if not len(r):
        return found
    x, y = grid.origin[0] + c * grid.resolution, grid.origin[1] + r * grid.resolution
    blocks = shapely.union_all(shapely.box(x, y, x + grid.resolution, y + grid.resolution))
    shapely.prepare(blocks)
    middles = np.stack(centres(grid), -1)
    for h, (rows, columns) in enumerate(MOVES):
        yaw = math.atan2(rows, columns)
        turned = shapely.affinity.rotate(
            shapely.Polygon(footprint), yaw, (0, 0), use_radians=True
        ).buffer(padding)
        inner = shapely.get_coordinates(turned.buffer(-2e-3))
        outer = shapely.get_coordinates(turned.buffer(2e-3))
        for k, ring in enumerate((inner, outer)):
            if len(ring):
                placed = shapely.polygons(middles[:, :, None, :] + ring)
                found[k, h] = shapely.intersects(blocks, placed)
    return found


boxes = st.tuples(
    st.floats(0, 5),
    st.floats(0, 3.5),
    st.sampled_from([0.0, 0.1, 0.4, 0.9]),
    st.floats(0.05, 1.5),
    st.floats(0.05, 1.0),
    st.sampled_from([0.05, 0.3, 1.0]),
    st.floats(-3, 3),
)
SMALL = Grid((0.0, 0.0), 0.2, (20, 30))


def box_objects(drawn: list[tuple[float, ...]]) -> list[SceneEntity]:
    sorts = ("mug", "wall", "table")
    return [
        solid(
            n,
            (x, y, z),
            (x + dx, y + dy, z + dz),
            sorts[n % 3],
            yaw=yaw,
            properties={"workplace": "human"} if n % 3 == 2 else {},
        )
        for n, (x, y, z, dx, dy, dz, yaw) in enumerate(drawn)
    ]


@settings(max_examples=25, deadline=None)
@given(st.lists(boxes, min_size=1, max_size=5))
def test_the_master_equals_the_maximum_computed_by_brute_force(
    drawn: list[tuple[float, ...]],
) -> None:
    entities = box_objects(drawn)
    parts = [BASE, ARM]
    made = Costmap(scene(*entities), parts, SMALL, inflation=FALL)
    policy = Policy.default()
    master = np.zeros(SMALL.shape, np.uint8)
    headings = np.zeros((2, 16, *SMALL.shape), bool)
    lethal = np.zeros(SMALL.shape, bool)
    for number, each in enumerate(parts):
        low, high = max(each.interval[0], 0.02), each.interval[1]
        for layer in policy.layers:
            members = [t for t in entities if policy.layer_of(t) == layer.name]
            wanted, open_ = brute_cells(members, low, high, SMALL)
            got = made.occupied[layer.name][number]
            assert (got == wanted)[~open_].all()
            cost = brute_cost(
                got,
                each.inscribed_radius + layer.padding,
                max(0.6, each.inscribed_radius) + layer.padding,
                3.0,
                0.2,
            )
            master = np.maximum(master, cost)
            headings |= brute_headings(got, each.footprint, layer.padding, SMALL)
            lethal |= got
    surely, perhaps = headings.all(axis=1)
    assert (made.master[surely] == np.where(lethal, 254, 253)[surely]).all()
    assert (made.master[~perhaps] == master[~perhaps]).all()


@settings(max_examples=25, deadline=None)
@given(
    st.lists(boxes, min_size=1, max_size=5),
    st.lists(st.tuples(st.integers(0, 5), boxes, st.booleans()), min_size=1, max_size=4),
)
def test_an_update_equals_a_new_costmap(
    drawn: list[tuple[float, ...]], moves: list[tuple[int, tuple[float, ...], bool]]
) -> None:
    entities = {t.id: t for t in box_objects(drawn)}
    made = Costmap(
        scene(*entities.values(), floors=(HALL,)), [BASE, ARM, POLE], GRID, inflation=FALL
    )
    for number, box, gone in moves:
        if gone and number in entities:
            del entities[number]
            made.update([], [number])
        else:
            entities[number] = box_objects([box] * (number + 1))[number]
            made.update([entities[number]])
        expected = Costmap(
            scene(*entities.values(), floors=(HALL,)), [BASE, ARM, POLE], GRID, inflation=FALL
        )
        assert (made.master == expected.master).all()
        assert (made.costs == expected.costs).all()
        for name, cells in expected.occupied.items():
            assert (made.occupied[name] == cells).all()


def test_an_update_computes_only_cells_near_the_change() -> None:
    entities = [solid(n, (n, 1, 0), (n + 0.2, 1.2, 1), "chair") for n in range(5)]
    wide = Grid((0.0, 0.0), 0.05, (200, 400))
    made = Costmap(scene(*entities), [BASE], wide, inflation=FALL)
    window = made.update([solid(0, (0.1, 1, 0), (0.3, 1.2, 1), "chair")])
    assert window is not None
    rows, columns = (s.stop - s.start for s in window)
    assert rows * columns < 40 * 40
    assert made.update([], [17]) is None, "unknown entity"


def test_a_changed_floor_equals_a_new_costmap() -> None:
    places = (room("low", 0, 0, 3, 4), room("high", 3, 0, 6, 4, 0.3))
    step = sheet(9, [(3, 0, 0.3), (6, 0, 0.3), (6, 4, 0.3), (3, 4, 0.3)], "floor")
    ball = solid(1, (4, 2, 0.35), (4.4, 2.4, 0.5), "ball")
    made = Costmap(scene(ball, floors=places), [BASE], GRID, inflation=FALL)
    made.update([step])
    expected = Costmap(scene(ball, step, floors=places), [BASE], GRID, inflation=FALL)
    assert (made.master == expected.master).all()


def test_the_arm_passes_over_a_table_and_the_base_under_it() -> None:
    arm = part("arm", 0.85, 1.05, square(0.2))
    made = Costmap(scene(*TABLE, floors=(HALL,)), [BASE, arm], GRID)
    single = Costmap(scene(*TABLE, floors=(HALL,)), [part("robot", 0.0, 1.05, square(0.25))], GRID)
    row, column = made.grid.cell(3.0, 2.0)
    assert made.master[row, column] == 0
    assert single.master[row, column] == 254
    legs = made.grid.cell(2.02, 1.02)
    assert made.master[legs] == 254


def test_padding_is_added_before_costs_fall_off() -> None:
    desk = solid(1, (3, 2, 0), (3.1, 2.1, 0.7), "table", properties={"workplace": "human"})
    made = Costmap(scene(desk), [BASE], GRID)
    plain = Costmap(scene(solid(1, (3, 2, 0), (3.1, 2.1, 0.7), "table")), [BASE], GRID)
    row, _ = made.grid.cell(3.05, 2.05)
    inscribed = int((made.master[row] == 253).sum()), int((plain.master[row] == 253).sum())
    assert inscribed[0] - inscribed[1] == 4, "0.2 m to either side, in cells of 0.1 m"


def test_slabs_are_relative_to_the_floor_of_the_room() -> None:
    places = (room("low", 0, 0, 3, 4), room("high", 3, 0, 6, 4, 1.0))
    above = solid(1, (4, 2, 1.1), (4.4, 2.4, 1.2), "box")
    below = solid(2, (4, 1, 0.1), (4.4, 1.4, 0.2), "box")
    low = solid(3, (1, 1, 0.1), (1.4, 1.4, 0.2), "box")
    made = Costmap(scene(above, below, low, floors=places), [BASE], GRID)
    for x, y, lethal in ((4.2, 2.2, True), (1.2, 1.2, True), (4.2, 1.2, False)):
        assert (made.master[made.grid.cell(x, y)] == 254) == lethal, "not under the floor"


def test_thresholds_and_ramps_are_free_and_steep_slopes_are_not() -> None:
    ground = sheet(1, [(0, 0, 0), (2, 0, 0), (2, 4, 0), (0, 4, 0)], "floor")
    ramp = sheet(2, [(2, 0, 0), (4, 0, 0.16), (4, 4, 0.16), (2, 4, 0)], "floor")
    top = sheet(3, [(4, 0, 0.16), (6, 0, 0.16), (6, 4, 0.16), (4, 4, 0.16)], "floor")
    sill = solid(4, (1, 0, 0), (1.1, 4, 0.015), "threshold")
    mug = solid(5, (3, 2, 0.08), (3.1, 2.1, 0.2), "mug")
    made = Costmap(
        scene(ground, ramp, top, sill, mug, floors=(room("hall", 0, 0, 6, 4),)), [BASE], GRID
    )
    assert (made.master == 254).sum() in (1, 2, 4), "the mug on the ramp alone"
    assert made.master[made.grid.cell(3.05, 2.05)] == 254
    steep = Costmap(
        scene(ground, ramp, top, floors=(room("hall", 0, 0, 6, 4),)),
        [BASE],
        GRID,
        limits=DriveLimits(max_slope=math.radians(3)),
    )
    assert (steep.master[20, 25:58] == 254).all(), "neither the ramp nor where it leads"


def test_blocked_regions_fill_their_whole_area_whatever_their_height() -> None:
    stairs = SceneEntity(
        1, "stairs", "region", ("staircase", "region"), footprint=shapely.box(2, 1, 4, 3)
    )
    made = Costmap(scene(stairs, floors=(HALL,)), [BASE, ARM], GRID)
    assert made.occupied["blocked_regions"].all(axis=0).sum() == 21 * 21
    assert made.master[made.grid.cell(3, 2)] == 254


def test_a_door_is_an_obstacle_unless_it_is_open() -> None:
    box = solid(1, (2, 1, 0), (2.05, 1.9, 2.1), "door", kind="connector", state="closed")
    made = Costmap(scene(box), [BASE], GRID)
    assert made.master[made.grid.cell(2.02, 1.5)] == 254
    opened = SceneEntity(1, "door", "connector", ("door",), box.triangles, state="open")
    made.update([opened])
    assert not made.master.any()


def test_cells_outside_of_rooms_are_unknown_unless_an_obstacle_is_there() -> None:
    wall = solid(1, (3.02, 0, 0), (3.18, 4, 2), "wall")
    made = Costmap(scene(wall, floors=(room("half", 0, 0, 3, 4),)), [BASE], GRID)
    assert made.master[made.grid.cell(5.0, 2.0)] == 255
    assert made.master[made.grid.cell(3.1, 2.0)] == 254
    assert made.master[made.grid.cell(3.35, 2.0)] == 253, "as costmap_2d: inscribed is known"
    costs = np.array([[[255, 255, 10]], [[255, 3, 254]]], np.uint8)
    assert joined(costs).tolist() == [[255, 3, 254]]


def test_explain_names_the_entity() -> None:
    made = Costmap(scene(*TABLE, floors=(HALL,)), [BASE, POLE], GRID)
    blames = made.explain(3.0, 2.0)
    assert [(b.part, b.layer, b.entities, b.cost) for b in blames] == [
        ("pole", "admissible_objects", ("solid1",), 254)
    ]
    base = next(b for b in made.explain(2.3, 1.1) if b.part == "base")
    assert base.entities == ("solid2",)
    assert 0 < base.distance < 0.4
    assert made.explain(0.1, 0.1) == []
    with pytest.raises(ValueError, match="not on the grid"):
        made.explain(99, 0)


def test_the_shell_of_a_room_is_hollow() -> None:
    shell = solid(1, (0.52, 0.52, 0), (5.52, 3.52, 2.5), "hall", kind="room")
    made = Costmap(scene(shell), [BASE], GRID)
    assert made.master[made.grid.cell(3, 2)] == 0
    assert made.master[made.grid.cell(0.55, 2)] == 254


def test_a_section_has_the_cells_at_its_height() -> None:
    column = solid(1, (2.02, 1.02, 0.3), (2.18, 1.08, 0.7), "column")
    shelf = solid(2, (4.02, 1.02, 0.6), (4.48, 1.38, 0.7), "shelf")
    made = Costmap(scene(column, shelf, floors=(HALL,)), [BASE], GRID)
    assert [made.section(z).sum() for z in (0.2, 0.4, 0.65, 0.8)] == [0, 2, 2 + 5 * 4, 0]


@pytest.mark.parametrize(
    ("parts", "message"),
    [([], "give one or more"), ([part("wheel", 0.0, 0.015, square(0.1))], "can meet only floor")],
)
def test_robots_without_parts_above_a_step_are_refused(parts: list[Part], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Costmap(scene(), parts, GRID)


def test_the_number_of_threads_does_not_change_the_result() -> None:
    entities = box_objects([(0.3 * k, 0.2 * k, 0.0, 0.9, 0.4, 1.0, k) for k in range(12)])
    one, two = (Costmap(scene(*entities), [BASE, ARM], GRID, threads=n).master for n in (1, 2))
    assert (one == two).all()
