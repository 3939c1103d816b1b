"""One frame for the levels of an Open-RMF building: measurements scale, fiducials align."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from semmap.ingest.rmf.building_file import Building, LevelPlan, Vertex
from semmap.ingest.rmf.similarity import Similarity, fit_similarity
from semmap.ingest.world import Skipped, WorldError


@dataclass
class Alignment:
    """The transform from the drawing of each level to the map's metres."""

    levels: dict[str, Similarity]
    notes: list[str] = field(default_factory=list)


def align(building: Building) -> Alignment:
    """The reference level is scaled by its measurements, the others are fitted to it.

    As in Open-RMF, a level's own measurements count only where it is the reference level; here they
    also serve a level that shares fewer than two fiducials with it. A WorldError refuses a
    reference level without a measurement that can be used.
    """
    if not building.in_pixels:
        return Alignment({name: Similarity() for name in building.levels})
    reference = building.levels[building.reference_level]
    scale = _measured_scale(reference, building.skipped)
    if scale is None:
        raise WorldError(
            building.path,
            f"levels/{reference.name}/measurements",
            "has no usable measurement, so the size of a pixel is unknown",
            "Draw a measurement on the reference level in the traffic editor.",
        )
    aligned = Alignment({reference.name: Similarity(scale)})
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
                aligned.notes.append(
                    f"{name}: fiducials disagree with {reference.name} by up to {worst:.2f} m"
                )
        except ValueError:
            fit = Similarity(_measured_scale(plan, building.skipped) or scale)
            aligned.notes.append(
                f"{name}: fewer than two fiducials in common with {reference.name}, not aligned"
            )
        aligned.levels[name] = fit
    return aligned


def _measured_scale(plan: LevelPlan, skipped: list[Skipped]) -> float | None:
    """Return the metres per pixel, the mean over a level's measurements; None without any."""
    scales = []
    for edge in plan.measurements:
        a, b = _vertex(plan, edge.start), _vertex(plan, edge.end)
        pixels = math.hypot(b.x - a.x, b.y - a.y)
        metres = edge.params.get("distance")
        if pixels > 0 and isinstance(metres, int | float) and metres > 0:
            scales.append(metres / pixels)
        else:
            skipped.append(
                Skipped(edge.element, f"states {metres} m for {pixels:g} pixels", "Measure again.")
            )
    return float(np.mean(scales)) if scales else None


def _vertex(plan: LevelPlan, index: int) -> Vertex:
    vertex = plan.vertices[index]
    assert vertex is not None, "edges refer to usable vertices only"
    return vertex
