"""Slices against shapely: a cell is marked where the section meets its square, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from navgrid.grid import Grid
from navgrid.slabs import occupancy
from semmap.geometry.mesh import Mesh, box_mesh

GRID = Grid((-1.0, -0.5), 0.25, (16, 20))
NEAR = 1e-9

metres = st.floats(-2, 5)


def section(triangle: NDArray[np.float64], height: float) -> shapely.Geometry:
    """The section of a triangle by an independent way: interpolation along each edge in shapely."""
    points = []
    for p, q in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        low, high = sorted((p[2], q[2]))
        if low == high == height:
            points += [p[:2], q[:2]]
        elif low <= height <= high:
            edge = shapely.LineString([p[:2], q[:2]])
            share = (height - p[2]) / (q[2] - p[2])
            points.append(np.asarray(edge.interpolate(share, normalized=True).coords[0]))
    if not points:
        return shapely.Point()
    return shapely.MultiPoint(points).convex_hull


def squares() -> list[list[shapely.Polygon]]:
    r, (x, y) = GRID.resolution, GRID.origin
    return [
        [
            shapely.box(x + c * r, y + i * r, x + (c + 1) * r, y + (i + 1) * r)
            for c in range(GRID.shape[1])
        ]
        for i in range(GRID.shape[0])
    ]


SQUARES = squares()


def slices(
    mesh: tuple[ArrayLike, ArrayLike], heights: list[float], grid: Grid
) -> NDArray[np.bool_]:
    """The cells that the sections of a mesh with level planes meet: a plane is [h, h]."""
    return occupancy(mesh, [(h, h) for h in heights], grid)


@settings(max_examples=60, deadline=None)
@given(
    corners=st.lists(st.tuples(metres, metres, metres), min_size=3, max_size=3),
    height=st.one_of(metres, st.just(0.0)),
)
def test_a_triangle_marks_the_cells_that_its_section_meets(
    corners: list[tuple[float, float, float]], height: float
) -> None:
    triangle = np.array(corners)
    cut = section(triangle, height)
    (cells,) = slices((triangle, [[0, 1, 2]]), [height], GRID)
    for row, line in enumerate(SQUARES):
        for column, square in enumerate(line):
            distance = square.distance(cut) if not cut.is_empty else np.inf
            if distance > NEAR:
                assert not cells[row, column]
            elif square.buffer(-NEAR).intersects(cut) and cut.geom_type != "Polygon":
                assert cells[row, column]


def test_a_box_gives_its_four_walls() -> None:
    mesh = box_mesh((0.25, 0.25, 0.0), (1.25, 0.75, 1.0))
    (cells,) = slices((mesh.vertices, mesh.faces), [0.5], Grid((0, 0), 0.125, (8, 12)))
    expected = np.zeros((8, 12), dtype=bool)
    expected[2:7, 2:11] = True  # the upper and right walls lie on borders: of the cell beyond
    expected[3:6, 3:10] = False
    np.testing.assert_array_equal(cells, expected)


def test_planes_beside_the_mesh_are_empty_and_each_has_its_layer() -> None:
    mesh = box_mesh((0, 0, 0), (1, 1, 1))
    cells = slices((mesh.vertices, mesh.faces), [-0.1, 0.5, 1.1], GRID)
    assert cells.shape == (3, *GRID.shape)
    assert [bool(layer.any()) for layer in cells] == [False, True, False]


def test_the_order_of_triangles_does_not_matter() -> None:
    random = np.random.default_rng(7)
    triangles = random.uniform(-1, 4, (200, 3, 3))
    faces = np.arange(600).reshape(-1, 3)
    one = slices((triangles.reshape(-1, 3), faces), [0.3, 1.7], GRID)
    other = slices((triangles.reshape(-1, 3), random.permutation(faces)), [0.3, 1.7], GRID)
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("vertices", "faces", "heights", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], [0], "vertices"),
        (np.zeros((3, 3)), [[0, 1]], [0], "faces"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], [0], "finite"),
        (np.zeros((3, 3)), [[0, 1, 3]], [0], "0 to 2"),
        (np.zeros((3, 3)), [[0, 1, -1]], [0], "0 to 2"),
        (np.zeros((3, 3)), [[0, 1, 2]], [np.inf], "give ends within"),
    ],
)
def test_bad_input_is_refused(
    vertices: NDArray[np.float64], faces: list[list[int]], heights: list[float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        slices((vertices, faces), heights, GRID)


def test_far_and_empty_meshes_have_empty_slices() -> None:
    far = Mesh(np.array([[1e7, 0, 0], [1e7, 1e7, 1], [-1e7, 0, 1.0]]), np.array([[0, 1, 2]]))
    assert slices((far.vertices, far.faces), [0.5], GRID).shape == (1, *GRID.shape)
    assert not slices((np.zeros((0, 3)), np.zeros((0, 3), int)), [0.5], GRID).any()
    assert slices((far.vertices, far.faces), [], GRID).shape == (0, *GRID.shape)


def test_a_filled_solid_that_reaches_beyond_the_grid_stays_in_its_rows() -> None:
    box = box_mesh((3.0, 0.3, 0.0), (9.0, 0.9, 1.0))  # the grid ends at x = 4
    for fill in (False, True):
        (cells,) = occupancy((box.vertices, box.faces), [(0.2, 0.4)], GRID, fill=fill)
        rows, columns = np.nonzero(cells)
        assert (rows.min(), rows.max()) == (3, 5)
        assert columns.min() == 16
        assert cells[3:6, 16:].all() == fill
