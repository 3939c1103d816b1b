"""The layered costmap against brute force, point by point; and updated against computed anew."""

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
]  # fmt: skip


def centres(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r, c = np.mgrid[: grid.shape[0], : grid.shape[1]]
    return (grid.origin[0] + (c + 0.5) * grid.resolution,
            grid.origin[1] + (r + 0.5) * grid.resolution)  # fmt: skip


def brute_cells(
    things: list[SceneEntity], low: float, high: float, grid: Grid
) -> NDArray[np.bool_]:
    """Cells whose half-open square meets the footprint of an upright box that reaches into [a, b].

    By shapely; what only touches a border is left open (True in the second array).
    """
    found = np.zeros((2, *grid.shape), bool)
    x, y = centres(grid)
    half = grid.resolution / 2
    squares = shapely.box(x - half, y - half, x + half, y + half)
    for box in things:
        z = box.triangles[:, :, 2]
        if z.max() < low or z.min() > high:
            continue
        outline = shapely.MultiPoint(box.triangles.reshape(-1, 3)[:, :2]).convex_hull
        found[0] |= shapely.area(shapely.intersection(outline, squares)) > 1e-9
        found[1] |= (shapely.distance(squares, outline) < 1e-9) & (
            shapely.area(shapely.intersection(outline, squares)) <= 1e-9
        )
    return found


def brute_cost(occupied: NDArray[np.bool_], inscribed: float, reach: float, k: float, res: float
               ) -> NDArray[np.uint8]:  # fmt: skip
    """The formula of costmap_2d by the distance to every occupied cell."""
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
            if squared == 0:
                cost[r, c] = 254
            elif math.sqrt(squared) <= inscribed / res + 1e-9:
                cost[r, c] = 253
            else:
                cost[r, c] = int(252 * math.exp(-k * (d - inscribed)))
    return cost


boxes = st.tuples(
    st.floats(0, 5), st.floats(0, 3.5), st.sampled_from([0.0, 0.1, 0.4, 0.9]),
    st.floats(0.05, 1.5), st.floats(0.05, 1.0), st.sampled_from([0.05, 0.3, 1.0]),
    st.floats(-3, 3),
)  # fmt: skip
SMALL = Grid((0.0, 0.0), 0.2, (20, 30))


def box_things(said: list[tuple[float, ...]]) -> list[SceneEntity]:
    sorts = ("mug", "wall", "table")
    return [
        solid(
            n, (x, y, z), (x + dx, y + dy, z + dz), sorts[n % 3], yaw=yaw,
            properties={"workplace": "human"} if n % 3 == 2 else {},
        )
        for n, (x, y, z, dx, dy, dz, yaw) in enumerate(said)
    ]  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(st.lists(boxes, min_size=1, max_size=5))
def test_the_master_is_the_highest_of_all_by_brute_force(said: list[tuple[float, ...]]) -> None:
    things = box_things(said)
    parts = [BASE, ARM]
    made = Costmap(scene(*things), parts, SMALL, inflation=FALL)
    policy = Policy.default()
    master = np.zeros(SMALL.shape, np.uint8)
    for number, each in enumerate(parts):
        low, high = max(each.interval[0], 0.02), each.interval[1]
        for layer in policy.layers:
            members = [t for t in things if policy.layer_of(t) == layer.name]
            wanted, open_ = brute_cells(members, low, high, SMALL)
            got = made.occupied[layer.name][number]
            assert (got == wanted)[~open_].all()
            cost = brute_cost(
                got, each.radius + layer.padding, max(0.6, each.radius) + layer.padding, 3.0, 0.2
            )
            master = np.maximum(master, cost)
    assert (made.master == master).all()


@settings(max_examples=25, deadline=None)
@given(
    st.lists(boxes, min_size=1, max_size=5),
    st.lists(st.tuples(st.integers(0, 5), boxes, st.booleans()), min_size=1, max_size=4),
)
def test_an_update_is_all_computed_anew(
    said: list[tuple[float, ...]], moves: list[tuple[int, tuple[float, ...], bool]]
) -> None:
    things = {t.id: t for t in box_things(said)}
    made = Costmap(scene(*things.values(), floors=(HALL,)), [BASE, ARM, POLE], GRID, inflation=FALL)
    for number, box, gone in moves:
        if gone and number in things:
            del things[number]
            made.update([], [number])
        else:
            things[number] = box_things([box] * (number + 1))[number]
            made.update([things[number]])
        anew = Costmap(
            scene(*things.values(), floors=(HALL,)), [BASE, ARM, POLE], GRID, inflation=FALL
        )
        assert (made.master == anew.master).all()
        assert (made.costs == anew.costs).all()
        for name, cells in anew.occupied.items():
            assert (made.occupied[name] == cells).all()


def test_an_update_computes_only_what_is_near() -> None:
    things = [solid(n, (n, 1, 0), (n + 0.2, 1.2, 1), "chair") for n in range(5)]
    wide = Grid((0.0, 0.0), 0.05, (200, 400))
    made = Costmap(scene(*things), [BASE], wide, inflation=FALL)
    window = made.update([solid(0, (0.1, 1, 0), (0.3, 1.2, 1), "chair")])
    assert window is not None
    rows, columns = (s.stop - s.start for s in window)
    assert rows * columns < 40 * 40
    assert made.update([], [17]) is None, "nobody knows it"


def test_floors_that_change_are_computed_anew() -> None:
    places = (room("low", 0, 0, 3, 4), room("high", 3, 0, 6, 4, 0.3))
    step = sheet(9, [(3, 0, 0.3), (6, 0, 0.3), (6, 4, 0.3), (3, 4, 0.3)], "floor")
    ball = solid(1, (4, 2, 0.35), (4.4, 2.4, 0.5), "ball")
    made = Costmap(scene(ball, floors=places), [BASE], GRID, inflation=FALL)
    made.update([step])
    anew = Costmap(scene(ball, step, floors=places), [BASE], GRID, inflation=FALL)
    assert (made.master == anew.master).all()


def test_the_arm_passes_above_the_table_the_base_below() -> None:
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


def test_thresholds_ramps_and_steps() -> None:
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
        scene(ground, ramp, top, floors=(room("hall", 0, 0, 6, 4),)), [BASE], GRID,
        limits=DriveLimits(max_slope=math.radians(3)),
    )  # fmt: skip
    assert (steep.master[20, 25:58] == 254).all(), "neither the ramp nor where it leads"


