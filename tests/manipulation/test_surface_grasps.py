"""Grasps of meshes that no primitive stands for, judged by rays through meshes and by trials."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.mesh import Mesh
from semmap.manipulation.candidates import Grasps, grasp_candidates
from semmap.manipulation.convex_pieces import convex_pieces
from semmap.manipulation.evaluation import mismatch
from semmap.manipulation.extra import library
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.solids import solid_hull, solid_of
from semmap.manipulation.surface_grasps import (
    SampledSurface,
    held_by,
    mesh_grasps,
    surface_grasps,
    surface_of,
)
from semmap.manipulation.trial import Trial, body_of
from semmap.perception.mesh_shapes import mesh_primitive
from tests.manipulation.grippers import JAW, Shape, gripper_by_hand, real_gripper
from tests.manipulation.hollow_things import boxes, cup, mug, plate, turned


def grasps_of(mesh: trimesh.Trimesh, gripper: Gripper, **options: float) -> Grasps:
    surface = surface_of(mesh, solid_hull(np.asarray(mesh.vertices))[1])
    return surface_grasps(surface, gripper, mesh.triangles, **options)


@cache
def grasps_of_mug(name: str) -> Grasps:
    """By a real gripper of a name; each takes seconds."""
    return grasps_of(mug(), real_gripper(name))


def pads_of(gripper: Gripper, grasps: Grasps) -> np.ndarray:
    """(N, 3) the middles between the pads, in the frame of the model."""
    held = gripper.pads_at(grasps.widths)
    return grasps.poses[:, :3, 3] + np.einsum("nij,nj->ni", grasps.poses[:, :3, :3], held)


def ends(mesh: trimesh.Trimesh, gripper: Gripper, grasps: Grasps) -> np.ndarray:
    """(N, 2, 3) where rays from both open pads along the closing axis first meet a mesh."""
    closing, middle = grasps.poses[:, :3, 0], pads_of(gripper, grasps)
    met = []
    for side in (-1, 1):
        starts = middle + side * gripper.opening / 2 * closing
        where, ray, _ = mesh.ray.intersects_location(starts, -side * closing, multiple_hits=False)
        found = np.full((len(grasps), 3), np.nan)
        found[ray] = where
        met.append(found)
    return np.stack(met, axis=1)


def cones(mesh: trimesh.Trimesh, gripper: Gripper, grasps: Grasps) -> np.ndarray:
    """(N, 2) degrees between the closing axis and the normal where each ray meets the mesh."""
    at = ends(mesh, gripper, grasps)
    met = np.isfinite(at).all(axis=2)
    faces = trimesh.proximity.closest_point(mesh, np.nan_to_num(at).reshape(-1, 3))[2]
    normals = mesh.face_normals[faces].reshape(-1, 2, 3)
    facing = np.abs(np.einsum("nsi,ni->ns", normals, grasps.poses[:, :3, 0]))
    return np.where(met, np.degrees(np.arccos(np.clip(facing, 0, 1))), np.nan)


@pytest.mark.parametrize("name", ["panda", "pr2"])
def test_a_mug_is_held_by_its_rim_and_its_handle(name: str) -> None:
    gripper, mesh = real_gripper(name), mug()
    assert not len(grasp_candidates(mesh_primitive(mesh), real_gripper("panda")))
    grasps = grasps_of_mug(name)
    pads = pads_of(gripper, grasps)
    by_rim = (grasps.widths < 0.008) & (np.hypot(pads[:, 0], pads[:, 1]) < 0.05)
    by_handle = (grasps.widths < 0.015) & (pads[:, 0] > 0.06)
    assert by_rim.sum() > 20
    assert by_handle.any()
    assert (np.diff(grasps.qualities) <= 0).all()


def test_a_plate_is_held_by_its_edge() -> None:
    gripper, mesh = real_gripper("panda"), plate()
    grasps = grasps_of(mesh, gripper)
    assert len(grasps) > 20
    assert np.hypot(*grasps.poses[:, :2, 3].T).min() > 0.06
    assert grasps.widths.max() < 0.03


@pytest.mark.parametrize("name", ["panda", "stretch_se3"])
def test_rays_meet_the_surface_within_the_friction_cones_at_the_stated_width(name: str) -> None:
    gripper, mesh = real_gripper(name), mug()
    grasps = grasps_of_mug(name)
    at = ends(mesh, gripper, grasps)
    whole = np.isfinite(at).all(axis=(1, 2))
    assert whole.mean() > 0.7  # the middle of a pad may be beside an edge
    apart = np.linalg.norm(at[whole, 0] - at[whole, 1], axis=1)
    # a pad meets the highest point of a round wall, its middle some lower one
    assert (np.abs(apart - grasps.widths[whole]) < 0.004).mean() > 0.95
    within = cones(mesh, gripper, grasps)[whole].max(axis=1) < np.degrees(np.arctan(0.5)) + 3
    assert within.mean() > 0.95


@given(seed=st.integers(0, 10_000))
@settings(max_examples=8, deadline=None)
def test_grasps_of_unions_of_boxes_leave_the_open_gripper_free(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The open fingers are boxes there: no point on them is inside of the mesh, by trimesh."""
    gripper = by_hand(tmp_path_factory)
    mesh = boxes(np.random.default_rng(seed))
    grasps = grasps_of(mesh, gripper)
    fingers = trimesh.util.concatenate(
        [trimesh.Trimesh(m.vertices, m.faces) for m in gripper.meshes(gripper.opening).values()]
    )
    points = trimesh.sample.sample_surface(fingers, 300, seed=0)[0]
    for pose in grasps.poses[:: max(1, len(grasps) // 10)]:
        assert not mesh.contains(points @ pose[:3, :3].T + pose[:3, 3]).any()
    if len(grasps):
        angles = cones(mesh, gripper, grasps)
        met = np.isfinite(angles).all(axis=1)
        assert (angles[met].max(axis=1) < np.degrees(np.arctan(0.5)) + 1).mean() > 0.9


def by_hand(folders: pytest.TempPathFactory) -> Gripper:
    return gripper_by_hand(folders.mktemp("gripper"))


def test_a_mesh_that_is_its_primitive_has_the_grasps_of_the_primitive() -> None:
    gripper, mesh = real_gripper("pr2"), trimesh.creation.box((0.05, 0.06, 0.15))
    shape = mesh_primitive(mesh)
    expected = grasp_candidates(shape, gripper)
    np.testing.assert_array_equal(mesh_grasps(mesh, shape, gripper).poses, expected.poses)


def test_grasps_of_a_primitive_are_judged_by_what_is_there(tmp_path: Path) -> None:
    """Of a bar bell, whose primitive is the box around it, the bar is as thin as it is."""
    gripper = gripper_by_hand(tmp_path)
    ends_ = [trimesh.creation.box((0.06, 0.06, 0.03)) for _ in range(2)]
    for end, z in zip(ends_, (-0.07, 0.07), strict=True):
        end.apply_translation((0, 0, z))
    bell = trimesh.creation.box((0.016, 0.016, 0.16)).union(ends_)
    surface = surface_of(bell, np.zeros(3))
    shape = mesh_primitive(trimesh.creation.box((0.06, 0.06, 0.17)))
    judged = held_by(surface, grasp_candidates(shape, gripper))
    middle = np.abs(judged.poses[:, 2, 3]) < 0.03
    assert middle.any()
    np.testing.assert_allclose(judged.widths[middle], 0.016, atol=1e-3)
    far = SampledSurface(np.full((1, 3), 9.0), np.eye(3)[:1], np.zeros(3))
    assert not len(held_by(far, judged))


def test_what_is_too_wide_or_a_thin_shell_is_no_error() -> None:
    assert not len(grasps_of(trimesh.creation.icosphere(radius=0.2), real_gripper("panda")))
    sheet = trimesh.creation.box((0.3, 0.3, 0.0004))
    assert not len(grasps_of(sheet, real_gripper("panda")))


def test_a_gripper_that_its_arm_cannot_tilt_keeps_its_slant() -> None:
    gripper = real_gripper("stretch_arm")
    lying = turned(cup(), np.pi / 2, (0, 1, 0))
    for mesh, frame in ((cup(), np.eye(4)), (lying, np.eye(4)), (cup(), np.eye(4)[[1, 2, 0, 3]])):
        surface = surface_of(mesh, np.asarray(mesh.center_mass))
        grasps = surface_grasps(surface, gripper, mesh.triangles, frame=frame)
        upside_down = np.diag([1.0, -1, -1, 1])
        stands = [gripper.can_tilt_to(pose) for pose in grasps.poses]
        turned_over = [gripper.can_tilt_to(upside_down @ pose) for pose in grasps.poses]
        assert sum(stands) > 10
        assert all(np.logical_or(stands, turned_over))


def test_one_jaw_holds_a_cup_by_its_rim(tmp_path: Path) -> None:
    """The jaw that does not move is beside the wall, and rays across the jaws meet it."""
    path = tmp_path / "jaw.urdf"
    path.write_text(JAW)
    gripper, mesh = read_gripper(path), cup()
    grasps = grasps_of(mesh, gripper)
    assert len(grasps)
    at = ends(mesh, gripper, grasps)
    whole = np.isfinite(at).all(axis=(1, 2))
    apart = np.linalg.norm(at[whole, 0] - at[whole, 1], axis=1)
    assert (np.abs(apart - grasps.widths[whole]) < 0.004).mean() > 0.9


def test_half_a_turn_of_a_symmetric_gripper_is_no_other_grasp() -> None:
    grasps = grasps_of_mug("panda")
    closing, approach = grasps.poses[:, :3, 0], grasps.poses[:, :3, 2]
    same = (
        (np.abs(grasps.poses[:, None, :3, 3] - grasps.poses[None, :, :3, 3]).max(axis=2) < 1e-3)
        & (np.abs(closing[:, None] + closing[None]).max(axis=2) < 0.02)
        & (np.abs(approach[:, None] - approach[None]).max(axis=2) < 0.02)
    )
    assert not same.any()


# --- pieces and trials


def test_pieces_of_a_cup_leave_it_hollow() -> None:
    mesh = cup()
    pieces = convex_pieces(Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)))
    assert len(pieces) > 5
    hulls = [trimesh.Trimesh(piece.vertices, piece.faces) for piece in pieces]
    inside = np.array([(0, 0, 0.05), (0.02, 0.01, 0.08), (-0.02, 0, 0.03)])
    wall = np.array([(0.043, 0, 0.05), (0, -0.043, 0.08), (0, 0, 0.002)])
    assert not any(hull.contains(inside).any() for hull in hulls)
    assert np.any([hull.contains(wall) for hull in hulls], axis=0).all()
    assert sum(hull.volume for hull in hulls) == pytest.approx(mesh.volume, rel=0.2)
    ball = trimesh.creation.icosphere(radius=0.05)
    assert len(convex_pieces(Mesh(np.asarray(ball.vertices), np.asarray(ball.faces)))) == 1


