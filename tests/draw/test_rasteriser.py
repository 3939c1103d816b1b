import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from semmap.draw.rasteriser import Camera, nearest_triangles
from semmap.geometry.mesh import box_mesh

ABOVE = Camera(
    right=np.array([1.0, 0, 0]),
    up=np.array([0, 1.0, 0]),
    back=np.array([0, 0, 1.0]),
    centre=np.array([0.0, 0.0]),
    scale=1.0,
    size=(16, 12),
)


def seen_by_ray(camera, triangles, cut):
    """Triangle and depth at each pixel centre: one ray a pixel against every triangle."""
    width, height = camera.size
    faces, depths = np.full((height, width), -1), np.full((height, width), -math.inf)
    corners = camera.project(triangles)
    for row in range(height):
        for column in range(width):
            p = np.array([column + 0.5, row + 0.5])
            for f, (a, b, c) in enumerate(corners):
                m = np.array([b[:2] - a[:2], c[:2] - a[:2]]).T
                if abs(np.linalg.det(m)) < 1e-9:
                    continue
                u, v = np.linalg.solve(m, p - a[:2])
                if min(u, v, 1 - u - v) < 0:
                    continue
                depth = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
                corner = triangles[f]
                z = (
                    corner[0, 2]
                    + u * (corner[1, 2] - corner[0, 2])
                    + v * (corner[2, 2] - corner[0, 2])
                )
                if z <= cut[f] and depth > depths[row, column]:
                    faces[row, column], depths[row, column] = f, depth
    return faces, depths


# odd multiples of 0.013 keep corners and edges off the centres of pixels
offset = st.integers(-400, 400).map(lambda i: 0.013 * (2 * i + 1))


@settings(max_examples=20, deadline=None)
@given(
    hnp.arrays(float, st.tuples(st.integers(1, 6), st.just(3), st.just(3)), elements=offset),
    st.floats(0.1, 1.4),
    st.floats(-3, 3),
)
def test_each_pixel_shows_the_triangle_that_a_ray_meets_first(triangles, elevation, azimuth):
    points = triangles.reshape(-1, 3)
    look = Camera.look(azimuth, elevation, points, 24)
    size = (24, min(look.size[1], 24))
    camera = Camera(look.right, look.up, look.back, look.centre, 1.3, size)
    cut = np.where(np.arange(len(triangles)) % 2, 1.0, np.inf)
    faces, depths = nearest_triangles(camera, triangles, cut)
    expected, expected_depths = seen_by_ray(camera, triangles, cut)
    differs = faces != expected
    # beside the rounding of an edge or of two triangles that cross, all pixels agree
    near = np.isclose(depths, expected_depths, atol=1e-5)
    assert (differs & ~near).mean() <= 0.01
    both = (faces == expected) & (faces >= 0)
    np.testing.assert_allclose(depths[both], expected_depths[both], atol=1e-5)


def test_from_above_a_box_hides_triangles_below_it():
    low, high = box_mesh((-4, -3, 0), (4, 3, 1)), box_mesh((-1, -1, 1), (1, 1, 2))
    faces, depths = nearest_triangles(ABOVE, np.concatenate([low.triangles, high.triangles]))
    assert (faces >= 12).sum() == 4  # 2 x 2 m at a pixel a metre
    assert (faces >= 0).sum() == 48
    assert set(np.unique(depths[faces >= 0]).round(6)) == {1.0, 2.0}


def test_a_cut_shows_the_triangles_behind():
    box = box_mesh((-4, -3, 0), (4, 3, 1)).triangles
    _, depths = nearest_triangles(ABOVE, box, np.full(12, 0.5))
    np.testing.assert_allclose(depths[np.isfinite(depths)], 0.0, atol=1e-6)


def test_no_triangles_give_an_empty_picture():
    faces, depths = nearest_triangles(ABOVE, np.zeros((0, 3, 3)))
    assert (faces == -1).all()
    assert np.isneginf(depths).all()
    assert faces.shape == (12, 16)


@given(st.floats(-4, 4), st.floats(0.05, 1.5), st.integers(20, 300))
@settings(max_examples=50, deadline=None)
def test_a_camera_sees_all_points_within_its_margin(azimuth, elevation, width):
    points = np.random.default_rng(3).normal(size=(50, 3)) * [4, 2, 1]
    camera = Camera.look(azimuth, elevation, points, width, margin=0.05)
    at = camera.project(points)
    assert at[:, 0].min() == pytest.approx(0.05 * width)
    assert at[:, 0].max() == pytest.approx(0.95 * width)
    assert at[:, 1].min() >= 0.05 * width - 1
    assert at[:, 1].max() <= camera.size[1] - 0.05 * width + 1


def test_a_window_equals_its_part_of_the_picture():
    box = box_mesh((-4, -3, 0), (4, 3, 1)).triangles
    camera = Camera.look(0.7, 0.6, box.reshape(-1, 3), 40)
    whole, _ = nearest_triangles(camera, box)
    part, _ = nearest_triangles(camera.window(6, 4, 20, 10), box)
    np.testing.assert_array_equal(part, whole[4:14, 6:26])
