"""Grasps of shapes: their number, symmetry, and contacts, beside rays on the meshes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.manipulation.candidates import ANGLES, grasp_candidates
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.solids import SIZES, solid_of
from tests.manipulation.grippers import Shape, real_gripper

SHAPES = [
    Shape("cuboid", (0.05, 0.06, 0.07)),
    Shape("cuboid", (0.04, 0.04, 0.04)),
    Shape("cylinder", (0.03, 0.12)),
    Shape("sphere", (0.03,)),
    Shape("cone", (0.03, 0.1)),
]


def pose_of(turn, shift):
    pose = trimesh.transformations.quaternion_matrix(np.add(turn, (1e-3, 0, 0, 0)))
    pose[:3, 3] = shift
    return pose


@st.composite
def shapes(draw):
    kind = draw(st.sampled_from(sorted(SIZES)))
    size = tuple(draw(st.floats(0.02, 0.14)) for _ in SIZES[kind])
    turn = [draw(st.floats(-1, 1)) for _ in range(4)]
    return Shape(kind, size, pose_of(turn, [draw(st.floats(-2, 2)) for _ in range(3)]))


@pytest.mark.parametrize("gripper", ["panda", "pr2", "tiago_pro", "allegro"])
def test_a_block_has_at_least_the_grasps_of_the_tool_that_the_paper_extends(gripper):
    """136 are two axes x 17 angles x up and down x two approaches; no two of ours are equal."""
    hand = real_gripper(gripper)
    grasps = grasp_candidates(SHAPES[0], hand)
    flips = [np.eye(4), np.diag([-1.0, -1, 1, 1])][: 1 + hand.is_symmetric]
    different = set()
    for pose, before in zip(grasps.poses, grasps.pre_grasps, strict=True):
        turns = [(pose @ flip, before @ flip) for flip in flips]
        different.add(min(tuple(np.round(turn, 4).ravel() + 0.0) for turn in turns))
    assert len(different) == len(grasps) >= 2 * ANGLES * 2 * 2
    families = [str(family).split() for family in grasps.families]
    for closing in "xyz":
        angles = [float(f[2]) for f in families if f[1:2] + f[3:] == [closing, "0", "own"]]
        # 17 in each half turn, of which the halves share both ends
        assert len(angles) == 2 * (ANGLES - 1) * (1 if hand.is_symmetric else 2)
        if closing != "z":
            assert sorted(set(angles)) == [round(v) for v in np.linspace(-90, 90, ANGLES)]


@settings(max_examples=8)
@given(shape=shapes(), name=st.sampled_from(["panda", "allegro"]))
def test_no_two_grasps_are_equal_under_the_symmetry_of_the_gripper(shape, name):
    gripper = real_gripper(name)
    grasps = grasp_candidates(shape, gripper)
    flips = [np.eye(4), np.diag([-1.0, -1, 1, 1])][: 1 + gripper.is_symmetric]
    before = grasps.pre_grasps[:, :3, 3]
    for i, j in combinations(range(len(grasps)), 2):
        if np.abs(before[i] - before[j]).max() > 1e-7:
            continue
        apart = [np.abs(grasps.poses[i] @ flip - grasps.poses[j]).max() for flip in flips]
        assert min(apart) > 1e-7


@settings(max_examples=15)
@given(shape=shapes(), name=st.sampled_from(["panda", "pr2"]), friction=st.floats(0.2, 1.0))
def test_contacts_are_antipodal_within_the_friction_cone(shape, name, friction):
    """Rays that the fingers' pads follow meet the mesh of the shape, from both sides."""
    gripper = real_gripper(name)
    grasps = grasp_candidates(shape, gripper, friction=friction)[:40]
    if not len(grasps):
        return
    made = solid_of(shape.kind, shape.size).mesh(128)
    mesh = trimesh.Trimesh(made.vertices, made.faces).apply_transform(shape.pose)
    reach = [np.interp(-w, -gripper.widths, gripper.reaches) for w in grasps.widths]
    middle = grasps.poses[:, :3, 3] + np.array(reach)[:, None] * grasps.poses[:, :3, 2]
    found = []
    for side in (-1.0, 1.0):
        directions = side * grasps.poses[:, :3, 0]
        hits, ray, face = mesh.ray.intersects_location(
            middle - 0.5 * directions, directions, multiple_hits=False
        )
        order = np.argsort(ray)
        assert (ray[order] == np.arange(len(grasps))).all()
        facing = np.einsum("ni,ni->n", mesh.face_normals[face[order]], -directions)
        assert (
            np.degrees(np.arccos(np.clip(facing, -1, 1))) <= np.degrees(np.arctan(friction)) + 6
        ).all()
        found.append(hits[order])
    across = np.linalg.norm(found[0] - found[1], axis=1)
    np.testing.assert_allclose(across, grasps.widths, atol=0.002)
    np.testing.assert_allclose((found[0] + found[1]) / 2, middle, atol=0.002)
    assert (across < gripper.opening).all()


