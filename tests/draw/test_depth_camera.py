"""A synthetic depth camera against rays."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from semmap.draw.depth_camera import DepthCamera, look_at


@pytest.mark.parametrize("seed", range(4))
def test_depths_agree_with_ray_casting(seed: int) -> None:
    """What a pixel shows is what a ray through its centre meets first, walls behind the eye too."""
    rng = np.random.default_rng(seed)
    room = trimesh.creation.box((6, 5, 3))
    meshes = [room]
    for _ in range(6):
        ball = trimesh.creation.icosphere(2, radius=rng.uniform(0.1, 0.5))
        ball.apply_translation(rng.uniform((-2.5, -2, -1), (2.5, 2, 1)))
        meshes.append(ball)
    mesh = trimesh.util.concatenate(meshes)
    eye = rng.uniform((-2.5, -2, -0.5), (2.5, 2, 0.5))
    camera = DepthCamera((80, 60), (60, 62, 39.5, 29.5), look_at(eye, rng.uniform(-1, 1, 3)))
    depth, face = camera.image(np.asarray(mesh.triangles))  # type: ignore[attr-defined]
    column, row = np.meshgrid(np.arange(80), np.arange(60))
    rays = np.stack([(column - 39.5) / 60, (row - 29.5) / 62, np.ones((60, 80))], -1)
    rays = rays.reshape(-1, 3) @ camera.pose[:3, :3].T
    at, ray, of = mesh.ray.intersects_location(np.tile(eye, (4800, 1)), rays, multiple_hits=True)  # type: ignore[attr-defined]
    ahead = (at - eye) @ camera.pose[:3, 2]
    far = np.full(4800, np.nan)
    first = np.full(4800, -1)
    for k in np.argsort(-ahead):
        if ahead[k] > camera.nearest:
            far[ray[k]], first[ray[k]] = ahead[k], of[k]
    off = np.abs(depth.ravel() - far)
    # Rays along an edge may fall to either side of it.
    assert (off > 1e-4).mean() < 0.005
    assert (face.ravel() != first).mean() < 0.01
    assert np.isfinite(depth).all()


def test_the_picture_is_upright() -> None:
    pose = look_at((0, 0, 1), (1, 0, 1))
    np.testing.assert_allclose(pose[:3, 0], (0, -1, 0), atol=1e-12)  # x is right of ahead
    np.testing.assert_allclose(pose[:3, 1], (0, 0, -1), atol=1e-12)  # y is down
    np.testing.assert_allclose(pose[:3, 2], (1, 0, 0), atol=1e-12)
    assert np.linalg.det(look_at((0, 0, 2), (0, 0, 0))[:3, :3]) == pytest.approx(1)


def test_a_camera_without_triangles_sees_none() -> None:
    camera = DepthCamera((8, 6), (5, 5, 3.5, 2.5), np.eye(4))
    behind = np.array([[[0, 0, -1], [1, 0, -1], [0, 1, -1.0]]])
    for triangles in (behind, np.zeros((0, 3, 3))):
        depth, face = camera.image(triangles)
        assert np.isnan(depth).all()
        assert (face == -1).all()
