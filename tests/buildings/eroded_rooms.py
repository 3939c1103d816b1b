"""A second segmentation to compare with: the morphological one of Bormann et al. (ICRA 2016).

Section III-A: free space is eroded; what falls apart into parts as large as eroded rooms is taken,
and grows back to the walls. It finds no doorways, and is told what is outside.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from navgrid.found_rooms import (
    RESOLUTION,
    FoundRoom,
    FoundRooms,
    outline_of_cells,
    scene_walls,
    turned_cells,
    turned_points,
)
from semmap.query.storey_scene import StoreyScene

SMALLEST, LARGEST = 0.2, 2.0
"""Square metres of a room that is eroded; these are best for random buildings."""

CROSS = ndimage.generate_binary_structure(2, 1)


def eroded_rooms(scene: StoreyScene, building: shapely.Geometry) -> FoundRooms:
    """Return the rooms between the walls of a storey, within the outline of its building."""
    turn, grid, walls, _ = turned_cells(scene_walls(scene), scene.elevation, RESOLUTION)
    at = (np.argwhere(~walls)[:, ::-1] + 0.5) * RESOLUTION + grid.origin
    free = ~walls
    free[free] = shapely.contains_xy(building, turned_points(at, turn))
    labels = segments(free)
    outlines = [outline_of_cells(labels == number, grid) for number in range(1, labels.max() + 1)]
    rooms = tuple(
        FoundRoom(
            str(number), shapely.transform(each, lambda xy: turned_points(xy, turn)), None, 1.0
        )
        for number, each in enumerate(outlines)
        if each is not None
    )
    return FoundRooms(scene.storey, scene.elevation, rooms)


def segments(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Number the rooms of free cells."""
    clearance = ndimage.distance_transform_edt(free, sampling=RESOLUTION)
    labels = np.zeros(free.shape, np.int32)
    for depth in np.arange(0, clearance.max(initial=0), RESOLUTION):
        parts, count = ndimage.label((clearance > depth) & (labels == 0))
        areas = np.bincount(parts.ravel(), minlength=count + 1) * RESOLUTION**2
        is_room = (areas >= SMALLEST) & (areas <= LARGEST)
        is_room[0] = False
        numbers = np.where(is_room, labels.max() + np.cumsum(is_room), 0)
        labels = np.where(is_room[parts], numbers[parts], labels).astype(np.int32)
    while True:
        grown = np.where(free & (labels == 0), ndimage.grey_dilation(labels, footprint=CROSS), 0)
        if not grown.any():
            return labels
        labels += grown.astype(np.int32)
