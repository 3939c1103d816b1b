"""Voxels drawn: their faces make closed surfaces, their colours are seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from semmap.draw.fields import FieldView, fields_picture, voxel_faces
from semmap.geometry.mesh import box_mesh


@settings(max_examples=30)
@given(
    st.sets(st.tuples(*(st.integers(-3, 3),) * 3), min_size=1, max_size=30),
    st.sampled_from([1, 0.05]),
)
def test_faces_enclose_the_voxels(voxels: set[tuple[int, ...]], size: float) -> None:
    """As many faces as sides that no neighbour covers, and around the volume of all voxels."""
    faces = voxel_faces(np.array(sorted(voxels), np.int32), size)
    open_sides = sum(
        tuple(np.add(v, step)) not in voxels
        for v in voxels
        for step in [*np.eye(3, dtype=int).tolist(), *(-np.eye(3, dtype=int)).tolist()]
    )
    assert len(faces) == 2 * open_sides
    areas = np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1)
    np.testing.assert_allclose(areas, size**2, atol=1e-12)
    points = np.unique(np.round(faces.reshape(-1, 3) / size).astype(int), axis=0)
    corners = {tuple(np.add(v, c)) for v in voxels for c in np.ndindex(2, 2, 2)}
    assert {tuple(p) for p in points} <= corners
    ball = trimesh.Trimesh(*trimesh.triangles.to_kwargs(faces).values())
    assert ball.bounds[1].max() <= 4 * size + 1e-9


def test_the_picture_has_the_colours_of_the_fields(tmp_path: Path) -> None:
    table = box_mesh((-1, -1, 0), (1, 1, 0.1)).triangles
    cubes = np.argwhere(np.ones((4, 4, 4), bool)).astype(np.int32) + np.array([0, 0, 2], np.int32)
    air = cubes + np.array([-12, 0, 0], np.int32)
    path = fields_picture(
        table,
        np.full((len(table), 3), 0.9),
        [FieldView(cubes, 0.05, "#d00000", "cubes"), FieldView(air, 0.05, "#0000d0", "air", 0.3)],
        tmp_path / "f" / "picture.png",
        title="Fields",
        width=400,
    )
    pixels = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3).astype(int)
    red = (pixels[:, 0] > 120) & (pixels[:, 1] < 60) & (pixels[:, 2] < 60)
    blue = (pixels[:, 2] - pixels[:, 0] > 25) & (pixels[:, 0] > 60)
    assert red.sum() > 200
    assert blue.sum() > 200
