"""The storeys of a world that states none: floors above each other on which things stand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.geometry.extent import extent
from semmap.geometry.levels import (
    APART,
    CONTACT,
    SLAB,
    WALKED,
    WIDE,
    in_metres,
    is_furniture,
    separate,
    standing_levels,
)
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.world import Entry, StoreyDetail, poses_in_map

ASSUMED_HEIGHT = 3.0
"""Metres from storey to storey where a format numbers levels and has no heights."""

PARTS = frozenset({"wall", "window", "door_leaf", "ceiling", "roof"})
"""Types of objects that stand on no floor of their own, as lintels do."""

FOUND = "found"
"""The property of a storey that was found, not stated."""

MOST = 1 / 4
"""Part of the area of the largest floor in use that each has at least: shelves and platforms have
less."""


class Level(NamedTuple):
    """A level face of an object: its height, its area and its narrow side, metres."""

    z: float
    area: float
    width: float


def found_storeys(entries: Sequence[Entry]) -> tuple[list[Entry], list[str]]:
    """The storeys that the geometry of a world shows, lowest first, and notes about them.

    A storey is a level face of `WALKED` square metres on which something stands; there are storeys
    where there are two of these, `APART` or more. A narrow or small one, as of a rack, is none.
    Where things stand above each other and no storeys are found, a note asks for them, as where
    floors, as of half levels, are too near to be storeys.
    """
    solid, poses = [entry for entry in entries if meshes_of(entry)], poses_in_map(entries)
    boxes = np.array([box_of(entry, poses[entry.name]) for entry in solid]).reshape(-1, 2, 3)
    floors = [[*level_faces(entry, poses[entry.name])] for entry in solid]
    bottoms = np.sort(boxes[is_furniture(boxes), 0, 2])
    levels, between = _storey_levels([level for faces in floors for level in faces], bottoms)
    halves = [
        f"things stand on floors at {in_metres(between)}, less than {APART:g} m above others: they "
        "belong to the storeys below. If they are storeys, state these in a GeoJSON file"
    ] * bool(between)
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
            f"{len(levels)} storeys are found, with floors at {in_metres(levels)}: state storeys "
            "in a GeoJSON file to name them, or to correct their heights",
            *halves,
        ]
    walked = [any(level.width >= WIDE for level in faces) for faces in floors]
    parts = np.array([entry.type in PARTS for entry in solid], np.bool_)
    levels = standing_levels(boxes, np.array(walked, np.bool_), parts)
    if len(levels) > 1:
        return [], [
            f"things stand at {in_metres(levels)}, and the file states no storeys: all are on one. "
            "If these are storeys, state them in a GeoJSON file (kind storey, elevation)"
        ]
    return [], halves


def _storey_levels(
    floors: Sequence[Level], bottoms: NDArray[np.float64]
) -> tuple[list[float], list[float]]:
    """The heights of floors that are storeys, and of those between; none above what stands lower.

    A floor between is less than `APART` above a storey, and more than the thickness of a slab.
    """
    if not floors:
        return [], []
    heights, areas, widths = np.array(floors).T
    together = (np.abs(heights[:, None] - heights) <= CONTACT / 2) @ areas
    used = np.array([np.abs(bottoms - z).min(initial=np.inf) <= CONTACT for z in heights])
    large = together >= MOST * together[used].max(initial=0)
    wide = heights[used & large & (widths >= WIDE)]
    levels = separate(wide)
    if levels and bottoms[0] < levels[0] - APART:
        return [], []
    above = [(z, z - max(level for level in [-np.inf, *levels] if level <= z)) for z in wide]
    between = {round(float(z), 2) for z, gap in above if SLAB < gap < APART}
    return levels, sorted(between)


def box_of(entry: Entry, pose: Pose) -> NDArray[np.float64]:
    """The (2, 3) box in the map of an object that has a mesh, and a pose there."""
    return np.array(extent(np.concatenate([pose.apply(m.used) for m in meshes_of(entry)])))


def meshes_of(entry: Entry) -> list[Mesh]:
    """The meshes of an object."""
    meshes = [shape.mesh for shape in entry.shapes if shape.mesh is not None]
    return [mesh for mesh in meshes if len(mesh.faces) and entry.kind == "object"]


def level_faces(entry: Entry, pose: Pose) -> Iterator[Level]:
    """The level faces of an entry at a pose, up, that have `WALKED` square metres in all."""
    low, high = box_of(entry, pose)
    if np.prod(high[:2] - low[:2]) < WALKED:
        return
    for mesh in meshes_of(entry):
        a, b, c = np.moveaxis(pose.apply(mesh.triangles), 1, 0)
        normals = np.cross(b - a, c - a)
        double = np.linalg.norm(normals, axis=1)
        level = np.abs(normals[:, 2]) >= 0.999 * np.maximum(double, 1e-12)
        heights = np.round(a[level, 2] / CONTACT).astype(np.int64)
        for bin_ in np.unique(heights):
            members = heights == bin_
            up = normals[level, 2][members] / 2
            area = max(up[up > 0].sum(), -up[up < 0].sum())  # of a thin plate one side
            if area >= WALKED:
                corners = np.concatenate([p[level][members] for p in (a, b, c)])
                yield Level(float(np.median(a[level, 2][members])), float(area), _width(corners))


def _width(corners: NDArray[np.float64]) -> float:
    """The narrow side of the rectangle around points."""
    around = shapely.MultiPoint(corners[:, :2]).minimum_rotated_rectangle
    sides = np.diff(shapely.get_coordinates(around)[:3], axis=0)
    return float(np.linalg.norm(sides, axis=1).min(initial=np.inf))
