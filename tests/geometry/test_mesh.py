"""Meshes against trimesh: volume, bounds, orientation."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.mesh import Mesh, box_mesh, join, prism_mesh
from semmap.geometry.pose import Pose

metres = st.floats(-5, 5)


def solid(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)


def test_a_box_is_closed_and_faces_outward() -> None:
    box = solid(box_mesh((0, 0, 0), (1, 2, 3)))
    assert box.is_watertight
    assert box.volume == pytest.approx(6)


@settings(max_examples=30)
@given(
    pose=st.builds(Pose.from_rpy, metres, metres, metres, metres, metres, metres),
    scale=st.tuples(*[st.sampled_from([-2.0, -1.0, 0.5, 1.0, 3.0])] * 3),
)
def test_moved_and_mirrored_meshes_still_face_outward(
    pose: Pose, scale: tuple[float, float, float]
) -> None:
    moved = solid(box_mesh((0, 0, 0), (1, 2, 3)).moved(pose, scale))
    assert moved.volume == pytest.approx(6 * abs(np.prod(scale)))


def test_a_prism_with_a_hole_has_the_volume_of_its_outline() -> None:
    outline = shapely.box(0, 0, 4, 3).difference(shapely.box(1, 1, 2, 2))
    prism = solid(prism_mesh(outline, 0.5, 2.5))
    assert prism.is_watertight
    assert prism.volume == pytest.approx(outline.area * 2)
    assert prism.bounds[:, 2].tolist() == [0.5, 2.5]


def test_joined_meshes_keep_their_triangles() -> None:
    a, b = box_mesh((0, 0, 0), (1, 1, 1)), box_mesh((5, 5, 5), (6, 6, 6))
    both = join([a, b])
    np.testing.assert_array_equal(both.triangles, np.concatenate([a.triangles, b.triangles]))


def test_equal_meshes_have_equal_digests() -> None:
    a = box_mesh((0, 0, 0), (1, 1, 1))
    assert a.digest() == Mesh(a.vertices.copy(), a.faces.astype(np.int64)).digest()  # type: ignore[arg-type]
    assert a.digest() != a.moved(Pose(x=1e-9)).digest()
    assert a.digest() != Mesh(a.vertices, a.faces[::-1]).digest()


@pytest.mark.parametrize("subdivisions", [0, 2, 4])
def test_a_surface_is_closed_where_trimesh_finds_it_watertight(subdivisions: int) -> None:
    rng = np.random.default_rng(subdivisions)
    for made in (
        trimesh.creation.icosphere(subdivisions=subdivisions),
        trimesh.creation.annulus(0.2, 0.5, 0.3, sections=3 + 8 * subdivisions),
        trimesh.creation.torus(1, 0.2, major_sections=5 + subdivisions),
    ):
        for faces in (made.faces, made.faces[1:], rng.permutation(made.faces)[:-2]):
            part = trimesh.Trimesh(made.vertices, faces, process=False)
            soup = part.triangles.reshape(-1, 3)
            whole = Mesh(np.asarray(made.vertices, float), np.asarray(faces, np.int32))
            loose = Mesh(soup, np.arange(len(soup), dtype=np.int32).reshape(-1, 3))
            assert whole.is_closed == loose.is_closed == part.is_watertight
    flat = Mesh(np.eye(3), np.array([[0, 1, 2], [0, 2, 1], [0, 0, 1]], np.int32))
    assert flat.is_closed
    assert not Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32)).is_closed
