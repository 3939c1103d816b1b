"""The sphere, cylinder, cuboid or cone that is most like a mesh.

Shapes are compared as solids, by the volume that they share with the mesh's convex hull: handles
and spouts count little, and a box or cylinder around the mesh remains where nothing fits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from semmap.perception.fitted_shapes import Fit, Placed, refined, size_of
from semmap.perception.hypotheses import hypotheses, smallest_box
from semmap.perception.point_cloud import Floats, PerceptionError, Surfels, surfels
from semmap.perception.primitives import Primitive, primitive_of

if TYPE_CHECKING:
    import trimesh

SAMPLES = 4000
FITTED = 1000
VOLUMES: dict[str, Callable[..., float]] = {
    "sphere": lambda r: 4 / 3 * np.pi * r**3,
    "cylinder": lambda r, h: np.pi * r**2 * h,
    "cone": lambda r, h: np.pi * r**2 * h / 3,
    "cuboid": lambda x, y, z: x * y * z,
}
TOLERANCE = 0.01
"""Distance of inliers as a share of the diameter."""


def mesh_primitive(mesh: trimesh.Trimesh, *, seed: int = 0) -> Primitive:
    """Return the shape that is most like a mesh, in the frame of the mesh.

    Raises PerceptionError: no faces, vertices that are not finite, or no volume.
    """
    import trimesh

    vertices = np.asarray(mesh.vertices, float)
    if not len(mesh.faces) or not np.isfinite(vertices).all() or not mesh.area > 0:
        raise PerceptionError("the mesh has no surface: give a mesh with faces and finite vertices")
    used = vertices[np.unique(mesh.faces)]
    middle = (used.min(axis=0) + used.max(axis=0)) / 2
    try:
        hull = ConvexHull(used - middle)
    except QhullError as error:
        raise PerceptionError(
            "the mesh is flat, it has no volume: give the mesh of a solid"
        ) from error
    random = np.random.default_rng(seed)
    points, faces = trimesh.sample.sample_surface(mesh, SAMPLES, seed=seed)
    points = points - middle
    normals = np.asarray(mesh.face_normals, float)[faces]
    flat = surfels(points[:FITTED])
    fitted = Surfels(points[:FITTED], normals[:FITTED], 0.0, flat.spacing)
    diameter = float(np.linalg.norm(np.ptp(used, axis=0)))
    within, noise = TOLERANCE * diameter, 1e-3 * diameter
    rough = hypotheses(fitted, 2 * within, np.array([0.0, 0, 1]), random)
    fits = [fit for shape in rough if (fit := refined(shape, fitted, points, noise, None))]
    fits = [fit for fit in fits if np.isfinite(fit.deviation).all()]
    fits += [_unrefined(shape, points) for shape in _bounding(hull, normals)]
    low, high = 1.1 * hull.points.min(axis=0), 1.1 * hull.points.max(axis=0)
    probes = random.uniform(low, high, (SAMPLES, 3))
    in_hull = (probes @ hull.equations[:, :3].T + hull.equations[:, 3] <= 0).all(axis=1)
    share = hull.volume / max(int(in_hull.sum()), 1)
    best = max(fits, key=lambda fit: _likeness(fit, probes[in_hull], share, hull.volume))
    return primitive_of(best, points, middle, within)


def _likeness(fit: Fit, probes: Floats, share: float, volume: float) -> float:
    """Intersection over union of a shape and the hull, whose volume is probed."""
    kind, bounds = fit.placed.kind, fit.placed.bounds
    size = size_of(kind, bounds)
    if not (size > 0).all():
        return 0.0
    common = share * float((fit.placed.distances(probes) <= 0).sum())
    return common / (VOLUMES[kind](*size) + volume - common)


def _bounding(hull: ConvexHull, normals: Floats) -> list[Placed]:
    """Boxes and cylinders around the hull along its axes, and the sphere of the same volume."""
    corners = hull.points[hull.vertices]
    common = np.abs(normals[:200] @ normals.T) > 0.99
    axes = [*np.eye(3), normals[common.sum(axis=1).argmax()]]
    axes += list(np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2])
    found = []
    for axis in axes:
        frame, filled = smallest_box(corners, axis)
        low, high = (corners @ frame).min(axis=0), (corners @ frame).max(axis=0)
        area = filled * np.prod(high[:2] - low[:2])
        ends = np.array([np.sqrt(area / np.pi), low[2], high[2]])
        centre = frame[:, :2] @ ((low + high) / 2)[:2]
        found.append(Placed("cuboid", frame, np.zeros(3), np.concatenate([low, high])))
        found.append(Placed("cylinder", frame, centre, ends))
    radius = np.cbrt(0.75 * hull.volume / np.pi)
    return [*found, Placed("sphere", np.eye(3), corners.mean(axis=0), np.array([radius]))]


def _unrefined(shape: Placed, points: Floats) -> Fit:
    """A shape that no face of the mesh defines: it deviates as its surface does."""
    distance = np.abs(shape.distances(points))
    size = size_of(shape.kind, shape.bounds)
    return Fit(shape, np.ones(6, bool), np.full(len(size), float(distance.mean())))
