"""What tests look at in the world of a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.world import Entry, World


def entry(world: World, name: str) -> Entry:
    (found,) = [e for e in world.entries if e.name == name]
    return found


def pose(world: World, name: str) -> Pose:
    """The pose of an entry in the map's frame."""
    found = entry(world, name)
    assert found.pose is not None
    above = IDENTITY if found.holder is None else pose(world, found.holder)
    return above @ found.pose


def points(world: World, name: str) -> NDArray[np.float64]:
    """The vertices of an entry in the map's frame."""
    (shape,) = entry(world, name).shapes
    assert shape.mesh is not None
    return pose(world, name).apply(shape.mesh.vertices)


def box(world: World, name: str) -> NDArray[np.float64]:
    """(2, 3) the lowest and highest corner of an entry in the map's frame."""
    found = points(world, name)
    return np.array([found.min(axis=0), found.max(axis=0)])
