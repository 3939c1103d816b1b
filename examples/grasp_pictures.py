"""Pictures of grasp candidates on the four shapes, and of real grippers at their best grasps.

python examples/grasp_pictures.py FOLDER
"""

from __future__ import annotations

import argparse
import importlib.metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semmap.draw.grasps import grasps_picture
from semmap.geometry.mesh import Mesh, box_mesh
from semmap.manipulation.candidates import Grasps, grasp_candidates
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.gripper import Gripper, read_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.store.shapes import StoredShape

SHAPES = (
    ("cuboid", (0.05, 0.06, 0.14)),
    ("cylinder", (0.03, 0.14)),
    ("sphere", (0.033,)),
    ("cone", (0.034, 0.15)),
)
APART = 0.24
SHOWN = 14
"""Grasps of a shape that are drawn."""


def urdf(name: str) -> Path:
    """The URDF of a robot, from the package example-robot-data."""
    files = importlib.metadata.files("example-robot-data") or []
    end = f"{name}_description/urdf/{name}.urdf"
    return Path(str(next(file.locate() for file in files if str(file).endswith(end))))


def free(gripper: Gripper, kind: str, size: tuple[float, ...], standing: NDArray) -> Grasps:
    """The grasps that touch neither the table nor, before the fingers close, the object."""
    mesh = solid_of(kind, size).mesh()
    table = box_mesh((-1, -1, -0.05), (1, 1, 0)).triangles
    grasps = grasp_candidates(StoredShape(kind, size, np.eye(4)), gripper)
    seen = mesh.triangles + standing[:3, 3]
    local = Obstacles(table + np.array([standing[0, 3], 0, 0]))
    return grasps[free_grasps(grasps, standing, local, item=Obstacles(seen))]


def main() -> None:
    """Draw both pictures."""
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
    board = box_mesh((-0.5, -0.13, -0.02), (0.5, 0.13, -0.0005))
    table = [(board, "#efe9dd")]
    print(grasps_picture(objects, forks, folder / "grasps.png", others=table))
    print(grasps_picture(objects, [], folder / "grippers.png", others=[*table, *hands]))


if __name__ == "__main__":
    main()
