"""The world that an occupancy grid of a SLAM program shows: walls, obstacles, where it ends."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely import MultiPolygon, Polygon

from navgrid.grid import FREE, OCCUPIED, UNKNOWN
from navgrid.map_file import MapFileError, read_map
from semmap.geometry.mesh import prism_mesh
from semmap.ingest.world import Entry, Shape, StoreyDetail, World, WorldError

Cells = NDArray[np.bool_]

WALL_HEIGHT, OBSTACLE_HEIGHT = 2.5, 1.0
"""Metres: assumed, since a scan is level."""

COARSE = 1.0
"""Metres of a cell, at least, that no robot maps with: its resolution is of another unit."""

SMALL = 1.0
"""Metres across connected occupied cells that are furniture, not a wall."""

THICK, LONGEST = 0.5, 3.0
"""Metres: what is as thick, and no longer, is furniture, too, but for a wall that goes on there."""

POCKET = 2.0
"""Square metres of the inside of furniture, at most, where a scanner sees its outline."""

LENGTH = 0.5
"""Metres of a wall, at least, that goes on behind furniture."""

_EIGHT = np.ones((3, 3), np.bool_)
_ROW = np.array([[0, 0, 0], [1, 1, 1], [0, 0, 0]])


def is_map_file(path: Path) -> bool:
    """Return whether a file names the image of an occupancy grid, as ``map.yaml`` does."""
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(4096)
    return re.search(rb"^image:", head, re.MULTILINE) is not None and b"resolution:" in head


def read_explored_map(path: Path) -> World:
    """Return the world of a ``map.yaml`` of Nav2: one storey of walls and obstacles.

    Occupied cells are walls, or obstacles where they are as small, or as thick, as furniture is.
    Unknown cells beside free ones are a border like a wall, so that no room and no route leads into
    what is not explored. Heights are assumed. A WorldError refuses a file that cannot be read, or
    is free everywhere.
    """
    try:
        grid, cells = read_map(path)
    except MapFileError as error:
        raise WorldError(path, error.element, error.problem, f"{error.fix}.") from error
    occupied = cells >= (OCCUPIED + FREE) // 2
    if not occupied.any():
        raise WorldError(path, "image", "has no occupied cell", "Give the map of a building.")
    walls = _walls(occupied, grid.resolution)
    border = (cells == UNKNOWN) & ndimage.binary_dilation(cells == FREE, _EIGHT)
    name = path.stem if path.stem != "map" else path.resolve().parent.name
    world = World(name, path)
    world.entries.append(Entry("ground", "storey", "storey", detail=StoreyDetail(0.0, WALL_HEIGHT)))
    for what, type_, mask, height in (
        ("walls", "wall", walls, WALL_HEIGHT),
        ("obstacles", None, occupied & ~walls, OBSTACLE_HEIGHT),
        ("unexplored", "wall", border, WALL_HEIGHT),
    ):
        if mask.any():
            outline = grid.area(mask)
            assert isinstance(outline, Polygon | MultiPolygon)
            entry = Entry(what, "object", type_, holder="ground")
            entry.shapes = [Shape("mesh", prism_mesh(outline, 0.0, height), outline)]
            world.entries.append(entry)
    world.notes.append(f"walls are {WALL_HEIGHT} m high, obstacles {OBSTACLE_HEIGHT} m: assumed")
    if grid.resolution > COARSE:
        world.notes.append(
            f"a cell is {grid.resolution:g} m wide: if its resolution is in millimetres, divide it "
            "by 1000"
        )
    return world


def _walls(occupied: Cells, resolution: float) -> Cells:
    """The occupied cells of walls: neither small nor thick, or in line with a wall beside them."""
    free, count = ndimage.label(~occupied)
    within = np.bincount(free.ravel(), minlength=count + 1) * resolution**2 < POCKET
    within[0] = False
    filled = occupied | within[free]
    reach = round(THICK / 2 / resolution)
    ball = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    thick = ndimage.binary_opening(filled, ball)
    thick &= ~_longer(thick, LONGEST / resolution)
    thin = occupied & ~thick
    return _longer((thin | _in_line(thin, thick, resolution)) & occupied, SMALL / resolution)


def _longer(cells: Cells, least: float) -> Cells:
    """The parts of cells, connected at sides or corners, of so many cells in one direction."""
    parts, _ = ndimage.label(cells, _EIGHT)
    spans = [max(s.stop - s.start for s in box) for box in ndimage.find_objects(parts)]
    found: Cells = (np.array([0, *spans]) >= least)[parts]
    return found


def _in_line(thin: Cells, thick: Cells, resolution: float) -> Cells:
    """The thick cells on which a wall goes on, along the two directions of most walls."""
    turn = _heading(thin)
    thin, there = (ndimage.rotate(c.astype(np.uint8), turn, order=0) > 0 for c in (thin, thick))
    found = np.zeros_like(there)
    for row in (_ROW, _ROW.T):
        long = ndimage.binary_opening(thin, row, iterations=round(LENGTH / resolution / 2))
        runs, _ = ndimage.label(there | long, row)
        found |= np.isin(runs, np.unique(runs[long])) & there
    back = ndimage.rotate(found.astype(np.uint8), -turn, order=0) > 0
    y, x = ((a - b) // 2 for a, b in zip(back.shape, thick.shape, strict=True))
    rows, columns = thick.shape
    wider: Cells = ndimage.binary_dilation(back[y : y + rows, x : x + columns], _EIGHT)
    return wider & thick


def _heading(cells: Cells) -> float:
    """By how many degrees, 0 to 90, the lines of an image are turned, most of them."""
    down, right = np.gradient(ndimage.gaussian_filter(cells.astype(np.float64), 1.0))
    headings = np.degrees(np.arctan2(down, right)) % 90
    counts, _ = np.histogram(headings, 180, (0, 90), weights=np.hypot(down, right))
    return float(ndimage.gaussian_filter1d(counts, 1, mode="wrap").argmax() / 2 + 0.25)
