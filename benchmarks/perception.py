"""Shapes of half-seen clusters, beside the RANSAC of pyransac3d, which is given the kind."""

from __future__ import annotations

import numpy as np
import pyransac3d
import trimesh
from numpy.typing import NDArray

from benchmarks.timing import Row, medians_in_turn, print_rows
from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.perception.models import depth_points
from semmap.perception.plane import Plane
from semmap.perception.primitives import fit_primitive

__all__ = ["main"]

POINTS = 10_000
NOISE = 0.001
ASKED = 0.03
"""Seconds."""


def half_view(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    """Return about 10,000 points of the side that faces a camera, with noise."""
    random = np.random.default_rng(1)
    middle, radius = mesh.bounds.mean(axis=0), float(np.linalg.norm(mesh.extents)) / 2
    pixels, eye = 400, np.add(middle, (0.7, 0.4, 0.5))
    focal = pixels / 2 * float(np.linalg.norm(eye - middle)) / radius
    middle_pixel = (pixels - 1) / 2
    camera = DepthCamera(
        (pixels, pixels), (focal, focal, middle_pixel, middle_pixel), look_at(eye, middle)
    )
    depths, _ = camera.image(np.asarray(mesh.triangles))
    seen = depth_points(camera, depths + random.normal(0, NOISE, depths.shape)).reshape(-1, 3)
    seen = seen[np.isfinite(seen[:, 0])]
    chosen = random.choice(len(seen), POINTS, replace=False)
    return np.asarray(seen[chosen] @ camera.pose[:3, :3].T + camera.pose[:3, 3])


def shape(kind: str, mesh: trimesh.Trimesh, size: tuple[float, ...]) -> Row:
    """The best of four kinds, beside the peer's fit of the right one."""
    cloud = half_view(mesh)
    table = Plane(np.array([0.0, 0, 1]), float(mesh.bounds[0, 2]))
    found = fit_primitive(cloud, table=table)
    off = np.abs(np.subtract(sorted(found.size), sorted(size))).max()
    peer = {"sphere": pyransac3d.Sphere, "cylinder": pyransac3d.Cylinder}.get(kind)
    if peer is None:
        (ours,) = medians_in_turn(lambda: fit_primitive(cloud, table=table))
        reference = "pyransac3d has no solid of this kind"
    else:
        ours, theirs = medians_in_turn(
            lambda: fit_primitive(cloud, table=table),
            lambda: peer().fit(cloud, thresh=3 * NOISE, maxIteration=1000),
            times=5,
        )
        *_, radius, inliers = peer().fit(cloud, thresh=3 * NOISE, maxIteration=1000)
        reference = (
            f"pyransac3d: {1e3 * theirs:.0f} ms, {theirs / ours:.0f}x; radius "
            f"{1e3 * abs(radius - size[0]):.1f} mm off, {len(inliers) / len(cloud):.0%} inliers"
        )
    return Row(
        f"{kind} of {POINTS:,} points of one side",
        f"{1e3 * ours:.0f} ms; {1e3 * off:.2f} mm off, {found.inliers:.0%} inliers",
        reference,
        f"under {1e3 * ASKED:.0f} ms, 2 mm",
        ours < ASKED and found.kind == kind and off < 0.002,
    )


def main() -> None:
    """Print the table."""
    solids = {
        "sphere": (trimesh.creation.icosphere(4, 0.08), (0.08,)),
        "cylinder": (trimesh.creation.cylinder(0.05, 0.2, sections=128), (0.05, 0.2)),
        "cuboid": (trimesh.creation.box((0.2, 0.12, 0.15)), (0.2, 0.12, 0.15)),
        "cone": (trimesh.creation.cone(0.07, 0.18, sections=128), (0.07, 0.18)),
    }
    print_rows("Shapes", [shape(kind, *solid) for kind, solid in solids.items()])


if __name__ == "__main__":
    main()
