"""Trials of parts on joints, by what a hinge and a slide must do."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from semmap.geometry.mesh import Mesh
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import opening_mismatch
from semmap.manipulation.handles import front_of, handle_surfaces, opening_grasps, part_pieces
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.part_trial import OpeningOutcome, PartTrial, Resistance
from semmap.manipulation.trial import body_of
from semmap.manipulation.turning import turn_contacts, turn_records
from tests.manipulation.grippers import real_gripper


def box(size, at) -> trimesh.Trimesh:
    made = trimesh.creation.box(size)
    made.apply_translation(at)
    return made


def door(side: int = 1, knob: float = 0.32) -> trimesh.Trimesh:
    """A leaf from its hinge at the origin to y = -0.35 side, with a knob in front, at -x."""
    cap = trimesh.creation.cylinder(0.015, 0.02, sections=24)
    stem = trimesh.creation.cylinder(0.006, 0.04, sections=12)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))
    for part, x in ((cap, -0.045), (stem, -0.03)):
        part.apply_transform(turn)
        part.apply_translation((x, -side * knob, 0))
    leaf = box((0.02, 0.35, 0.4), (0, -side * 0.175, 0))
    found: trimesh.Trimesh = trimesh.util.concatenate([leaf, cap, stem])
    return found


def trial(mesh, motion, friction: float = 0.5, resistance: Resistance | None = None) -> PartTrial:
    surface = Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32))
    body = body_of(surface, mass=2.0, friction=friction, pieces=part_pieces(mesh, motion))
    return PartTrial(real_gripper("panda"), body, np.eye(4), motion, resistance)


@pytest.mark.parametrize("side", [1, -1])
def test_a_knob_far_from_the_hinge_is_the_handle(side: int) -> None:
    mesh, motion = door(side), PartMotion.about((0, 0, 0, 0, 0, -side), 1.2)
    normal, height = front_of(mesh, np.array((-1.0, 0, 0)))
    assert np.allclose(normal, (-1, 0, 0), atol=1e-2)
    assert height == pytest.approx(0.01, abs=1e-3)
    (handle,) = handle_surfaces(mesh, motion)
    assert handle.bounds[:, 0] == pytest.approx((-0.055, -0.016), abs=1e-3)
    grasps = opening_grasps(mesh, motion, real_gripper("panda"))
    pads = grasps.gripper.pads_at(grasps.widths)
    at = np.einsum("nij,nj->ni", grasps.poses[:, :3, :3], pads) + grasps.poses[:, :3, 3]
    assert np.linalg.norm(at - (-0.045, -side * 0.32, 0), axis=1).max() < 0.03
    assert {"front", "side"} <= set(grasps.approaches.tolist())


def test_a_knob_near_the_hinge_is_held_less_well() -> None:
    motion = PartMotion.about((0, 0, 0, 0, 0, -1), 1.2)
    far, near = (opening_grasps(door(1, at), motion, real_gripper("panda")) for at in (0.32, 0.1))
    assert near.qualities.max() < 0.5 * far.qualities.max()


def test_a_door_opens_unless_it_slips_or_sticks() -> None:
    mesh, motion = door(), PartMotion.about((0, 0, 0, 0, 0, -1), 1.2)
    grasp = opening_grasps(mesh, motion, real_gripper("panda"))[0]
    given = grasp.pose, grasp.pre_grasp, grasp.pre_posture
    done = trial(mesh, motion).open(*given)
    assert opening_mismatch(done) is None
    assert done.opened == pytest.approx(1, abs=0.02)
    rusty = trial(mesh, motion, resistance=Resistance(80.0, 0.5)).open(*given)
    assert opening_mismatch(rusty) in ("let go", "stuck")
    assert rusty.opened < 0.5
    slippery = trial(mesh, motion, friction=0.02, resistance=Resistance(3.0, 1.0)).open(*given)
    assert opening_mismatch(slippery) == "let go"
    away = np.eye(4)
    away[1, 3] = 0.1
    missed = trial(mesh, motion).open(*given, error=away)
    assert opening_mismatch(missed) == "missed"
    assert missed.opened < 0.05


def test_a_turn_pushes_where_the_lever_is_long() -> None:
    mesh, motion = door(), PartMotion.about((0, 0, 0, 0, 0, 1), 1.0)  # from its front to +x
    points, headings, quality = turn_contacts(mesh, motion)
    assert len(points) > 20
    on_leaf = np.abs(points[:, 0] + 0.01) < 1e-3
    assert np.allclose(points[~on_leaf, 0], -0.055, atol=1e-3)  # else on the end of the knob
    away = np.linalg.norm(points[on_leaf, 1:] - (-0.32, 0), axis=1)
    assert away.min() > 0.015
    levers = np.linalg.norm(points[:, :2], axis=1)
    assert (levers > 0.17).all()
    assert np.corrcoef(levers, quality)[0, 1] > 0.99
    assert np.allclose(
        np.cross((0, 0, 1), points * (1, 1, 0)) / levers[:, None], headings, atol=1e-6
    )
    record = turn_records(mesh, motion, real_gripper("panda"))[0]
    assert record.pre_pose is not None
    pushed = trial(mesh, motion).turn(
        record.pose.matrix, record.pre_pose.matrix, dict(record.posture)
    )
    assert opening_mismatch(pushed) is None
    stuck = trial(mesh, motion, resistance=Resistance(300.0, 1.0)).turn(
        record.pose.matrix, record.pre_pose.matrix, dict(record.posture)
    )
    assert opening_mismatch(stuck) == "stuck"
    with pytest.raises(ManipulationError, match="a part on a slide cannot be turned"):
        turn_records(mesh, PartMotion.along((1, 0, 0), 0.1), real_gripper("panda"))


@pytest.mark.parametrize("side", [1, -1])
def test_a_turn_pushes_thin_leaves_on_the_near_face(side: int) -> None:
    motion = PartMotion.about((0, 0, 0, 0, 0, side), 1.0)
    leaf = box((0.003, 0.35, 0.4), (0, -0.175, 0))
    points, headings, _ = turn_contacts(leaf, motion)
    assert len(points) > 20
    assert np.allclose(points[:, 0], -side * 0.0015)
    assert (side * headings[:, 0] > 0.9).all()
    sheet = leaf.submesh([np.flatnonzero(leaf.face_normals[:, 0] > 0.9)], append=True)
    assert len(turn_contacts(sheet, motion)[0]) > 20  # an open one has one face for both sides


def test_names_of_turns_do_not_depend_on_the_model_s_frame() -> None:
    leaf = box((0.02, 0.35, 0.4), (0, -0.175, 0))
    named = []
    for turn in (np.eye(4), trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))):
        moved = leaf.copy()
        moved.apply_transform(turn)
        about = PartMotion.about((0, 0, 0, *turn[:3, 2]), 1)
        records = turn_records(moved, about, real_gripper("panda"))
        named.append({(record.approach, record.family) for record in records})
    assert named[0] == named[1] == {("square", "hinge along"), ("square", "hinge across")}


def test_outcomes_have_causes() -> None:
    assert opening_mismatch(OpeningOutcome(0.9, True, True)) is None
    assert opening_mismatch(OpeningOutcome(0.89, True, True)) == "stuck"
    assert opening_mismatch(OpeningOutcome(1.0, True, False)) == "let go"
    assert opening_mismatch(OpeningOutcome(1.0, False, True)) == "missed"
