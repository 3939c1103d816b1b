"""Grasps of a mesh or of a shape by any gripper: by fingers, or by a suction cup."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semmap.manipulation.candidates import Grasps, grasp_candidates
from semmap.manipulation.gripper import Gripper, transformed
from semmap.manipulation.solids import FITS, PrimitiveShape, solid_hull, solid_of
from semmap.manipulation.suction_grasps import suction_grasps
from semmap.manipulation.surface_grasps import mesh_grasps, surface_of

if TYPE_CHECKING:
    import trimesh

SECTIONS = 180
"""Sides of a round shape: between two of them, a cup's lip meets no edge that counts."""


def grasps_of_mesh(mesh: trimesh.Trimesh, shape: PrimitiveShape, gripper: Gripper) -> Grasps:
    """The grasps of a mesh, whose primitive is `shape`; both in the frame of the model."""
    if gripper.cup is None:
        return mesh_grasps(mesh, shape, gripper)
    centre = solid_hull(np.asarray(mesh.vertices)[np.unique(mesh.faces)])[1]
    return suction_grasps(
        surface_of(mesh, centre),
        gripper,
        np.asarray(mesh.triangles),
        frame=shape.pose,
        either_side=not mesh.is_watertight,
    )


def shape_grasps(shape: PrimitiveShape, gripper: Gripper) -> Grasps:
    """The grasps of a shape in the frame of the model, by fingers in closed form."""
    if gripper.cup is None:
        return grasp_candidates(shape, gripper)
    import trimesh  # slow to load

    solid = solid_of(shape.kind, shape.size).mesh(SECTIONS)
    mesh = trimesh.Trimesh(transformed(solid.vertices, shape.pose), solid.faces)
    return grasps_of_mesh(mesh, shape, gripper)


def is_enough(shape: PrimitiveShape, gripper: Gripper) -> bool:
    """Whether grasps of the primitive of a mesh are those of the mesh: fingers forgive bumps."""
    return gripper.cup is None and shape.inliers >= FITS
