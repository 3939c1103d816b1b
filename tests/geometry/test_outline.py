"""Hulls and outlines against trimesh and brute force."""

from __future__ import annotations

import time

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from semmap.geometry.ground_outline import silhouette
from semmap.geometry.mesh import Mesh, box_mesh, prism_mesh
from semmap.geometry.outline import hull_points, placed_outline
from semmap.geometry.pose import Pose

metres = st.floats(-5, 5)
points = st.lists(st.tuples(metres, metres, metres), min_size=3, max_size=40)


@settings(max_examples=60)
@given(points, st.tuples(metres, metres, metres))
def test_the_hull_reaches_as_far_as_the_mesh_in_every_direction(
    corners: list[tuple[float, float, float]], turn: tuple[float, float, float]
) -> None:
    vertices = np.array(corners)
    faces = np.column_stack([np.arange(len(vertices))] * 3)
    mesh = Mesh(vertices, faces.astype(np.int32))
    direction = Pose.from_rpy(0, 0, 0, *turn).rotation_matrix
    np.testing.assert_allclose(
        (hull_points(mesh) @ direction.T).max(axis=0),
        (vertices @ direction.T).max(axis=0),
        atol=1e-6,
    )


@pytest.mark.parametrize("flat", [(1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 0, 0)])
def test_flat_meshes_have_a_hull_too(flat: tuple[int, int, int]) -> None:
    vertices = np.random.default_rng(3).uniform(-1, 1, (30, 3)) * flat
    mesh = Mesh(vertices, np.arange(30, dtype=np.int32).reshape(-1, 3))
    hull = hull_points(mesh)
    np.testing.assert_allclose(hull.min(axis=0), vertices.min(axis=0), atol=1e-9)
    np.testing.assert_allclose(hull.max(axis=0), vertices.max(axis=0), atol=1e-9)


def scattered(*scale: float, count: int = 99) -> NDArray[np.float64]:
    """Points in a box of the given sizes."""
    return np.random.default_rng(4).uniform(-0.5, 0.5, (count, 3)) * scale


DEGENERATE = {
    "below denormal squares": scattered(1e-310, 1e-310, 1e-310),
    "nanometres": scattered(1e-9, 1e-9, 1e-9),
    "beyond the range of squares": scattered(1e300, 1e300, 1e300),
    "from end to end of doubles": scattered(1.7e308, 1.7e308, 1.7e308),
    "a film": scattered(1.0, 1.0, 1e-12),
    "a thread": scattered(1.0, 1e-12, 1e-12),
    "a small shape far away": scattered(1e-3, 1e-3, 1e-3) + 1e4,
    "one place": np.full((9000, 3), 3.0),
    "the origin": np.zeros((12, 3)),
    "a line": np.linspace(0, 1, 9000)[:, None] * (1, 2, 3),
}


@pytest.mark.parametrize("shape", DEGENERATE)
def test_shapes_that_qhull_refuses_have_a_hull(shape: str) -> None:
    vertices = DEGENERATE[shape]
    mesh = Mesh(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    directions = np.random.default_rng(5).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    reach, wanted = hull_points(mesh) @ directions.T, vertices @ directions.T
    np.testing.assert_allclose(
        reach.max(axis=0), wanted.max(axis=0), atol=1e-9 * np.abs(vertices).max()
    )


def test_a_round_room_of_20_000_corners_takes_no_minutes() -> None:
    turn = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    room = prism_mesh(shapely.Polygon(10 * np.column_stack([np.cos(turn), np.sin(turn)])), 0, 2.5)
    start = time.process_time()
    hull = hull_points(room)
    assert time.process_time() - start < 10, "it took 240 s"
    assert len(np.unique(hull, axis=0)) == 40_000
    assert np.linalg.norm(hull[:, :2], axis=1).min() == pytest.approx(10)


def test_many_points_on_flat_faces_are_no_corners() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 21)] * 3), axis=-1).reshape(-1, 3)
    mesh = Mesh(grid, np.arange(len(grid), dtype=np.int32).reshape(-1, 3))
    np.testing.assert_allclose(
        np.unique(hull_points(mesh), axis=0),
        [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
    )


def test_vertices_that_are_not_finite_are_refused() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]])
    with pytest.raises(ValueError, match="not finite"):
        hull_points(Mesh(vertices, np.array([[0, 1, 2]], np.int32)))


def test_unused_vertices_do_not_count() -> None:
    box = box_mesh((0, 0, 0), (1, 1, 1))
    mesh = Mesh(np.vstack([box.vertices, [[99, 99, 99]]]), box.faces)
    assert hull_points(mesh).max() == 1


def test_a_silhouette_is_the_union_of_its_triangles() -> None:
    mesh = box_mesh((0, 0, 0), (2, 1, 1)).moved(Pose.planar(3, 4, np.pi / 6))
    assert silhouette(mesh).area == pytest.approx(2)
    two = shapely.union(silhouette(mesh), silhouette(mesh.moved(Pose(x=10))))
    assert two.area == pytest.approx(4)


def test_a_placed_outline_is_moved_and_turned() -> None:
    pose = Pose.planar(3.0, -1.0, 0.7, z=5.0)
    area = shapely.Polygon(
        [(0, 0), (2, 0), (2, 1), (0, 1)], [[(0.5, 0.2), (1, 0.2), (1, 0.5), (0.5, 0.5)]]
    )
    turned = shapely.affinity.rotate(area, 0.7, origin=(0, 0), use_radians=True)
    wanted = shapely.affinity.translate(turned, 3.0, -1.0)
    assert placed_outline(area, pose).symmetric_difference(wanted).area < 1e-12
    back = placed_outline(placed_outline(area, pose), pose.inverse())
    assert back.symmetric_difference(area).area < 1e-12
