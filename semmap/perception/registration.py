"""Alignment of a cloud with a model: ICP by small_gicp, RANSAC over pairs of oriented points."""

from __future__ import annotations

from typing import Any

import numpy as np

from semmap.perception.point_cloud import Floats, PerceptionError, Surfels


def _small_gicp() -> Any:
    try:
        import small_gicp
    except ImportError as error:
        raise PerceptionError(
            "small_gicp is not installed: pip install 'semmap[perception]'"
        ) from error
    return small_gicp


def moved(pose: Floats, points: Floats) -> Floats:
    """Return points (n, 3) moved by a (4, 4) pose."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


class IcpTarget:
    """A cloud that others are aligned with, from point to plane."""

    def __init__(self, points: Floats) -> None:
        library = _small_gicp()
        self._cloud = library.PointCloud(points)
        self._tree = library.KdTree(self._cloud)
        library.estimate_normals_covariances(self._cloud, self._tree, 12)
        self._align = library.align
        self._make = library.PointCloud

    def prepared(self, points: Floats) -> Any:
        """Return a cloud (n, 3) as `align` takes it."""
        return self._make(points)

    def align(self, source: Any, pose: Floats, reach: float, steps: int = 20) -> Floats:
        """Return the pose (4, 4) of a prepared cloud in the target's frame, searched from a pose.

        Points farther from the target than `reach` metres have no weight.
        """
        found = self._align(
            self._cloud,
            source,
            self._tree,
            init_T_target_source=pose,
            registration_type="PLANE_ICP",
            max_correspondence_distance=reach,
            max_iterations=steps,
            translation_epsilon=1e-4,
        )
        return np.asarray(found.T_target_source)


class OrientedPairs:
    """Pairs of points with normals, which a rigid motion keeps: their distance and three angles.

    Equal pairs of scene and model give a pose (Drost, "Model Globally, Match Locally", 2010).
    """

    def __init__(self, cloud: Surfels, pairs: int, random: np.random.Generator) -> None:
        count = len(cloud.points)
        first = random.integers(0, count, 4 * pairs)
        second = random.integers(0, count, 4 * pairs)
        p, q = cloud.points[first], cloud.points[second]
        n, m = cloud.normals[first], cloud.normals[second]
        apart = q - p
        length = np.linalg.norm(apart, axis=1)
        extent = float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
        line = apart / np.maximum(length, 1e-9)[:, None]
        # The signs of normals are arbitrary: both are taken along the line.
        n = n * np.where(np.einsum("ni,ni->n", n, line) < 0, -1, 1)[:, None]
        m = m * np.where(np.einsum("ni,ni->n", m, line) < 0, -1, 1)[:, None]
        cosines = [np.einsum("ni,ni->n", a, b) for a, b in ((n, line), (m, line), (n, m))]
        # Parallel normals leave a turn about them open, a normal across the line its sign.
        usable = (length > 0.1 * extent) & (np.abs(cosines[2]) < 0.8)
        usable &= (cosines[0] > 0.1) & (cosines[1] > 0.1)
        keep = np.flatnonzero(usable)[:pairs]
        self.frames = _frames(p[keep], n[keep], m[keep])
        self.features = np.column_stack([length[keep], *(0.1 * a[keep] for a in cosines)])


def _frames(points: Floats, first: Floats, second: Floats) -> Floats:
    """(n, 4, 4): x along the first normal, y towards the second."""
    y = second - np.einsum("ni,ni->n", first, second)[:, None] * first
    y /= np.maximum(np.linalg.norm(y, axis=1), 1e-9)[:, None]
    frames = np.zeros((len(points), 4, 4))
    frames[:, :3, 0], frames[:, :3, 1] = first, y
    frames[:, :3, 2], frames[:, :3, 3] = np.cross(first, y), points
    frames[:, 3, 3] = 1
    return frames
