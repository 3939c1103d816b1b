"""Shapes of clouds that see one side of them, beside the solids of trimesh that were looked at."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from semmap.perception.fitted_shapes import SHAPES
from semmap.perception.plane import Plane
from semmap.perception.point_cloud import PerceptionError
from semmap.perception.primitives import Primitive, fit_primitive
from tests.perception.views import cloud_of, solid

QUICK = (Phase.explicit, Phase.reuse, Phase.generate)
"""To shrink a failing view takes minutes and makes it no plainer."""

RANGES = {
    "sphere": [(0.03, 0.15)],
    "cylinder": [(0.025, 0.1), (0.06, 0.3)],
    "cone": [(0.04, 0.12), (0.08, 0.25)],
    "cuboid": [(0.04, 0.25)] * 3,
}
SIZES = {
    kind: st.tuples(*(st.floats(*between) for between in ranges)) for kind, ranges in RANGES.items()
}


def turned(yaw: float, at: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    pose = trimesh.transformations.rotation_matrix(yaw, (0, 0, 1))
    pose[:3, 3] = at
    return pose


def from_above(mesh: trimesh.Trimesh, yaw: float, pitch: float, away: float = 1.0) -> np.ndarray:
    ahead = (np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch))
    return mesh.bounds.mean(axis=0) + away * np.array(ahead)


def errors(found: Primitive, size: tuple[float, ...], pose: np.ndarray) -> np.ndarray:
    """How far each size is off; the axes of a cuboid are those that they are nearest to."""
    if found.kind != "cuboid":
        return np.abs(np.subtract(found.size, size))
    own = np.abs(found.pose[:3, :3].T @ pose[:3, :3]).argmax(axis=1)
    assert sorted(own) == [0, 1, 2]
    return np.abs(np.subtract(found.size, np.array(size)[own]))


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("seed", range(12))  # three of 600 other views of cuboids are farther off
def test_a_half_view_on_a_table_gives_the_sizes(kind: str, seed: int):
    random = np.random.default_rng(seed)
    size = tuple(random.uniform(*between) for between in RANGES[kind])
    turn = random.uniform(0, 6.28)
    pose = turned(turn, (0.4, -0.7, 0.8))
    mesh = solid(kind, size, pose)
    # two sides are seen: rows of pixels that are parallel to an edge are all on it or all off it
    yaw, pitch = turn + random.uniform(0.2, 1.3), random.uniform(0.35, 1.0)
    eye = from_above(mesh, yaw, pitch)
    cloud = cloud_of(mesh, eye, points=8000, outliers=0.05, seed=seed)
    found = fit_primitive(cloud, table=Plane(np.array([0.0, 0, 1]), float(mesh.bounds[0, 2])))
    assert found.kind == kind
    off, deviation = errors(found, size, pose), np.array(found.deviation)
    assert off.max() < 0.002
    assert deviation.max() < 0.003
    assert found.inliers > 0.9
    # the pose puts the solid of that size where the mesh is, except for turns about an axis
    same = solid(found.kind, found.size, found.pose)
    assert same.bounds.mean(axis=0) == pytest.approx(mesh.bounds.mean(axis=0), abs=0.004)
    assert np.abs(found.distance(mesh.vertices)).max() < 0.005


@given(data=st.data())
@settings(max_examples=20, phases=QUICK)
def test_in_any_pose_without_a_table_what_is_not_infinite_is_right(data):
    kind = data.draw(st.sampled_from(["sphere", "cylinder", "cuboid"]))
    size = data.draw(SIZES[kind])
    pose = trimesh.transformations.random_rotation_matrix(
        np.array([data.draw(st.floats(0, 1)) for _ in range(3)])
    )
    mesh = solid(kind, size, pose)
    eye = from_above(mesh, data.draw(st.floats(0, 6.28)), data.draw(st.floats(-1.5, 1.5)))
    found = fit_primitive(cloud_of(mesh, eye, outliers=0.02))
    shown = np.sort(np.abs((eye - mesh.bounds.mean(axis=0)) @ pose[:3, :3]))
    if kind == "cuboid" and shown[1] < 0.3:  # one face: a square or a disk may be the end of either
        return
    if kind == "cylinder" and abs(pose[:3, 2] @ (eye - mesh.bounds.mean(axis=0))) > 0.9:
        return
    assert found.kind == kind
    known = np.isfinite(found.deviation)
    assert errors(found, size, pose)[known].max(initial=0) < 0.004


@pytest.mark.parametrize(
    ("kind", "size"), [("cuboid", (0.2, 0.12, 0.1)), ("cylinder", (0.06, 0.2))]
)
def test_a_view_of_one_end_leaves_the_depth_open_unless_a_table_ends_it(kind, size):
    mesh = solid(kind, size)
    cloud = cloud_of(mesh, (0.001, 0, 1.5))
    found = fit_primitive(cloud)
    assert found.kind == kind
    assert found.deviation[-1] == np.inf
    assert found.size[-1] < 0.02  # not more than what was seen
    assert abs(found.size[0] - size[0]) < 3 * found.deviation[0] < 0.006
    table = Plane(np.array([0.0, 0, 1]), -size[-1] / 2)
    stands = fit_primitive(cloud, table=table)
    assert stands.kind == kind
    assert (np.abs(np.subtract(stands.size, size)) < 3 * np.array(stands.deviation)).all()
    assert max(stands.deviation) < 0.002


def test_deviations_are_of_the_size_of_the_errors():
    pose = turned(0.3)
    off = []
    for seed in range(20):
        mesh = solid("cylinder", (0.05, 0.2), pose)
        cloud = cloud_of(mesh, from_above(mesh, seed, 0.5), seed=seed, points=1500, noise=0.002)
        found = fit_primitive(cloud)
        off.append((found.size[0] - 0.05) / found.deviation[0])
    assert 0.3 < np.std(off) < 3


def test_given_normals_of_any_sign_are_used():
    mesh = solid("cone", (0.08, 0.2))
    points, faces = trimesh.sample.sample_surface(mesh, 2000, seed=1)
    sign = np.random.default_rng(0).choice([-1, 1], (len(points), 1))
    found = fit_primitive(points, sign * mesh.face_normals[faces])
    assert found.kind == "cone"
    assert found.size == pytest.approx((0.08, 0.2), abs=0.001)
    assert found.inliers > 0.99


def test_far_from_the_origin_the_fit_is_the_same():
    cloud = cloud_of(solid("cylinder", (0.05, 0.2)), (0.8, 0.1, 0.5))
    near, far = fit_primitive(cloud), fit_primitive(cloud + 5000)
    assert far.size == pytest.approx(near.size, abs=1e-6)
    assert far.pose[:3, 3] - 5000 == pytest.approx(near.pose[:3, 3], abs=1e-6)


def test_the_kind_can_be_given():
    cloud = cloud_of(solid("cylinder", (0.05, 0.2)), (0.8, 0.1, 0.5))
    assert fit_primitive(cloud, kinds=("cuboid",)).kind == "cuboid"


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.full((500, 3), np.nan), {}, "0 finite points of 500"),
        (np.zeros((20, 3)), {}, "30 are needed"),
        (np.zeros((500, 2)), {}, r"shape \(500, 2\)"),
        ([["a"]], {}, "not an array of numbers"),
        (np.zeros((500, 3)), {"normals": np.zeros((400, 3))}, "normals"),
        (np.zeros((500, 3)), {"kinds": ("torus",)}, "torus"),
        (np.zeros((500, 3)), {"tolerance": 0.0}, "tolerance"),
        (np.zeros((500, 3)), {}, "at one place"),
        (np.linspace(0, 1, 500)[:, None] * (1, 2, 3), {}, "on a line"),
    ],
)
def test_what_cannot_be_fitted_is_refused(points, options, message):
    with pytest.raises(PerceptionError, match=message):
        fit_primitive(points, **options)
