"""Slabs against exact arithmetic, shapely, and themselves: threads, orders, intervals, solids."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.slabs import area_cells, flat_triangles, occupancy
from semmap.geometry.mesh import box_mesh, join
from tests.navgrid.rational import occupied

GRID = Grid((-0.5, 0.25), 0.25, (6, 7))
ODD = Grid((0.1, -0.3), 0.05, (7, 9))
"""Borders that no binary number is."""

# Quarters fall on borders and ends of intervals; the others just beside them. Beside 0 is 1e-60,
# within which products vanish and arithmetic is no longer exact.
quarters = st.integers(-4, 12).map(lambda k: k / 4)
beside = st.tuples(quarters, st.sampled_from([-1, 1])).map(
    lambda p: float(np.nextafter(p[0], p[1] * np.inf)) if p[0] else p[1] * 1e-60
)
within = st.floats(-1, 3).filter(lambda v: v == 0 or abs(v) >= 1e-60)
coordinate = st.one_of(quarters, beside, within)
triangles = st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=3, max_size=3)
intervals = st.tuples(quarters, st.sampled_from([0.0, 0.25, 0.5, 3.0])).map(
    lambda p: (p[0], p[0] + p[1])
)


def cells_of(triangle: Any, interval: tuple[float, float], grid: Grid) -> NDArray[np.bool_]:
    return occupancy((np.array(triangle, float), [[0, 1, 2]]), [interval], grid)[0]


@settings(max_examples=50, deadline=None)
@given(triangles, intervals)
@example([(0, 0.5, 0), (0, 1.0, 1), (0, 1.5, 0)], (0.5, 0.5))  # upright, in a column's border
@example([(0, 0.5, 0.5), (1, 0.5, 0.5), (0.5, 0.5, 0.5)], (0.5, 0.5))  # a line in a row's border
@example([(0.25, 0.5, 1)] * 3, (1, 1))  # a point in a corner of cells
@example([(0, 0.25, 1), (1.25, 1.5, 1), (1.25, 0.25, 1)], (1, 2))  # a diagonal through corners
@example([(-9, -9, 0), (9, -9, 0), (0, 30, 3)], (0.25, 0.5))  # larger than the grid
@example([(0, 0, 0), (0, 0, 0.25), (0, 0.25, -1e-60)], (0, 0))  # just short of a border
def test_a_triangle_agrees_with_exact_arithmetic(
    triangle: list[tuple[float, float, float]], interval: tuple[float, float]
) -> None:
    np.testing.assert_array_equal(
        cells_of(triangle, interval, GRID), occupied(triangle, interval, GRID)
    )


tenths = st.integers(0, 12).map(lambda k: k * 0.05)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(tenths.map(lambda v: v + 0.1), tenths.map(lambda v: v - 0.3), tenths),
        min_size=3,
        max_size=3,
    ),
    st.tuples(tenths, tenths).map(sorted),
)
def test_triangles_on_rounded_borders_agree_with_exact_arithmetic(
    triangle: list[tuple[float, float, float]], interval: list[float]
) -> None:
    ends = (interval[0], interval[1])
    np.testing.assert_array_equal(cells_of(triangle, ends, ODD), occupied(triangle, ends, ODD))


@st.composite
def close_to_borders(draw: st.DrawFn) -> tuple[float, float, float]:
    """A corner on the grid, as near to borders as single precision tells, and nearer."""
    x, y = (
        draw(st.integers(0, 6)) / 4 + draw(st.sampled_from([-1, 1])) * 10 ** draw(st.floats(-9, -1))
        for _ in range(2)
    )
    return x - 0.5, y + 0.25, draw(st.sampled_from([0.5, 1.0, 2.5]))


@settings(max_examples=40, deadline=None)
@given(
    st.lists(close_to_borders(), min_size=3, max_size=3),
    st.sampled_from([(0.25, 3.0), (0.6, 0.9), (0.75, 2.0)]),
)
@example([(0.0, 0.5, 1), (0.25 - 1e-7, 1.0, 1), (0.25 - 1e-7, 0.6, 1)], (0.25, 3.0))
@example([(0.0, 0.75 - 1e-7, 1), (1.0, 0.75 + 1e-7, 1), (0.5, 1.5, 1)], (0.25, 3.0))
def test_borders_are_decided_beyond_single_precision(
    triangle: list[tuple[float, float, float]], interval: tuple[float, float]
) -> None:
    np.testing.assert_array_equal(
        cells_of(triangle, interval, GRID), occupied(triangle, interval, GRID)
    )


def test_a_grid_may_be_wider_than_16_bit_numbers() -> None:
    random = np.random.default_rng(4)
    long = Grid((-1000.0, 0.0), 0.25, (6, 40_000))
    for _ in range(50):
        near = random.uniform(0, 2, (3, 3)) + np.array([8750, 0, 0])  # beyond column 32,767
        cells = cells_of(near, (0.5, 1.0), long)
        window = cells_of(near, (0.5, 1.0), Grid((8749.0, 0.0), 0.25, (6, 16)))
        np.testing.assert_array_equal(cells[:, 38_996:39_012], window)
        assert cells.sum() == window.sum()


def test_a_border_is_the_rounded_product() -> None:
    """390 * 0.05 is 19.5, though 0.05 is a little more than a twentieth."""
    assert Fraction(0.05) * 390 > Fraction("19.5")
    grid = Grid((0.0, 0.0), 0.05, (2, 400))
    cells = cells_of([(19.5, 0.01, 0)] * 3, (0, 1), grid)
    assert np.argwhere(cells).tolist() == [[0, 390]]


def clipped(triangle: NDArray[np.float64], low: float, high: float) -> shapely.Geometry:
    """What of a triangle lies between two planes, projected, by interpolation along its edges."""
    points = [p[:2] for p in triangle if low <= p[2] <= high]
    for p, q in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        for plane in (low, high):
            if min(p[2], q[2]) < plane < max(p[2], q[2]):
                points.append(p[:2] + (plane - p[2]) / (q[2] - p[2]) * (q[:2] - p[:2]))
    return shapely.MultiPoint(points).convex_hull if points else shapely.Point()


def test_thousands_of_triangles_agree_with_shapely() -> None:
    random = np.random.default_rng(11)
    grid = Grid((-1.0, -1.0), 0.1, (30, 30))
    r, c = np.mgrid[:30, :30]
    squares = shapely.box(c * 0.1 - 1, r * 0.1 - 1, c * 0.1 - 0.9, r * 0.1 - 0.9)
    for _ in range(600):
        size = random.choice([0.05, 0.5, 3.0])
        triangle = random.uniform(-1, 2, 3) + random.uniform(-size, size, (3, 3))
        low, high = np.sort(random.uniform(-1, 2, 2))
        part = clipped(triangle, low, high)
        got = cells_of(triangle, (low, high), grid)
        if part.is_empty:
            assert not got.any()
            continue
        distance = shapely.distance(squares, part)
        inside = distance == 0
        near = shapely.distance(shapely.boundary(squares), part) < 1e-9
        unsure = near & (shapely.area(shapely.intersection(squares, part.buffer(1e-12))) < 1e-10)
        assert (got == inside)[~unsure & ((distance == 0) | (distance > 1e-9))].all()


def soup(count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    random = np.random.default_rng(seed)
    corners = random.uniform(-1, 3, (count, 1, 3)) + random.normal(0, 0.3, (count, 3, 3))
    corners[::5] = np.round(corners[::5] * 4) / 4
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


WIDE = Grid((-1.0, -1.0), 0.05, (80, 81))
MANY = [(0.1 * k, 0.1 * k + 0.07 * (k % 5)) for k in range(-8, 40)]


def test_many_intervals_in_one_pass_equal_single_passes() -> None:
    mesh = soup(2000, 1)
    together = occupancy(mesh, MANY, WIDE)
    for interval, layer in zip(MANY, together, strict=True):
        np.testing.assert_array_equal(layer, occupancy(mesh, [interval], WIDE)[0])


@pytest.mark.parametrize("fill", [False, True])
def test_threads_and_order_do_not_change_the_result(fill: bool) -> None:
    vertices, faces = soup(30_000, 2)
    solid = np.arange(len(faces)) % 400
    order = np.random.default_rng(3).permutation(len(faces))
    wanted = occupancy((vertices, faces), MANY[:9], WIDE, solid=solid, fill=fill, threads=1)
    for threads in (2, 7):
        got = occupancy((vertices, faces), MANY[:9], WIDE, solid=solid, fill=fill, threads=threads)
        np.testing.assert_array_equal(got, wanted)
    got = occupancy((vertices, faces[order]), MANY[:9], WIDE, solid=solid[order], fill=fill)
    np.testing.assert_array_equal(got, wanted)


def test_a_slab_contains_its_slices() -> None:
    mesh = soup(3000, 4)
    for low, high in [(0.0, 0.5), (-1.0, 2.0), (0.3, 0.3)]:
        (slab,) = occupancy(mesh, [(low, high)], WIDE)
        planes = occupancy(mesh, [(h, h) for h in np.linspace(low, high, 12)], WIDE)
        assert (slab | ~planes).all()
        assert slab.sum() >= planes.any(axis=0).sum()


ball = trimesh.creation.icosphere(subdivisions=3, radius=0.7)
ring = trimesh.creation.torus(0.8, 0.25)


@pytest.mark.parametrize(
    "body",
    [ball, ring, ring.slice_plane([0, 0, 0.05], [0, 0, 1], cap=True)],
    ids=["ball", "torus", "half a torus"],
)
@pytest.mark.parametrize("flip", [False, True])
def test_the_inside_of_closed_meshes_agrees_with_trimesh(body: Any, flip: bool) -> None:
    """Columns of points through each cell's middle: occupied if one in the slab is inside."""
    faces = np.asarray(body.faces)[:, ::-1] if flip else np.asarray(body.faces)
    grid = Grid((-1.3, -1.3), 0.1, (26, 26))
    low, high = 0.06, 0.11
    (filled,) = occupancy((np.asarray(body.vertices), faces), [(low, high)], grid, fill=True)
    (hollow,) = occupancy((np.asarray(body.vertices), faces), [(low, high)], grid)
    r, c = np.mgrid[:26, :26]
    points = np.stack([c * 0.1 - 1.25, r * 0.1 - 1.25, np.full(c.shape, (low + high) / 2)], -1)
    inside = body.contains(points.reshape(-1, 3)).reshape(c.shape)
    assert (filled | ~inside).all()
    np.testing.assert_array_equal(filled, hollow | inside)
    assert inside.sum() > 20


