"""Hulls and outlines against trimesh and brute force."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.mesh import Mesh, box_mesh
from semmap.geometry.outline import hull_points, outline, silhouette
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
    direction = Pose.from_rpy(0, 0, 0, *turn).rotation
    np.testing.assert_allclose(
        (hull_points(mesh) @ direction.T).max(axis=0), (vertices @ direction.T).max(axis=0),
        atol=1e-6,
    )  # fmt: skip


@pytest.mark.parametrize("flat", [(1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 0, 0)])
def test_flat_meshes_have_a_hull_too(flat: tuple[int, int, int]) -> None:
    vertices = np.random.default_rng(3).uniform(-1, 1, (30, 3)) * flat
    mesh = Mesh(vertices, np.arange(30, dtype=np.int32).reshape(-1, 3))
    hull = hull_points(mesh)
    np.testing.assert_allclose(hull.min(axis=0), vertices.min(axis=0), atol=1e-9)
    np.testing.assert_allclose(hull.max(axis=0), vertices.max(axis=0), atol=1e-9)


def test_unused_vertices_do_not_count() -> None:
    box = box_mesh((0, 0, 0), (1, 1, 1))
    mesh = Mesh(np.vstack([box.vertices, [[99, 99, 99]]]), box.faces)
    assert hull_points(mesh).max() == 1


def test_outline_and_silhouette() -> None:
    mesh = box_mesh((0, 0, 0), (2, 1, 1)).moved(Pose.planar(3, 4, np.pi / 6))
    assert outline(mesh).area == pytest.approx(2)
    assert silhouette(mesh).area == pytest.approx(2)
    two = shapely.union(silhouette(mesh), silhouette(mesh.moved(Pose(x=10))))
    assert two.area == pytest.approx(4)
