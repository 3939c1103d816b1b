"""One frame for the levels of an Open-RMF building: measurements scale, fiducials align."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.ingest.rmf.building_file import Building, LevelPlan
from semmap.ingest.world import Skipped, WorldError


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


def align(building: Building) -> dict[str, Similarity]:
    """Return the transform from each level's drawing to the map's metres.

    The reference level is scaled by its measurements, the others are fitted to it by fiducials. As
    in Open-RMF, a level's own measurements count only where it is the reference level; here they
    also serve a level that shares fewer than two fiducials with it. A WorldError refuses a
    reference level without a measurement that can be used.
    """
    if not building.in_pixels:
        return {name: Similarity() for name in building.levels}
    reference = building.levels[building.reference_level]
    scale = _measured_scale(reference, building.skipped)
    if scale is None:
        raise WorldError(
            building.path,
            f"levels/{reference.name}/measurements",
            "has no usable measurement, so the size of a pixel is unknown",
            "Draw a measurement on the reference level in the traffic editor.",
        )
    aligned = {reference.name: Similarity(scale)}
    for name, plan in building.levels.items():
        if name == reference.name:
            continue
        common = [f for f in plan.fiducials if f in reference.fiducials]
        source = [plan.fiducials[f] for f in common]
        target = scale * np.array([reference.fiducials[f] for f in common]).reshape(-1, 2)
        try:
            if len(common) < 2:
                raise ValueError
            fit = fit_similarity(source, target)
            worst = float(np.linalg.norm(fit.apply(source) - target, axis=1).max())
            if worst > 0.1:
                problem = f"fiducials disagree with {reference.name} by up to {worst:.2f} m"
                building.notes.append(f"{name}: {problem}")
        except ValueError:
            fit = Similarity(_measured_scale(plan, building.skipped) or scale)
            problem = f"fewer than two fiducials in common with {reference.name}, not aligned"
            building.notes.append(f"{name}: {problem}")
        aligned[name] = fit
    return aligned


def _measured_scale(plan: LevelPlan, skipped: list[Skipped]) -> float | None:
    """Return the metres per pixel, the mean over a level's measurements; None without any."""
    scales = []
    for edge in plan.measurements:
        a, b = plan.vertices[edge.start], plan.vertices[edge.end]
        assert a is not None, "edges refer to usable vertices only"
        assert b is not None
        pixels = math.hypot(b.x - a.x, b.y - a.y)
        metres = edge.params.get("distance")
        if pixels > 0 and isinstance(metres, int | float) and metres > 0:
            scales.append(metres / pixels)
        else:
            problem = f"states {metres} m for {pixels:g} pixels"
            skipped.append(Skipped(edge.element, problem, "Measure again."))
    return float(np.mean(scales)) if scales else None