def test_blocked_regions_fill_their_whole_area_whatever_their_height() -> None:
    stairs = SceneEntity(
        1, "stairs", "region", ("staircase", "region"), footprint=shapely.box(2, 1, 4, 3)
    )
    made = Costmap(scene(stairs, floors=(HALL,)), [BASE, ARM], GRID)
    assert made.occupied["blocked_regions"].all(axis=0).sum() == 21 * 21
    assert made.master[made.grid.cell(3, 2)] == 254


def test_doors_by_state() -> None:
    box = solid(1, (2, 1, 0), (2.05, 1.9, 2.1), "door", kind="connector", state="closed")
    made = Costmap(scene(box), [BASE], GRID)
    assert made.master[made.grid.cell(2.02, 1.5)] == 254
    opened = SceneEntity(1, "door", "connector", ("door",), box.triangles, state="open")
    made.update([opened])
    assert not made.master.any()


def test_outside_of_every_room_is_unknown_and_known_beats_it() -> None:
    wall = solid(1, (3.02, 0, 0), (3.18, 4, 2), "wall")
    made = Costmap(scene(wall, floors=(room("half", 0, 0, 3, 4),)), [BASE], GRID)
    assert made.master[made.grid.cell(5.0, 2.0)] == 255
    assert made.master[made.grid.cell(3.1, 2.0)] == 254
    assert made.master[made.grid.cell(3.35, 2.0)] == 253, "as costmap_2d: inscribed is known"
    costs = np.array([[[255, 255, 10]], [[255, 3, 254]]], np.uint8)
    assert joined(costs).tolist() == [[255, 3, 254]]


def test_why_names_the_entity() -> None:
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


def test_a_shell_of_a_room_is_hollow_its_pillars_solid() -> None:
    shell = solid(1, (0.52, 0.52, 0), (5.52, 3.52, 2.5), "hall", kind="room")
    made = Costmap(scene(shell), [BASE], GRID)
    assert made.master[made.grid.cell(3, 2)] == 0
    assert made.master[made.grid.cell(0.55, 2)] == 254


def test_the_section_of_a_laser() -> None:
    column = solid(1, (2.02, 1.02, 0.3), (2.18, 1.08, 0.7), "column")
    shelf = solid(2, (4.02, 1.02, 0.6), (4.48, 1.38, 0.7), "shelf")
    made = Costmap(scene(column, shelf, floors=(HALL,)), [BASE], GRID)
    assert [made.section(z).sum() for z in (0.2, 0.4, 0.65, 0.8)] == [0, 2, 2 + 5 * 4, 0]


@pytest.mark.parametrize(
    ("parts", "says"),
    [([], "give one or more"), ([part("wheel", 0.0, 0.015, square(0.1))], "can meet only floor")],
)
def test_robots_that_touch_nothing(parts: list[Part], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Costmap(scene(), parts, GRID)


def test_threads_agree() -> None:
    things = box_things([(0.3 * k, 0.2 * k, 0.0, 0.9, 0.4, 1.0, k) for k in range(12)])
    one, two = (Costmap(scene(*things), [BASE, ARM], GRID, threads=n).master for n in (1, 2))
    assert (one == two).all()
