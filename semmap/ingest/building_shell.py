"""Buildings in one mesh: walls around a floor on which other objects stand."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.geometry.floor import section
from semmap.geometry.levels import CONTACT, WALKED, WIDE, is_furniture
from semmap.geometry.pose import Pose
from semmap.ingest.annotation.feature_values import supertypes
from semmap.ingest.naming import GUESS
from semmap.ingest.storeys import box_of, level_faces, meshes_of
from semmap.ingest.world import Entry, poses_in_map

SHELL, CONFIDENCE = "building_shell", 0.7

KEPT = frozenset({"building_element", "vehicle", "storage_furniture"})
"""Types whose subtypes also have floors and sides, and stay, except for a building as one thing."""

AT = 1.0
"""Metres above a floor of the section through walls."""

UPRIGHT = 0.1
"""Greatest part of a wall's normal along z."""

AROUND = 0.75
"""Length of the walls in a section, at least, as a part of the border around them."""


def recognise_shells(entries: Sequence[Entry]) -> None:
    """Give the type `building_shell` to objects that are a building, whatever their name suggests.

    A shell is one object with a level floor of `WALKED` square metres, walls around it, and
    something of the size of furniture that stands on the floor between them. A stated type stays.
    """
    solid = [entry for entry in entries if meshes_of(entry)]
    poses = poses_in_map(entries)
    boxes = np.array([box_of(entry, poses[entry.name]) for entry in solid]).reshape(-1, 2, 3)
    furniture = boxes[is_furniture(boxes)]
    sizes = np.ptp(boxes, axis=1)
    large = (sizes[:, :2].min(axis=1) >= WIDE) & (sizes[:, 2] >= 2 * AT)
    for entry in [solid[i] for i in np.flatnonzero(large)]:
        if _may_be_shell(entry) and _is_shell(entry, poses[entry.name], furniture):
            entry.type = SHELL
            entry.properties[GUESS] = {"type": SHELL, "confidence": CONFIDENCE}


def _may_be_shell(entry: Entry) -> bool:
    guess = entry.properties.get(GUESS, {}).get("type")
    if entry.type in (None, "object") or guess == entry.type == "house":
        return True
    return guess == entry.type and KEPT.isdisjoint(supertypes(guess))


def _is_shell(entry: Entry, pose: Pose, furniture: NDArray[np.float64]) -> bool:
    triangles = pose.apply(np.concatenate([mesh.triangles for mesh in meshes_of(entry)]))
    for z in {level.z for level in level_faces(entry, pose)}:
        standing = furniture[np.abs(furniture[:, 0, 2] - z) <= CONTACT]
        if len(standing) and _encloses(_wall_lines(triangles, z + AT), standing):
            return True
    return False


def _wall_lines(triangles: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """The lines (N, 2, 2) in which a level plane cuts upright triangles (M, 3, 3)."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    upright = np.abs(normals[:, 2]) <= UPRIGHT * np.linalg.norm(normals, axis=1)
    return section(triangles[upright], height)[0]


def _encloses(lines: NDArray[np.float64], boxes: Iterable[NDArray[np.float64]]) -> bool:
    """Whether walls stand around the middle of one of the boxes (N, 2, 3)."""
    around = shapely.MultiPoint(lines.reshape(-1, 2)).convex_hull
    length = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum()
    if around.area < WALKED or length < AROUND * around.length:
        return False
    return any(around.contains(shapely.Point(box[:, :2].mean(axis=0))) for box in boxes)
