"""The storeys of a world that states none: floors above each other on which things stand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.world import Entry, StoreyDetail

FOUND = "found"
"""The property of a storey that was found, not stated."""

WALKED = 12.0
"""Least area of a floor, square metres: that of a small room."""

APART = 2.0
"""Least height from a floor to the next, metres."""

SLAB = 0.5
"""Largest thickness of a floor, metres."""

CONTACT = 0.1
"""Metres between a floor and the bottom of what stands on it."""

FURNITURE = 0.3
"""Least height of what shows by standing there that a level is in use, metres."""

MANY = 3
"""So many things at one height, with no floor seen below, may have one."""


def found_storeys(entries: Sequence[Entry]) -> tuple[list[Entry], list[str]]:
    """The storeys that the geometry of a world shows, lowest first, and notes about them.

    A storey is a level face of `WALKED` square metres on which something stands; there are storeys
    where there are two of these, `APART` or more. Where things stand above each other and no floors
    are seen, a note asks for storeys.
    """
    boxes = np.array([box for entry in entries for box in _box(entry)]).reshape(-1, 2, 3)
    sizes = boxes[:, 1] - boxes[:, 0]
    furniture = boxes[(sizes[:, 2] >= FURNITURE) & (sizes[:, :2].min(axis=1) < APART)]
    bottoms = np.sort(furniture[:, 0, 2])
    floors = np.sort([level for entry in entries for level in _floors(entry)])
    levels = _apart([z for z in floors if np.abs(bottoms - z).min(initial=np.inf) <= CONTACT])
    if len(levels) > 1:
        storeys = []
        for number, (level, height) in enumerate(
            zip(levels, [*np.diff(levels), None], strict=True)
        ):
            detail, pose = StoreyDetail(level, height), Pose(z=level)
            found = {FOUND: True}
            storeys.append(
                Entry(f"storey_{number}", "storey", pose=pose, properties=found, detail=detail)
            )
        return storeys, [
            f"{len(levels)} storeys are found, with floors at {_metres(levels)} m: state storeys "
            "in a GeoJSON file to name them, or to correct their heights"
        ]
    levels = _apart([z for z in bottoms if (np.abs(bottoms - z) <= CONTACT / 2).sum() >= MANY])
    if len(levels) > 1:
        return [], [
            f"things stand at {_metres(levels)} m, and the file states no storeys: all are on one. "
            "If these are storeys, state them in a GeoJSON file (kind storey, elevation)"
        ]
    return [], []


def _box(entry: Entry) -> list[NDArray[np.float64]]:
    """The (2, 3) box of an object in the world, if it has a mesh."""
    pose = entry.pose or IDENTITY
    points = [pose.apply(mesh.used) for mesh in _meshes(entry)]
    ends = [(p.min(axis=0), p.max(axis=0)) for p in points]
    return [np.array([np.min(ends, axis=(0, 1)), np.max(ends, axis=(0, 1))])] if ends else []


def _meshes(entry: Entry) -> list[Mesh]:
    """The meshes of an object."""
    meshes = [shape.mesh for shape in entry.shapes if shape.mesh is not None]
    return [mesh for mesh in meshes if len(mesh.faces) and entry.kind == "object"]


def _floors(entry: Entry) -> Iterator[float]:
    """The heights at which an entry has level faces, up, of `WALKED` square metres in all."""
    if any(np.prod(high[:2] - low[:2]) < WALKED for low, high in _box(entry)):
        return
    for mesh in _meshes(entry):
        a, b, c = np.moveaxis((entry.pose or IDENTITY).apply(mesh.triangles), 1, 0)
        normals = np.cross(b - a, c - a)
        double = np.linalg.norm(normals, axis=1)
        level = np.abs(normals[:, 2]) >= 0.999 * np.maximum(double, 1e-12)
        heights = np.round(a[level, 2] / CONTACT).astype(np.int64)
        for bin_ in np.unique(heights):
            members = heights == bin_
            if double[level][members].sum() / 2 >= WALKED:
                yield float(np.median(a[level, 2][members]))


def _apart(heights: Sequence[float]) -> list[float]:
    """The heights, lowest first: of a slab its top, and none less than `APART` above another."""
    kept: list[float] = []
    for height in np.round(sorted(heights), 3):
        if kept and height - kept[-1] <= SLAB:
            kept[-1] = float(height)
        elif not kept or height - kept[-1] >= APART:
            kept.append(float(height))
    return kept


def _metres(levels: Sequence[float]) -> str:
    return ", ".join(f"{level:g}" for level in levels)
