"""The world that an occupancy grid of a SLAM program shows: walls, obstacles, where it ends."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from scipy import ndimage
from shapely import MultiPolygon, Polygon

from navgrid.grid import FREE, OCCUPIED, UNKNOWN
from navgrid.map_file import MapFileError, read_map
from semmap.geometry.mesh import prism_mesh
from semmap.ingest.world import Entry, Shape, StoreyDetail, World, WorldError

WALL_HEIGHT, OBSTACLE_HEIGHT = 2.5, 1.0
"""Metres: assumed, since a scan is level."""

SMALL = 1.0
"""Metres across connected occupied cells that are furniture, not a wall."""

_EIGHT = np.ones((3, 3), np.bool_)


def is_map_file(path: Path) -> bool:
    """Return whether a file names the image of an occupancy grid, as ``map.yaml`` does."""
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(4096)
    return re.search(rb"^image:", head, re.MULTILINE) is not None and b"resolution:" in head


def read_explored_map(path: Path) -> World:
    """Return the world of a ``map.yaml`` of Nav2: one storey of walls and obstacles.

    Connected occupied cells are walls, of less than `SMALL` metres obstacles. Unknown cells beside
    free ones are a border like a wall, so that no room and no route leads into what is not
    explored. Heights are assumed. A WorldError refuses a file that cannot be read, or is free
    everywhere.
    """
    try:
        grid, cells = read_map(path)
    except MapFileError as error:
        raise WorldError(path, error.element, error.problem, f"{error.fix}.") from error
    occupied = cells >= (OCCUPIED + FREE) // 2
    if not occupied.any():
        raise WorldError(path, "image", "has no occupied cell", "Give the map of a building.")
    parts, count = ndimage.label(occupied, _EIGHT)
    spans = np.array([[s.stop - s.start for s in box] for box in ndimage.find_objects(parts)])
    small = np.zeros(count + 1, np.bool_)
    small[1:] = spans.max(axis=1) * grid.resolution < SMALL
    border = (cells == UNKNOWN) & ndimage.binary_dilation(cells == FREE, _EIGHT)
    name = path.stem if path.stem != "map" else path.resolve().parent.name
    world = World(name, path)
    world.entries.append(Entry("ground", "storey", "storey", detail=StoreyDetail(0.0, WALL_HEIGHT)))
    for what, type_, mask, height in (
        ("walls", "wall", occupied & ~small[parts], WALL_HEIGHT),
        ("obstacles", None, small[parts], OBSTACLE_HEIGHT),
        ("unexplored", "wall", border, WALL_HEIGHT),
    ):
        if mask.any():
            outline = grid.area(mask)
            assert isinstance(outline, Polygon | MultiPolygon)
            entry = Entry(what, "object", type_, holder="ground")
            entry.shapes = [Shape("mesh", prism_mesh(outline, 0.0, height), outline)]
            world.entries.append(entry)
    world.notes.append(f"walls are {WALL_HEIGHT} m high, obstacles {OBSTACLE_HEIGHT} m: assumed")
    return world
