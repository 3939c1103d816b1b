"""Support surfaces: level patches on which things can stand (Deeken et al., section 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from semmap.geometry.mesh import Mesh
from semmap.geometry.morphology import polygons, without_gaps, without_slivers
from semmap.geometry.parts import closed_parts

__all__ = ["LevelPatch", "support_surfaces"]


@dataclass(frozen=True, eq=False)
class LevelPatch:
    """A level patch in the mesh's frame.

    Attributes
    ----------
    height : z of the patch, metres (area-weighted mean of its faces)
    outline : what it covers on the ground
    area : square metres of `outline`
    faces : indices of its faces in the mesh
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
    """Table tops, boards, seats: upward, level, free above; the highest first.

    Parameters
    ----------
    min_area : square metres below which a patch is no support
    max_tilt : radians between a face and the level
    level : metres within which faces are of one height; also the gap that a patch may bridge, so
        that doubled vertices and T-junctions of meshes from the wild do not part it
    clearance : metres above a patch in which nothing of the mesh may lie: the underside of a board
        and a drawer's bottom are no support

    Notes
    -----
    Faces are taken together by height and by touching in projection, not by shared vertices.
    What the next level face above covers, looking up as well, is inside a solid and no support.
    A connected part whose volume is negative is turned inside out; its normals are taken the other
    way. Meshes from the wild mix both.
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


def _inside_out(mesh: Mesh) -> NDArray[np.bool_]:
    """(F,): whether a face belongs to a connected part that encloses a negative volume."""
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
    """Level faces of one height that look the same way."""

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
    """The faces by height, the lowest first."""
    return [
        _Layer(
            float(heights[group].min()),
            float(heights[group].max()),
            without_gaps(shapely.union_all(shapes[group]), level),
            group,
        )
        for group in _by_height(faces, heights, level)
    ]


def _free_above(
    layer: _Layer, ups: list[_Layer], downs: list[_Layer], clearance: float
) -> Polygon | MultiPolygon:
    """The part of a layer on which something can stand.

    Not where a face of the mesh lies within `clearance` above, nor where the next level face above
    looks up: there the layer is inside a solid, as a frame under its mattress.
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


def _by_height(
    faces: NDArray[np.intp], heights: NDArray[np.float64], level: float
) -> list[NDArray[np.intp]]:
    """Faces in groups whose heights follow each other without a gap wider than `level`."""
    if not len(faces):
        return []
    ordered = faces[np.argsort(heights[faces], kind="stable")]
    gaps = np.flatnonzero(np.diff(heights[ordered]) > level) + 1
    return np.split(ordered, gaps)