def test_nested_and_open_solids_are_filled_correctly() -> None:
    grid = Grid((0, 0), 0.1, (20, 20))
    outer, inner = (
        box_mesh((0.22, 0.22, 0), (1.78, 1.78, 1)),
        box_mesh((0.62, 0.62, 0), (1.38, 1.38, 1)),
    )
    hole = type(inner)(inner.vertices, inner.faces[:, ::-1])
    both = join([outer, hole])
    one = occupancy((both.vertices, both.faces), [(0.2, 0.4)], grid, fill=True)[0]
    assert one[4, 4]
    assert not one[10, 10], "one solid with a shaft"
    two = occupancy(
        (both.vertices, both.faces), [(0.2, 0.4)], grid, solid=np.repeat([0, 1], 12), fill=True
    )[0]
    assert two[10, 10], "two solids"
    some = occupancy(
        (both.vertices, both.faces),
        [(0.2, 0.4)],
        grid,
        solid=np.repeat([0, 1], 12),
        fill=np.array([False, True]),
    )[0]
    assert some[10, 10]
    assert not some[4, 4], "only the inner one is filled"
    cut = occupancy((outer.vertices, outer.faces[1:]), [(0.2, 0.4)], grid, fill=True)[0]
    assert not cut[10, 10], "an open mesh has no inside"


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            *[st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)] * 3
        ),
        min_size=3,
        max_size=12,
    ),
    st.floats(-1e9, 1e9),
    st.floats(0, 1e9),
    st.booleans(),
)
def test_far_and_huge_meshes_do_not_crash(
    corners: list[tuple[float, float, float]], low: float, thick: float, fill: bool
) -> None:
    vertices = np.array(corners[: len(corners) // 3 * 3])
    faces = np.arange(len(vertices)).reshape(-1, 3)
    cells = occupancy((vertices, faces), [(low, low + thick)], WIDE, fill=fill)
    assert cells.shape == (1, *WIDE.shape)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ([(1, 0)], "upside down"),
        ([(0, np.nan)], "give ends"),
        ([(0, np.inf)], "give ends"),
        ([3], "give a pair"),
        ([(1e31, 1e32)], "give ends"),
    ],
)
def test_invalid_intervals_are_refused(ends: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        occupancy((np.zeros((3, 3)), [[0, 1, 2]]), ends, GRID)


def test_coordinates_that_are_not_finite_or_too_large_are_refused() -> None:
    for value in (np.nan, np.inf, 1e31):
        for axis in range(3):
            vertices = np.zeros((3, 3))
            vertices[1, axis] = value
            with pytest.raises(ValueError, match=r"finite|within"):
                occupancy((vertices, [[0, 1, 2]]), [(0, 1)], GRID)
    with pytest.raises(ValueError, match="resolution"):
        Grid((0, 0), 0.0, (3, 3))


# --- polygons: against shapely, square by square

AREA = Grid((-1.0, -0.5), 0.25, (16, 20))
SQUARES = np.array(
    [
        [
            shapely.box(-1 + c * 0.25, -0.5 + r * 0.25, -0.75 + c * 0.25, -0.25 + r * 0.25)
            for c in range(20)
        ]
        for r in range(16)
    ]
)

outlines = st.lists(st.tuples(st.floats(-2, 5), st.floats(-2, 5)), min_size=3, max_size=8)


@settings(max_examples=70, deadline=None)
@given(outlines, outlines)
def test_area_cells_are_the_cells_that_the_polygon_meets(
    outer: list[tuple[float, float]], hole: list[tuple[float, float]]
) -> None:
    shape = shapely.MultiPoint(outer).convex_hull - shapely.MultiPoint(hole).convex_hull
    shape = shape.buffer(0)
    cells = area_cells(shape, AREA)
    near = shapely.distance(SQUARES, shape) if not shape.is_empty else np.full(AREA.shape, np.inf)
    overlap = shapely.area(shapely.intersection(SQUARES, shape))
    assert not cells[near > 1e-9].any()
    assert cells[overlap > 1e-9].all()


def test_a_border_belongs_to_the_cell_above_and_right_of_it() -> None:
    cells = area_cells(shapely.box(0, 0, 0.5, 0.25), AREA)
    assert np.argwhere(cells).tolist() == [[r, c] for r in (2, 3) for c in (4, 5, 6)]


def test_an_empty_outline_has_no_cells() -> None:
    assert not area_cells(shapely.Polygon(), AREA).any()
    assert not len(flat_triangles(shapely.Point(0, 0)))


def test_flat_triangles_cover_exactly_the_polygon() -> None:
    shape = shapely.MultiPolygon(
        [shapely.box(0, 0, 4, 3) - shapely.box(1, 1, 2, 2), shapely.box(6, 0, 7, 1)]
    )
    parts = shapely.polygons(flat_triangles(shape)[:, :, :2])
    assert shapely.union_all(parts).symmetric_difference(shape).area < 1e-12
    assert abs(shapely.area(parts).sum() - shape.area) < 1e-12
