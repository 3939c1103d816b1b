"""Support surfaces: level patches on which objects can stand (Deeken et al., section 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from semmap.geometry.mesh import Mesh
from semmap.geometry.morphology import polygons, without_gaps, without_slivers
from semmap.geometry.parts import closed_parts

RIM = 0.02
"""Metres below the top of an object from which on a level of it is inside of the object."""


@dataclass(frozen=True, eq=False)
class LevelPatch:
    """A level patch in the mesh's frame: z in metres, outline from above, square metres, faces.

    The height is the area-weighted mean of its faces, which are indices in the mesh.
    """

    height: float
    outline: Polygon
    area: float
    faces: NDArray[np.intp]


def support_surfaces(
    mesh: Mesh,
    *,
    min_area: float = 0.02,
    max_tilt: float = math.radians(5),
    level: float = 0.005,
    clearance: float = 0.04,
) -> list[LevelPatch]:
    """Return table tops, boards, seats: upward, level, free above; the highest first.

    Faces tilted by up to `max_tilt` radians are of one height within `level` metres, which is also
    the gap that a patch may bridge: real meshes have doubled vertices and T-junctions. `clearance`
    metres above a patch are free, so that undersides of boards are none, and `min_area` square
    metres its least area. Where the next level face above also faces up, the patch is inside a
    solid. The normals of a connected part with a negative volume are reversed: real meshes mix both
    orientations.
    """
    if not len(mesh.faces):
        return []
    triangles = mesh.triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    upward = np.where(_inside_out(mesh), -normals[:, 2], normals[:, 2])
    flat = np.abs(upward) >= math.cos(max_tilt) * np.maximum(doubled, 1e-14)
    heights = triangles[:, :, 2].mean(axis=1)
    shapes = shapely.polygons(triangles[:, :, :2])
    solid = flat & (doubled > 1e-10)
    ups = _layers(np.flatnonzero(solid & (upward > 0)), heights, shapes, level)
    downs = _layers(np.flatnonzero(solid & (upward < 0)), heights, shapes, level)

    found = []
    for layer in ups:
        if layer.outline.area < min_area:
            continue
        free = _free_above(layer, ups, downs, clearance)
        tree = STRtree(shapely.centroid(shapes[layer.faces]))
        for outline in polygons(without_slivers(free, level / 2)):
            if outline.area < min_area:
                continue
            own = layer.faces[np.sort(tree.query(outline, predicate="intersects"))]
            faces = own if len(own) else layer.faces
            height = float(np.average(heights[faces], weights=doubled[faces]))
            found.append(LevelPatch(height, outline, float(outline.area), faces))
    return sorted(found, key=lambda s: (-s.height, -s.area))


class Levels(NamedTuple):
    """Which levels of a mesh count: between two heights; `inside` of it alone, not its top."""

    heights: tuple[float, float] = (-math.inf, math.inf)
    inside: bool = False

    def of(self, mesh: Mesh) -> list[LevelPatch]:
        """Those of the support surfaces of a mesh."""
        low, high = self.heights
        top = mesh.triangles[..., 2].max(initial=-math.inf) - RIM if self.inside else math.inf
        found = support_surfaces(mesh)
        return [level for level in found if low <= level.height <= high and level.height < top]


ANY_LEVEL = Levels()


def _inside_out(mesh: Mesh) -> NDArray[np.bool_]:
    """Return (F,) whether each face is in a connected part with a negative volume."""
    part, _ = closed_parts(mesh)
    # Volumes from each part's own middle: an open sheet then encloses nothing, wherever it lies.
    triangles = mesh.triangles
    count = np.bincount(part)
    middle = np.column_stack(
        [
            np.bincount(part, triangles[:, :, k].mean(axis=1)) / np.maximum(count, 1)
            for k in range(3)
        ]
    )
    a, b, c = np.moveaxis(triangles - middle[part][:, None], 1, 0)
    volume = np.bincount(part, np.einsum("ij,ij->i", a, np.cross(b, c)))
    area = np.bincount(part, np.linalg.norm(np.cross(b - a, c - a), axis=1))
    turned: NDArray[np.bool_] = (volume < -1e-6 * area**1.5)[part]
    return turned


@dataclass(frozen=True, eq=False)
class _Layer:
    """Level faces of one height with the same orientation."""

    low: float
    high: float
    outline: Polygon | MultiPolygon
    faces: NDArray[np.intp]


def _layers(
    faces: NDArray[np.intp],
    heights: NDArray[np.float64],
    shapes: NDArray[np.object_],
    level: float,
) -> list[_Layer]:
    """Return the faces in groups whose heights have no gap wider than `level`, the lowest first."""
    if not len(faces):
        return []
    ordered = faces[np.argsort(heights[faces], kind="stable")]
    gaps = np.flatnonzero(np.diff(heights[ordered]) > level) + 1
    return [
        _Layer(
            float(heights[group].min()),
            float(heights[group].max()),
            without_gaps(shapely.union_all(shapes[group]), level),
            group,
        )
        for group in np.split(ordered, gaps)
    ]


def _free_above(
    layer: _Layer, ups: list[_Layer], downs: list[_Layer], clearance: float
) -> Polygon | MultiPolygon:
    """Return the part of a layer on which an object can stand.

    Excluded are areas with a face of the mesh within `clearance` above, and areas whose next level
    face above faces up: there the layer is inside a solid, like a frame under its mattress.
    """
    free = layer.outline
    unseen = layer.outline
    above = sorted(
        [(other.low, True, other) for other in ups if other.low > layer.high]
        + [(other.low, False, other) for other in downs if other.low > layer.high],
        key=lambda item: item[:2],
    )
    for low, looks_up, other in above:
        if unseen.is_empty:
            break
        met = unseen.intersection(other.outline)
        if met.area < 1e-4:
            continue
        if looks_up or low < layer.high + clearance:
            free = free.difference(met)
        unseen = unseen.difference(met)
    return free
