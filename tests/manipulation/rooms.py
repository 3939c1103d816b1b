"""The small house as triangles, and a place on its kitchen table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import join
from semmap.geometry.surfaces import support_surfaces
from semmap.ingest.sdf.world_file import read_sdf


class Kitchen(NamedTuple):
    triangles: NDArray[np.float64]
    top: object  # LevelPatch of the table's top, in the map's frame


def kitchen(worlds) -> Kitchen:
    world = read_sdf(worlds / "small_house" / "worlds" / "small_house.world")
    meshes = {
        e.name: join([s.mesh.moved(e.pose) for s in e.shapes if s.mesh is not None])
        for e in world.entries
        if any(s.mesh is not None for s in e.shapes)
    }
    tops = support_surfaces(meshes["KitchenTable_01_001"])
    everything = join(list(meshes.values()))
    return Kitchen(everything.triangles, max(tops, key=lambda s: s.area))


def standing(shape_height: float, top, x: float = 0.0, y: float = 0.0):
    """The pose of an object that stands near the middle of a surface."""
    pose = np.eye(4)
    centre = top.outline.centroid
    pose[:3, 3] = centre.x + x, centre.y + y, top.height + shape_height / 2 + 5e-4
    return pose
