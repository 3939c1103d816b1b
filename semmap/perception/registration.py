"""Alignment of a cloud with a model: ICP by small_gicp, and RANSAC over pairs of oriented points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from semmap.perception.error import PerceptionError
from semmap.perception.point_cloud import Floats

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["IcpTarget", "moved"]


def _small_gicp() -> ModuleType:
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
        """Return the (4, 4) pose of a prepared cloud in the frame of the target.

        Parameters
        ----------
        pose
            (4, 4) where the search begins.
        reach
            Points farther from the target than this have no weight, metres.
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