@settings(max_examples=20)
@given(shape=shapes(), seed=st.integers(0, 1000))
def test_rays_leave_solids_where_they_leave_their_meshes(shape, seed):
    solid = solid_of(shape.kind, shape.size)
    made = solid.mesh(256)
    mesh = trimesh.Trimesh(made.vertices, made.faces)
    random = np.random.default_rng(seed)
    directions = random.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    starts = np.tile(solid.centre, (20, 1))
    distances, normals = solid.exits(starts, directions)
    hits, ray, _ = mesh.ray.intersects_location(starts, directions)
    theirs = np.linalg.norm(hits - starts[ray], axis=1)
    np.testing.assert_allclose(distances[ray], theirs, rtol=0.01)
    assert (np.einsum("ni,ni->n", normals, directions) > 0).all()
    assert mesh.volume == pytest.approx(solid.volume, rel=0.02)
    np.testing.assert_allclose(mesh.center_mass, solid.centre, atol=1e-3 * max(shape.size))


def test_the_best_grasps_are_first_and_move_with_the_shape():
    gripper = real_gripper("panda")
    pose = pose_of((0.3, -0.2, 0.5, 0.1), (1.0, 2.0, 3.0))
    at_home = grasp_candidates(Shape("cylinder", (0.03, 0.12)), gripper)
    moved = grasp_candidates(Shape("cylinder", (0.03, 0.12), pose), gripper)
    assert (np.diff(at_home.qualities) <= 0).all()
    np.testing.assert_allclose(moved.poses, pose @ at_home.poses, atol=1e-12)
    assert ((at_home.qualities > 0) & (at_home.qualities <= 1)).all()


def test_a_slippery_cone_cannot_be_held_across():
    """Its sides lean by 17 degrees: friction of 0.5 holds it, one of 0.2 does not."""
    gripper = real_gripper("panda")
    cone = Shape("cone", (0.03, 0.1))
    held = {str(f).split()[1] for f in grasp_candidates(cone, gripper, friction=0.5).families}
    slips = grasp_candidates(cone, gripper, friction=0.2)
    assert held == {"r"}
    assert len(slips) == 0


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (Shape("cuboid", (0.1, 0.0, 0.1)), "give no volume; give x, y, z above 0 m"),
        (Shape("cylinder", (float("nan"), 0.1)), "give no volume"),
        (Shape("torus", (0.1,)), "shape torus: give one of cuboid"),
        (Shape("sphere", (0.1, 0.2)), "sphere: has 2 sizes; give radius"),
    ],
)
def test_shapes_without_a_volume(shape, message):
    with pytest.raises(ManipulationError, match=message):
        grasp_candidates(shape, real_gripper("panda"))


def test_too_wide_is_no_grasp():
    assert len(grasp_candidates(Shape("sphere", (0.2,)), real_gripper("panda"))) == 0
