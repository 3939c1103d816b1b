"""Similarity transforms of the plane, and their fit to pairs of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Similarity:
    """``p -> scale * R(yaw) @ p + (x, y)``; yaw in radians."""

    scale: float = 1.0
    yaw: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return points (N, 2), transformed."""
        c, s = self.scale * np.cos(self.yaw), self.scale * np.sin(self.yaw)
        moved: NDArray[np.float64] = np.asarray(points, float) @ np.array([[c, s], [-s, c]])
        moved += (self.x, self.y)
        return moved


def fit_similarity(source: ArrayLike, target: ArrayLike) -> Similarity:
    """Return the similarity without reflection that maps `source` to `target` by least squares.

    In the plane the problem is linear in (a, b) = scale * (cos yaw, sin yaw), and centring
    separates the translation (Umeyama 1991, for two dimensions). Points are (N, 2); a ValueError
    refuses fewer than two distinct ones, or a fit that shrinks everything to one.
    """
    p, q = np.asarray(source, float), np.asarray(target, float)
    mean_p, mean_q = p.mean(axis=0), q.mean(axis=0)
    u, v = p - mean_p, q - mean_q
    spread = float((u * u).sum())
    if len(p) < 2 or spread == 0.0:
        raise ValueError("two distinct points are needed")
    a = float((u * v).sum()) / spread
    b = float((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum()) / spread
    scale, yaw = float(np.hypot(a, b)), float(np.arctan2(b, a))
    if scale == 0.0:
        raise ValueError("the points do not fit by any scale")
    x, y = mean_q - Similarity(scale, yaw).apply(mean_p[None])[0]
    return Similarity(scale, yaw, float(x), float(y))
