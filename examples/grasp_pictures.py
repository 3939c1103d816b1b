"""Pictures of grasp candidates on the four shapes and on hollow things, and of real grippers.

python examples/grasp_pictures.py FOLDER
"""

from __future__ import annotations

import argparse
import importlib.metadata
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from matplotlib import colormaps
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from semmap.draw.scene3d import scene3d
from semmap.draw.view import ObjectView, StoreyView
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.manipulation.candidates import Grasps, grasp_candidates
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.store.model_shapes import StoredShape
from semmap.manipulation.surface_grasps import mesh_grasps
from semmap.perception.mesh_shapes import mesh_primitive

SHAPES = (
    ("cuboid", (0.05, 0.06, 0.14)),
    ("cylinder", (0.03, 0.14)),
    ("sphere", (0.033,)),
    ("cone", (0.034, 0.15)),
)
APART = 0.24
SHOWN = 14
"""Grasps of a shape that are drawn."""

THICKNESS = 0.0022
"""Of the lines of a fork, metres."""

ENLARGED = 12.0
"""Times that objects are drawn larger: scenes are lit for rooms."""


def urdf(name: str) -> Path:
    """The URDF of a robot, from the package example-robot-data."""
    files = importlib.metadata.files("example-robot-data") or []
    end = f"{name}_description/urdf/{name}.urdf"
    return Path(str(next(file.locate() for file in files if str(file).endswith(end))))


def hollow_things() -> list[trimesh.Trimesh]:
    """A mug of 9 cm, a plate and a dumb-bell, each with its bottom at z = 0."""
    handle = trimesh.creation.torus(0.028, 0.005)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    handle.apply_translation((0.045, 0, 0))
    mug = trimesh.creation.cylinder(0.045, 0.1, sections=64).union(handle)
    mug = mug.difference(_lid(0.041, 0.1, 0.004))
    plate = trimesh.creation.cylinder(0.11, 0.016, sections=96)
    plate = plate.difference(_lid(0.1, 0.016, 0.006))
    bar = trimesh.creation.cylinder(0.012, 0.16)
    for end in (-0.07, 0.07):
        weight = trimesh.creation.cylinder(0.035, 0.03, sections=48)
        weight.apply_translation((0, 0, end))
        bar = bar.union(weight)
    bar.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    made = [mug, plate, bar]
    for each in made:
        each.apply_translation((0, 0, -each.bounds[0, 2]))
    return made


def _lid(radius: float, height: float, lift: float) -> trimesh.Trimesh:
    """What is taken out of a cylinder."""
    made = trimesh.creation.cylinder(radius, height, sections=96)
    made.apply_translation((0, 0, lift))
    return made


def free(gripper: Gripper, kind: str, size: tuple[float, ...], standing: NDArray) -> Grasps:
    """The grasps that touch neither the table nor, before the fingers close, the object."""
    grasps = grasp_candidates(StoredShape(kind, size, np.eye(4)), gripper)
    return untouched(grasps, solid_of(kind, size).mesh(), standing)


def untouched(grasps: Grasps, mesh: Mesh, standing: NDArray) -> Grasps:
    """Those of the grasps of a mesh at which the open gripper touches neither it nor the table."""
    table = box_mesh((-1, -1, -0.05), (1, 1, 0)).triangles
    seen = mesh.triangles + standing[:3, 3]
    local = Obstacles(table + np.array([standing[0, 3], 0, 0]))
    return grasps[free_grasps(grasps, standing, local, item=Obstacles(seen))]


def fork(pose: NDArray, width: float, depth: float = 0.04, stem: float = 0.03) -> Mesh:
    """Return a gripper as a fork: two fingers, the palm between them, and a stem.

    Parameters
    ----------
    pose : (4, 4) grasp frame: approach +z, closing +x, origin between the pads
    width : metres between the fingers
    depth, stem : lengths of fingers and stem, metres
    """
    half, t = width / 2 + THICKNESS, THICKNESS / 2
    bars = [
        box_mesh((-half - t, -t, -depth), (-half + t, t, 0.01)),
        box_mesh((half - t, -t, -depth), (half + t, t, 0.01)),
        box_mesh((-half - t, -t, -depth - t), (half + t, t, -depth + t)),
        box_mesh((-t, -t, -depth - stem), (t, t, -depth)),
    ]
    whole = join(bars)
    return Mesh(whole.vertices @ pose[:3, :3].T + pose[:3, 3], whole.faces)


