"""A belief as a representation map: the probability of each place on the voxels above it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.belief.places import BeliefPlace, Surface
from semmap.fields.maps.grids import empty_grid
from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Properties

HEADROOM = 0.2
"""Metres above a surface that belong to its place."""


def belief_map(
    vocabulary: Properties,
    places: Iterable[BeliefPlace],
    belief: Mapping[str, float],
    *,
    about: str,
    voxel_size: float = 0.05,
    time: datetime | None = None,
) -> RepresentationMap:
    """Return a float32 map of the property ``probability``; `voxel_size` in metres.

    Each voxel up to `HEADROOM` above a surface of a place has the probability of that place, and
    each voxel of the box of a place that stores objects. Where places overlap, as furniture in a
    room, the more special one counts. *Elsewhere* has no voxels.
    """
    grid = empty_grid("float32", Lattice(voxel_size))
    for place in sorted(places, key=lambda place: place.kind != "room"):
        probability = belief.get(place.name, 0.0)
        for surface, height in _spaces(place):
            voxels = _voxels(surface, height, voxel_size)
            grid.set(voxels, np.full(len(voxels), probability, np.float32))
    return RepresentationMap(vocabulary["probability"], grid, about=about, time=time)


def _spaces(place: BeliefPlace) -> list[tuple[Surface, float]]:
    """The surfaces of a place, and the height above each that belongs to it."""
    found = [(surface, HEADROOM) for surface in place.surfaces]
    within = place.stores or not found
    if within and place.footprint is not None and place.low is not None and place.high is not None:
        height = float(place.high[2] - place.low[2])
        found.append((Surface(place.footprint, float(place.low[2])), height))
    return found


def _voxels(surface: Surface, height: float, voxel_size: float) -> NDArray[np.int32]:
    """(n, 3) the voxels whose centres are above an area, up to a height; one layer at least."""
    x0, y0, x1, y1 = (v / voxel_size for v in surface.outline.bounds)
    x, y = np.meshgrid(
        np.arange(np.floor(x0), np.ceil(x1)), np.arange(np.floor(y0), np.ceil(y1)), indexing="ij"
    )
    inside = shapely.contains_xy(
        surface.outline, (x.ravel() + 0.5) * voxel_size, (y.ravel() + 0.5) * voxel_size
    )
    columns = np.column_stack([x.ravel()[inside], y.ravel()[inside]])
    low = np.floor(surface.height / voxel_size + 1e-6)
    layers = low + np.arange(max(round(height / voxel_size), 1))
    return np.column_stack(
        [np.repeat(columns, len(layers), axis=0), np.tile(layers, len(columns))]
    ).astype(np.int32)
