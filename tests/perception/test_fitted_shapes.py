"""Native functions of shapes, beside convex hulls, eigenvalues of NumPy and exact solids."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import semmap_native
from semmap.perception.fitted_shapes import SHAPES, Placed, refined, size_of
from semmap.perception.plane import Plane
from semmap.perception.point_cloud import Surfels
from tests.perception.views import solid

SIZES = {
    "sphere": (0.08,),
    "cylinder": (0.05, 0.2),
    "cone": (0.07, 0.18),
    "cuboid": (0.2, 0.12, 0.15),
}
BOUNDS = {
    "sphere": [0.08],
    "cylinder": [0.05, -0.1, 0.1],
    "cone": [0.07 / 0.18, 0, 0.18],
    "cuboid": [-0.1, -0.06, -0.075, 0.1, 0.06, 0.075],
}
"""Of the same solids, in their frames."""


def placed(kind: str, seed: int) -> Placed:
    random = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    return Placed(kind, rotation, random.uniform(-1, 1, 3), np.array(BOUNDS[kind], float))


def pose_of(shape: Placed) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = shape.rotation, shape.origin
    return pose


def surface_points(shape: Placed, count: int, seed: int) -> Surfels:
    """Points exactly on a shape: those of a mesh moved along their normals."""
    mesh = solid(shape.kind, SIZES[shape.kind])

    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    normals = mesh.face_normals[faces]
    if shape.kind == "sphere":
        normals = points / np.linalg.norm(points, axis=1)[:, None]
    elif shape.kind != "cuboid":
        side = np.abs(normals[:, 2]) < 0.9
        around = points[side, :2] / np.linalg.norm(points[side, :2], axis=1)[:, None]
        level = np.sqrt(1 - normals[side, 2] ** 2)[:, None]
        normals[side, :2] = around * level
    own = Placed(shape.kind, np.eye(3), np.zeros(3), shape.bounds)
    for _ in range(5):
        points = points - own.distances(points)[:, None] * normals
    return Surfels(points @ shape.rotation.T + shape.origin, normals @ shape.rotation.T, 0.0, 0.005)


@pytest.mark.parametrize("kind", SHAPES)
def test_distances_are_the_largest_ones_to_the_planes_of_the_hull(kind):
    shape = placed(kind, 3)
    if kind == "sphere":
        mesh = trimesh.creation.icosphere(4, *SIZES[kind])
    elif kind == "cuboid":
        mesh = trimesh.creation.box(SIZES[kind])
    else:
        mesh = getattr(trimesh.creation, kind)(*SIZES[kind], sections=512)
    mesh.apply_transform(pose_of(shape))
    planes = ConvexHull(mesh.vertices).equations
    low, high = mesh.bounds - shape.origin
    probes = np.random.default_rng(0).uniform(1.5 * low, 1.5 * high, (1000, 3)) + shape.origin
    expected = (probes @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    assert (expected < -0.005).sum() > 20
    assert (expected > 0.005).sum() > 20
    assert shape.distances(probes) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("seed", range(5))
def test_exact_points_give_the_exact_shape_back(kind, seed):
    shape = placed(kind, seed)
    cloud = surface_points(shape, 1000, seed)
    random = np.random.default_rng(seed)
    wrong = Placed(
        kind,
        shape.rotation @ Rotation.from_rotvec(random.normal(0, 0.05, 3)).as_matrix(),
        shape.origin + random.normal(0, 0.003, 3),
        shape.bounds + (0.0 if kind == "cone" else random.normal(0, 0.003, len(shape.bounds))),
    )
    if kind == "cone":  # a rough cone has its origin at the tip
        tip = shape.rotation[:, 2] * shape.bounds[2]
        wrong = wrong._replace(
            origin=wrong.origin + tip, bounds=np.array([shape.bounds[0] * 1.05, 0, 0])
        )
    fit = refined(wrong, cloud, cloud.points, 1e-4, None, turns=8)
    assert fit is not None
    assert fit.seen.all()
    assert size_of(kind, fit.placed.bounds) == pytest.approx(SIZES[kind], abs=1e-7)
    assert np.abs(fit.placed.distances(cloud.points)).max() < 1e-7
    assert fit.placed.rotation.T @ fit.placed.rotation == pytest.approx(np.eye(3), abs=1e-12)


def test_points_that_are_far_from_a_shape_fit_none_of_it():
    cloud = surface_points(placed("sphere", 0), 500, 0)
    far = placed("sphere", 0)._replace(origin=np.array([5.0, 5, 5]))
    assert refined(far, cloud, cloud.points, 1e-3, None) is None


def test_a_table_ends_a_side_and_nothing_else_does():
    """A cylinder whose lower half is hidden stands on a table that is 0.3 m below its middle."""
    shape = Placed("cylinder", np.eye(3), np.zeros(3), np.array(BOUNDS["cylinder"]))
    cloud = surface_points(shape, 2000, 1)
    upper = cloud.points[:, 2] > 0
    cloud = Surfels(cloud.points[upper], cloud.normals[upper], 0.0, 0.004)
    stands = refined(shape, cloud, cloud.points, 1e-3, Plane(np.array([0.0, 0, 1]), -0.3))
    hangs = refined(shape, cloud, cloud.points, 1e-3, None)
    leans = refined(shape, cloud, cloud.points, 1e-3, Plane(np.array([0.0, 0.6, 0.8]), -0.3))
    assert stands is not None
    assert hangs is not None
    assert leans is not None
    assert stands.placed.bounds[1] == pytest.approx(-0.3, abs=1e-9)
    assert stands.deviation[1] < 0.002
    assert hangs.placed.bounds[1] == pytest.approx(0, abs=0.004)
    assert leans.placed.bounds[1] == hangs.placed.bounds[1]


def test_a_cuboid_pays_for_the_part_of_its_face_that_no_points_fill():
    random = np.random.default_rng(0)
    flat = random.uniform(-0.1, 0.1, (4000, 2))
    points = np.column_stack([flat, np.zeros(len(flat))])
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    shape = Placed("cuboid", np.eye(3), np.zeros(3), np.array([-0.1, -0.1, -0.1, 0.1, 0.1, 0.0]))
    disk = np.linalg.norm(flat, axis=1) < 0.1

    def cost(chosen: np.ndarray) -> float:
        return semmap_native.shape_cost(*shape, points[chosen], normals[chosen], 0.001)

    near_edge = np.abs(flat).max(axis=1) > 0.099
    full, part = cost(~near_edge), cost(disk & ~near_edge)
    hull = ConvexHull(flat[disk & ~near_edge])
    assert full < 0.01
    assert part == pytest.approx(0.9 - hull.volume / 0.04, abs=1e-9)


@given(seed=st.integers(0, 10_000), flat=st.booleans(), width=st.sampled_from([1e-4, 0.1, 100.0]))
def test_local_planes_are_those_of_the_covariance(seed, flat, width):
    random = np.random.default_rng(seed)
    points = random.normal(0, width, (40, 3)) @ np.diag([1, 0.5, 0.0 if flat else 0.1])
    points = points @ Rotation.random(random_state=seed).as_matrix().T
    near = random.integers(0, len(points), (12, 9))
    normals, variances = semmap_native.local_planes(points, near)
    for row, normal, variance in zip(near, normals, variances, strict=True):
        covariance = np.cov(points[row].T, bias=True)
        least = np.linalg.eigvalsh(covariance)[0]
        assert variance == pytest.approx(least, abs=1e-12 * width**2)
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert normal @ covariance @ normal == pytest.approx(least, abs=1e-12 * width**2)