def grasps_picture(
    objects: Sequence[tuple[str, Mesh]],
    grasps: Sequence[tuple[NDArray, float, float]],
    path: Path | str,
    *,
    others: Sequence[tuple[Mesh, str]] = (),
    title: str = "",
    azimuth: float = -75.0,
    elevation: float = 22.0,
) -> Path:
    """Draw objects with grasps and return the path of the picture.

    Parameters
    ----------
    objects : names and meshes, in one frame, metres
    grasps : poses (4, 4) in that frame, widths in metres, and qualities in [0, 1]
    others : meshes with colours, such as a gripper or a table
    """
    views = [_view(name, mesh, "#d9c7a3") for name, mesh in objects]
    views += [_view("", mesh, colour) for mesh, colour in others]
    shades = colormaps["viridis"]
    low = min((q for _, _, q in grasps), default=0.0)
    for pose, width, quality in grasps:
        share = (quality - low) / max(1 - low, 1e-9)
        views.append(_view("", fork(pose, width), to_hex(shades(0.15 + 0.75 * share))))
    return scene3d(
        [StoreyView("grasps", objects=views)],
        path,
        title=title,
        boxes=False,
        cut=1e9,
        azimuth=azimuth,
        elevation=elevation,
        width=1500,
    )


def _view(name: str, mesh: Mesh, colour: str) -> ObjectView:
    return ObjectView(name, (), Mesh(mesh.vertices * ENLARGED, mesh.faces), colour=colour)


def main() -> None:
    """Draw the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    objects, forks, hands = [], [], []
    grippers = [read_gripper(urdf("panda")), read_gripper(urdf("pr2"))]
    for i, (kind, size) in enumerate(SHAPES):
        made = solid_of(kind, size).mesh(96)
        standing = np.eye(4)
        standing[:3, 3] = APART * (i - 1.5), 0, -made.used[:, 2].min()
        objects.append((kind, Mesh(made.vertices + standing[:3, 3], made.faces)))
        grasps = free(grippers[0], kind, size, standing)
        own = grasps[np.char.endswith(grasps.families, "own")]
        step = max(1, len(own) // SHOWN)
        for grasp in own[::step]:
            forks.append((standing @ grasp.pose, grasp.width, grasp.quality))
        gripper = grippers[i % 2]
        found = free(gripper, kind, size, standing)
        grasp = found[int(np.argmax(found.poses[:, 2, 3]))]
        at = standing @ grasp.pose
        for link, mesh in gripper.meshes(grasp.width).items():
            moved = Mesh(mesh.vertices @ at[:3, :3].T + at[:3, 3], mesh.faces)
            finger = any(link in f for f in gripper.fingers)
            hands.append((moved, "#7a8699" if finger else "#c9ced6"))
    hollow, held = [], []
    for i, made in enumerate(hollow_things()):
        mesh = Mesh(np.asarray(made.vertices), np.asarray(made.faces, np.int32))
        standing = np.eye(4)
        standing[0, 3] = 0.3 * (i - 1)
        hollow.append(("", Mesh(mesh.vertices + standing[:3, 3], mesh.faces)))
        grasps = untouched(mesh_grasps(made, mesh_primitive(made), grippers[0]), mesh, standing)
        for grasp in grasps[:: max(1, len(grasps) // SHOWN)]:
            held.append((standing @ grasp.pose, grasp.width, grasp.quality))
    board = box_mesh((-0.5, -0.13, -0.02), (0.5, 0.13, -0.0005))
    table = [(board, "#efe9dd")]
    print(grasps_picture(objects, forks, folder / "grasps.png", others=table))
    print(grasps_picture(hollow, held, folder / "mesh_grasps.png", others=table, elevation=35.0))
    print(grasps_picture(objects, [], folder / "grippers.png", others=[*table, *hands]))


if __name__ == "__main__":
    main()
