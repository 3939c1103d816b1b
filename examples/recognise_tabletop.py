"""Recognise YCB objects on a table, fit shapes to all clusters, and draw both.

python examples/recognise_tabletop.py WORLDS [PICTURE]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.perception.fitted_shapes import SHAPES
from semmap.perception.models import depth_points, train_model
from semmap.perception.primitives import fit_primitive
from semmap.perception.recognition import Scene, recognise_cluster
from semmap.perception.registration import moved
from semmap.perception.tabletop import segment_tabletop

ON_TABLE = {  # x, y, heading
    "003_cracker_box": (-0.25, 0.12, 0.4),
    "005_tomato_soup_can": (0.02, -0.12, 0.0),
    "006_mustard_bottle": (0.06, 0.15, 1.9),
    "009_gelatin_box": (-0.2, -0.14, 0.8),
}
STRANGER = "aws_robomaker_residential_Vase_01"


def standing(mesh: Mesh, x: float, y: float, yaw: float) -> Mesh:
    """Return a mesh on the table z = 0."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    corners = mesh.vertices @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    shift = np.array([x, y, 0.0]) - [*(low + high)[:2] / 2, low[2]]
    return Mesh(corners + shift, mesh.faces)


def main(worlds: Path, picture: Path) -> None:
    """Print what was recognised, and draw the view."""
    meshes = {
        name: read_mesh(worlds / "ycb" / "meshes" / f"{name}_textured.gltf") for name in ON_TABLE
    }
    (vase,) = (worlds / "small_house" / "models" / STRANGER / "meshes").glob("*visual.DAE")
    table_mesh = box_mesh((-0.6, -0.4, -0.03), (0.6, 0.4, 0.0))
    parts = [standing(meshes[name], *place) for name, place in ON_TABLE.items()]
    parts.append(standing(read_mesh(vase, dae_up_axis=False), 0.27, -0.02, 0.0))
    camera = DepthCamera(
        (640, 480), (760.0, 760.0, 319.5, 239.5), look_at((0.05, -1.05, 0.62), (0, 0, 0.06))
    )
    depths, _ = camera.image(join([table_mesh, *parts]).triangles)
    noise = np.random.default_rng(5).normal(0, 0.001, depths.shape)
    cloud = depth_points(camera, depths + noise)
    models = {name: train_model(name, mesh) for name, mesh in meshes.items()}

    table = segment_tabletop(cloud, up=camera.pose[:3, :3].T @ (0, 0, 1))
    scene = Scene(cloud)
    _, axes = plt.subplots(figsize=(8, 5.2))
    axes.imshow(depths, cmap="gray_r", alpha=0.35)
    for number, cluster in enumerate(table.clusters):
        found = recognise_cluster(cluster, [*models.values()], scene)
        shape = fit_primitive(cluster, table=table.plane)
        size = ", ".join(
            f"{p} {1e3 * s:.0f}±{1e3 * d:.0f}"
            for p, s, d in zip(SHAPES[shape.kind], shape.size, shape.deviation, strict=True)
        )
        print(f"{found.name or 'unknown':22s} score {found.score:.2f}  {shape.kind}: {size} mm")
        colour = f"C{number}"
        column, row = pixels(camera, cluster)
        axes.scatter(column, row, s=1.5, color=colour)
        if found.name is not None:
            outline = pixels(camera, moved(found.pose, models[found.name].points[::12]))
            axes.scatter(*outline, s=1, color="black", alpha=0.5)
        near = row.mean() > camera.size[1] / 2  # the label below leaves what is behind in view
        axes.text(
            column.mean(),
            row.max() + 8 if near else row.min() - 8,
            f"{found.name or 'unknown'}\n{shape.kind}: {size} mm",
            ha="center",
            va="top" if near else "bottom",
            fontsize=7,
            color=colour,
        )
    axes.set_axis_off()
    axes.figure.tight_layout(pad=0.2)
    axes.figure.savefig(picture, dpi=110)
    print(picture)


def pixels(camera: DepthCamera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return columns and rows of points in the frame of the camera."""
    fx, fy, cx, cy = camera.intrinsics
    return fx * points[:, 0] / points[:, 2] + cx, fy * points[:, 1] / points[:, 2] + cy


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "tabletop.png"))
