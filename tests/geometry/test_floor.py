"""Walkable floors of rooms by hand, and shadows against points in boxes."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from semmap.geometry.floor import shadow, walkable_floor
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.geometry.pose import Pose

ROOM = shapely.box(0, 0, 5, 4)


def sheet(corners: list[tuple[float, float, float]]) -> Mesh:
    """A convex polygon as a fan of triangles."""
    faces = [(0, k, k + 1) for k in range(1, len(corners) - 1)]
    return Mesh(np.array(corners, float), np.array(faces, np.int32))


def level(x0: float, y0: float, x1: float, y1: float, z: float) -> Mesh:
    return sheet([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])


def walked(room: Mesh | None, *things: Mesh, **how: float) -> float:
    floor = walkable_floor(ROOM, 0.0, room, [(t, True) for t in things], **how)
    return 0.0 if floor is None else floor.outline.area


def test_a_drawn_room_is_floor_but_where_something_stands() -> None:
    table = join([box_mesh((1, 1, 0.7), (2, 2, 0.74)), box_mesh((1, 1, 0), (1.1, 1.1, 0.7))])
    assert walked(None) == pytest.approx(20)
    assert walked(None, table) == pytest.approx(19, abs=0.02)
    assert walked(None, table, headroom=0.6) == pytest.approx(19.99, abs=0.02)
    assert walked(None, box_mesh((1, 1, 0), (2, 2, 0.02))) == pytest.approx(20), "a carpet"
    assert walked(None, box_mesh((1, 1, 2.2), (2, 2, 2.4))) == pytest.approx(20), "a lamp"
    assert walked(None, box_mesh((-1, -1, 0), (9, 9, 1))) == 0


def test_what_a_thing_encloses_is_its_own() -> None:
    crate = join(
        [
            box_mesh((1, 1, 0), (2, 1.02, 3)),
            box_mesh((1, 1.98, 0), (2, 2, 3)),
            box_mesh((1, 1.02, 0), (1.02, 1.98, 3)),
            box_mesh((1.98, 1.02, 0), (2, 1.98, 3)),
        ]
    )
    assert shadow(crate, 0.1, 2, fill=True).area == pytest.approx(1, abs=1e-2)
    assert shadow(crate, 0.1, 2, fill=False).area == pytest.approx(1 - 0.96**2, abs=1e-2)


def test_an_open_shell_encloses_air() -> None:
    closed = box_mesh((1, 1, 0), (2, 2, 3))
    sides = [f for f in closed.faces if np.ptp(closed.vertices[f][:, 2]) > 0]
    walls = Mesh(closed.vertices, np.array(sides, np.int32))
    assert shadow(walls, 0.1, 2, fill=False).area < 0.02
    assert shadow(closed, 0.1, 2, fill=False).area == pytest.approx(1, abs=1e-2)


def test_a_meshs_floor_hangs_together_by_steps() -> None:
    ground, platform = level(0, 0, 3, 4, 0), level(3, 0, 5, 4, 0.15)
    riser = sheet([(3, 0, 0), (3, 4, 0), (3, 4, 0.15), (3, 0, 0.15)])
    both = join([ground, platform, riser])
    assert walked(both) == pytest.approx(12, rel=2e-3), "15 cm are too high a step"
    assert walked(both, max_step=0.2) == pytest.approx(20, rel=2e-3)
    gap = join([ground, level(3.2, 0, 5, 4, 0)])
    assert walked(gap) == pytest.approx(19.2, rel=1e-3), "of one height on both sides of a gap"


def test_a_ramp_is_floor_up_to_the_slope() -> None:
    ramp = sheet([(3, 0, 0), (5, 0, 0.3), (5, 4, 0.3), (3, 4, 0)])
    room = join([level(0, 0, 3, 4, 0), ramp])
    floor = walkable_floor(ROOM, 0.0, room, [])
    assert floor is not None
    assert floor.outline.area == pytest.approx(20)
    assert (floor.low, floor.high) == pytest.approx((0, 0.3))
    assert walked(room, max_slope=math.radians(5)) == pytest.approx(12)


def test_a_wedge_and_a_step_of_the_room_are_floor_on_top() -> None:
    wedge = box_mesh((1, 1, 0), (3, 2, 0.2))
    down = wedge.vertices.copy()
    down[(down[:, 0] == 1) & (down[:, 2] == 0.2), 2] = 0.001
    for part in (Mesh(down, wedge.faces), Mesh(down, wedge.faces[:, ::-1])):
        room = join([level(0, 0, 5, 4, 0), part, box_mesh((3, 1, 0), (4, 2, 0.2))])
        floor = walkable_floor(ROOM, 0.0, room, [])
        assert floor is not None
        assert floor.outline.area == pytest.approx(20, rel=1e-3)
        assert floor.high == pytest.approx(0.2)


def test_pillars_of_the_room_and_a_low_ceiling() -> None:
    room = join(
        [
            level(0, 0, 5, 4, 0),
            level(0, 0, 5, 4, 2.8),
            box_mesh((2, 2, 0), (2.5, 2.5, 2.8)),
            level(4, 0, 5, 4, 1.5),
        ]
    )
    floor = walkable_floor(ROOM, 0.0, room, [])
    assert floor is not None
    corner = shapely.box(4, 0, 5, 4)
    assert floor.outline.intersection(corner).area < 1e-3, "a gallery at 1.5 m"
    assert floor.high == 0, "which is not reached"
    around = shapely.box(1.9, 1.9, 2.6, 2.6)
    assert floor.outline.intersection(around).area == pytest.approx(around.area - 0.25)


def test_a_floor_elsewhere_is_none() -> None:
    assert walkable_floor(ROOM, 1.0, level(0, 0, 5, 4, 0), []) is None
    assert walkable_floor(Polygon(), 0.0, None, []) is None


boxes = st.tuples(
    st.floats(-0.5, 4),
    st.floats(-0.5, 3),
    st.floats(0.0, 2.5),
    st.floats(0.05, 1),
    st.floats(0.05, 1),
    st.floats(0.05, 2.5),
    st.floats(-3, 3),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(boxes, max_size=4), st.integers(0, 2**32 - 1))
def test_walkable_is_where_no_box_is_above(things: list[tuple[float, ...]], seed: int) -> None:
    """Brute force: a point is floor where no turned box that reaches into the slab covers it."""
    placed = []
    for x, y, z, dx, dy, dz, yaw in things:
        pose = Pose.planar(x, y, yaw)
        placed.append((pose, dx, dy, z, z + dz))
    meshes = [box_mesh((0, 0, z), (dx, dy, top)).moved(p) for p, dx, dy, z, top in placed]
    floor = walkable_floor(ROOM, 0.0, None, [(m, True) for m in meshes], min_area=0)
    points = np.random.default_rng(seed).uniform((0, 0), (5, 4), (300, 2))
    flat = np.column_stack([points, np.zeros(len(points))])
    covered = np.zeros(len(points), bool)
    margin = np.zeros(len(points), bool)
    for pose, dx, dy, z, top in placed:
        if top <= 0.03 or z >= 2.0:
            continue
        u, v, _ = pose.inverse().apply(flat).T
        outside = np.maximum(np.maximum(-u, u - dx), np.maximum(-v, v - dy))
        covered |= outside < 0
        margin |= np.abs(outside) < 0.012
    outline = Polygon() if floor is None else floor.outline
    inside = shapely.contains_xy(outline, points)
    assert (inside == ~covered)[~margin].all()


@pytest.mark.parametrize(("headroom", "max_step"), [(-1.0, 0.03), (0.1, 0.2), (2.0, -0.1)])
def test_steps_and_headroom_that_cannot_be(headroom: float, max_step: float) -> None:
    with pytest.raises(ValueError, match="give 0 <= step"):
        walked(None, headroom=headroom, max_step=max_step)


@pytest.mark.parametrize("seed", [874, *range(20)])
def test_floors_of_tiles_that_nearly_meet_are_united(seed: int) -> None:
    """Tiles and walls whose edges differ by rounding; without a grid, GEOS has no union of one."""
    draw = np.random.default_rng(seed)
    turn, count = draw.uniform(0, 6.3), draw.integers(2, 5)
    around = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    error = 10.0 ** draw.uniform(-12, -6)
    xs, ys = np.cumsum(draw.uniform(0.3, 2, count)), np.cumsum(draw.uniform(0.3, 2, count))

    def near(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
        box = box_mesh(low, high)
        return Mesh(box.vertices + draw.normal(0, error, box.vertices.shape), box.faces)

    tiles = join(
        [near((x0, y0, -0.1), (x1, y1, 0)) for x0, x1 in pairwise(xs) for y0, y1 in pairwise(ys)]
    )
    walls = [(xs[0], ys[k % count], xs[-1] - 0.1, ys[k % count] + 0.1) for k in range(3)]
    solids = [near((x0, y0, 0), (x1, y1, 1)) for x0, y0, x1, y1 in walls]
    whole = shapely.box(xs[0], ys[0], xs[-1], ys[-1])
    found = walkable_floor(
        shapely.affinity.rotate(whole, np.degrees(turn), origin=(0, 0)),
        0.0,
        Mesh(tiles.vertices @ around.T, tiles.faces),
        [(Mesh(solid.vertices @ around.T, solid.faces), True) for solid in solids],
        min_area=0.0,
    )
    free = whole.difference(shapely.union_all([shapely.box(*wall) for wall in walls]))
    assert found is not None
    assert found.outline.area == pytest.approx(free.area, abs=0.002 * free.length)


@pytest.mark.parametrize(("rise", "free"), [(0.03, True), (0.0305, True), (0.032, False)])
def test_a_step_may_be_a_millimetre_too_high(rise: float, free: bool) -> None:
    """As files round their heights; the higher tile is no obstacle then."""
    tiles = join([box_mesh((0, 0, -0.1), (2, 2, 0)), box_mesh((2, 0, -0.1), (4, 2, rise))])
    found = walkable_floor(shapely.box(0, 0, 4, 2), 0.0, tiles, [])
    assert found is not None
    assert found.outline.area == pytest.approx(8.0 if free else 4.0, abs=0.05)
