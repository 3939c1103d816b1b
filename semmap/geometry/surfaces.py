"""Support surfaces: level patches on which things can stand (Deeken et al., section 3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from semmap.geometry.mesh import Mesh

__all__ = ["Surface", "support_surfaces"]


@dataclass(frozen=True, eq=False)
class Surface:
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
) -> list[Surface]:
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
    A mesh whose volume is negative is turned inside out, and its normals are taken the other way.
    """
    if not len(mesh.faces):
        return []
    triangles = mesh.triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    volume = np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
    upward = normals[:, 2] if volume >= 0 else -normals[:, 2]
    flat = np.abs(upward) >= math.cos(max_tilt) * np.maximum(doubled, 1e-14)
    up = np.flatnonzero(flat & (upward > 0) & (doubled > 1e-10))
    heights = triangles[:, :, 2].mean(axis=1)
    shapes = shapely.polygons(triangles[:, :, :2])
    lids = np.flatnonzero(flat & (doubled > 1e-10))
    lids = lids[np.argsort(heights[lids])]

    found = []
    for group in _by_height(up, heights, level):
        merged = _merge(shapes[group], level)
        top = float(heights[group].max())
        first, last = np.searchsorted(heights[lids], [top + level, top + clearance])
        if first < last:
            merged = merged.difference(_merge(shapes[lids[first:last]], level))
        tree = STRtree(shapely.centroid(shapes[group]))
        for outline in _parts(merged):
            if outline.area < min_area:
                continue
            own = group[np.sort(tree.query(outline, predicate="intersects"))]
            if len(own):
                height = float(np.average(heights[own], weights=doubled[own]))
                found.append(Surface(height, outline, float(outline.area), own))
    return sorted(found, key=lambda s: (-s.height, -s.area))


def _by_height(
    faces: NDArray[np.intp], heights: NDArray[np.float64], level: float
) -> list[NDArray[np.intp]]:
    """Faces in groups whose heights follow each other without a gap wider than `level`."""
    if not len(faces):
        return []
    ordered = faces[np.argsort(heights[faces], kind="stable")]
    gaps = np.flatnonzero(np.diff(heights[ordered]) > level) + 1
    return np.split(ordered, gaps)


def _merge(shapes: NDArray[np.object_], gap: float) -> Polygon | MultiPolygon:
    """The union of polygons, with gaps narrower than `gap` closed."""
    grown = shapely.union_all(shapely.buffer(shapes, gap / 2, join_style="mitre", quad_segs=1))
    return grown.buffer(-gap / 2, join_style="mitre").buffer(0)


def _parts(shape: Polygon | MultiPolygon) -> list[Polygon]:
    return [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"]
