"""Table planes and clusters, beside a brute-force search of chains and the scene as it was made."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.geometry.mesh import box_mesh, join
from semmap.perception.models import depth_points
from semmap.perception.plane import find_plane
from semmap.perception.point_cloud import PerceptionError, voxel_downsample
from semmap.perception.primitives import fit_primitive
from semmap.perception.tabletop import euclidean_clusters, segment_tabletop
from tests.perception.views import solid

BOXES = [((-0.2, -0.1), 0.1), ((0.1, 0.05), 0.06), ((0.02, -0.2), 0.15)]
"""Corners and heights of boxes of 8 cm on a table at z = 0.7."""


@pytest.fixture(scope="module")
def scene() -> tuple[np.ndarray, DepthCamera]:
    """An organised cloud of a table, three boxes and the floor, in the frame of the camera."""
    parts = [box_mesh((-2, -2, -0.1), (2, 2, 0)), box_mesh((-0.5, -0.4, 0.66), (0.5, 0.4, 0.7))]
    parts += [box_mesh((x, y, 0.7), (x + 0.08, y + 0.08, 0.7 + h)) for (x, y), h in BOXES]
    camera = DepthCamera(
        (320, 240), (300.0, 300.0, 159.5, 119.5), look_at((1.0, 0.1, 1.5), (0, 0, 0.7))
    )
    depths, _ = camera.image(join(parts).triangles)
    return depth_points(
        camera, depths + np.random.default_rng(1).normal(0, 0.001, depths.shape)
    ), camera


def test_a_table_and_what_stands_on_it(scene):
    cloud, camera = scene
    up = camera.pose[:3, :3].T @ (0, 0, 1)
    found = segment_tabletop(cloud, up=up)
    assert found.plane.normal == pytest.approx(up, abs=0.01)
    assert found.plane.height(camera.pose[:3, :3].T @ ((0, 0, 0.7) - camera.pose[:3, 3])) == (
        pytest.approx(0, abs=0.002)
    )
    assert len(found.clusters) == 3
    for cluster in found.clusters:
        points = cluster @ camera.pose[:3, :3].T + camera.pose[:3, 3]
        own = [
            (np.abs(points[:, 0] - x - 0.04) < 0.045).all()
            and (np.abs(points[:, 1] - y - 0.04) < 0.045).all()
            and points[:, 2].max() == pytest.approx(0.7 + h, abs=0.005)
            for (x, y), h in BOXES
        ]
        assert sum(own) == 1


def test_pixels_without_depth_change_nothing_but_their_points(scene):
    cloud, camera = scene
    up = camera.pose[:3, :3].T @ (0, 0, 1)
    holes = cloud.copy()
    holes[np.random.default_rng(0).random(cloud.shape[:2]) < 0.2] = np.nan
    assert len(segment_tabletop(holes, up=up).clusters) == 3


STANDING = [
    ("cylinder", (0.035, 0.11), (-0.15, -0.12), 0.055),
    ("sphere", (0.05,), (0.1, 0.12), 0.05),
    ("cuboid", (0.06, 0.07, 0.12), (0.08, -0.16), 0.06),
    ("cone", (0.05, 0.12), (-0.16, 0.14), 0.0),
]
"""Kind, size, place on the table, and height of the origin above it, metres."""


@pytest.mark.parametrize("seed", range(3))
def test_one_cloud_gives_the_primitives_of_all_that_stands_on_the_table(seed: int):
    """The plane, the clusters, and each cluster's shape: seen from one side, with 1 mm of noise."""
    parts = [box_mesh((-0.5, -0.4, 0.66), (0.5, 0.4, 0.7)).triangles]
    for kind, size, place, middle in STANDING:
        pose = np.eye(4)
        pose[:3, 3] = *place, 0.7 + middle
        parts.append(np.asarray(solid(kind, size, pose).triangles))
    camera = DepthCamera(
        (640, 480), (600.0, 600.0, 319.5, 239.5), look_at((0.9, 0.1, 1.3), (0, 0, 0.72))
    )
    depths, _ = camera.image(np.concatenate(parts))
    noise = np.random.default_rng(seed).normal(0, 0.001, depths.shape)
    up = camera.pose[:3, :3].T @ (0, 0, 1)
    found = segment_tabletop(depth_points(camera, depths + noise), up=up)
    shapes = {
        shape.kind: shape for shape in (fit_primitive(c, table=found.plane) for c in found.clusters)
    }
    assert len(found.clusters) == len(STANDING)
    assert set(shapes) == {kind for kind, *_ in STANDING}
    for kind, size, place, middle in STANDING:
        shape = shapes[kind]
        sizes = sorted(shape.size) if kind == "cuboid" else shape.size
        assert sizes == pytest.approx(size, abs=0.002)
        there = (camera.pose @ shape.pose)[:3, 3]
        assert there == pytest.approx((*place, 0.7 + middle), abs=0.002)
        assert shape.inliers > 0.95
        axis = camera.pose[:3, :3] @ shape.pose[:3, 2]
        if kind in ("cylinder", "cone"):
            assert abs(axis[2]) > 0.999


@given(st.integers(0, 10_000), st.integers(0, 120), st.floats(0.02, 0.3))
@settings(max_examples=50)
def test_clusters_are_the_components_of_near_points(seed: int, count: int, gap: float):
    points = np.random.default_rng(seed).random((count, 3))
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    graph = nx.from_numpy_array(apart <= gap)
    expected = {frozenset(component) for component in nx.connected_components(graph)}
    label = euclidean_clusters(points, gap)
    found = {frozenset(np.flatnonzero(label == number).tolist()) for number in set(label.tolist())}
    assert found == expected


@given(st.integers(0, 10_000), st.floats(0.05, 0.5))
@settings(max_examples=30)
def test_a_voxel_has_the_mean_of_its_points(seed: int, size: float):
    points = np.random.default_rng(seed).normal(size=(60, 3))
    cells: dict[tuple[int, ...], list[np.ndarray]] = {}
    for point in points:
        cells.setdefault(tuple(np.floor(point / size).astype(int)), []).append(point)
    expected = sorted(tuple(np.mean(own, axis=0)) for own in cells.values())
    assert np.array(sorted(map(tuple, voxel_downsample(points, size)))) == pytest.approx(
        np.array(expected)
    )


def test_a_wall_is_not_a_table():
    random = np.random.default_rng(0)
    wall = random.random((3000, 3)) * (1, 0.001, 1)
    with pytest.raises(PerceptionError, match="no level plane"):
        find_plane(wall)
    assert abs(find_plane(wall, up=(0, -2, 0)).normal[1]) > 0.999


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.full((240, 320, 3), np.nan), {}, "0 finite points of 76800, 100 are needed"),
        (np.zeros((0, 3)), {}, "0 finite points of 0"),
        (np.zeros((500, 4)), {}, r"shape \(500, 4\)"),
        (np.zeros((500, 3)), {"up": (0, 0, 0)}, "up is"),
        (np.zeros((500, 3)), {"voxel": 0.0}, "0 < voxel < gap"),
        (np.zeros((500, 3)), {"clearance": 0.6}, "clearance < height"),
        (np.array([[9e5, 9e5, 9e5]] * 200 + [[0, 0, 0]] * 200), {}, "too wide"),
        (np.array([[1e30, 0, 0]] * 200 + [[0, 0, 0]] * 200), {}, "a coordinate of 1e\\+30 m"),
    ],
)
def test_clouds_without_a_table_are_refused(points, options, message):
    with pytest.raises(PerceptionError, match=message):
        segment_tabletop(points, **options)