@pytest.mark.parametrize("size", [(0.03, 0.04, 0.06), (0.02, 0.02, 0.08)])
def test_a_gripper_with_one_jaw_lifts_blocks(tmp_path: Path, size: tuple[float, ...]) -> None:
    path = tmp_path / "jaw.urdf"
    path.write_text(JAW)
    gripper = read_gripper(path)
    standing = np.eye(4)
    standing[2, 3] = size[2] / 2 + 5e-4
    body = body_of(solid_of("cuboid", size), mass=0.1, friction=0.6)
    grasps = grasp_candidates(Shape("cuboid", size), gripper)
    above = grasps[np.flatnonzero(grasps.poses[:, 2, 2] < -0.9)]
    trial = Trial(gripper, body, standing)
    outcomes = [trial.run(grasp) for grasp in above[:3]]
    assert [mismatch(outcome) for outcome in outcomes] == [None] * 3
    # The jaw that moves brings the block to the other one, 4 mm away, not half of the opening.
    assert all(0.002 < abs(outcome.shift[0]) < 0.008 for outcome in outcomes)


@pytest.mark.parametrize("name", ["panda", "pr2"])
def test_a_mug_is_lifted_by_its_rim(name: str) -> None:
    gripper, mesh = real_gripper(name), mug()
    body = body_of(
        Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)), mass=0.2, friction=0.6
    )
    grasps = grasps_of_mug(name)
    down = grasps[np.flatnonzero((grasps.poses[:, 2, 2] < -0.9) & (grasps.widths < 0.008))]
    standing = np.eye(4)
    standing[2, 3] = 5e-4
    outcomes = [mismatch(Trial(gripper, body, standing).run(grasp)) for grasp in down[:4]]
    assert outcomes.count(None) >= 3


def test_without_the_library_for_collisions_a_mesh_has_the_grasps_of_its_primitive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gripper, mesh = real_gripper("stretch_se3"), mug()
    shape = mesh_primitive(mesh)
    monkeypatch.setitem(sys.modules, "fcl", None)
    library.cache_clear()
    try:
        found = mesh_grasps(mesh, shape, gripper)
    finally:
        library.cache_clear()
    assert len(found)
    np.testing.assert_array_equal(found.poses, grasp_candidates(shape, gripper).poses)
