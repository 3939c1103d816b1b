"""The world that an occupancy grid of a SLAM program shows: walls, obstacles, where it ends."""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import MultiPolygon

from navgrid.door_leaves import door_leaves
from navgrid.grid import FREE, OCCUPIED, UNKNOWN, Grid
from navgrid.map_file import MapFileError, read_map
from navgrid.room_segments import wall_gaps, wall_heading
from semmap.geometry.cell_outline import cell_outline
from semmap.geometry.mesh import prism_mesh
from semmap.ingest.world import Entry, Shape, StoreyDetail, World, WorldError
from semmap.limits import CONFIG_BYTES, EXTENT, MAP_EDGES

Cells = NDArray[np.bool_]

WALL_HEIGHT, OBSTACLE_HEIGHT = 2.5, 1.0
"""Metres: assumed, since a scan is level."""

FINE = 0.005
"""Metres of a cell, at least: what takes pieces of walls takes minutes with more cells of them."""

COARSE = 1.0
"""Metres of a cell, at least, that no robot maps with: its resolution is of another unit."""

THICK, LONGEST = 0.5, 3.0
"""Metres: what is as thick, and no longer, is furniture, but for a wall that goes on there; so is
what stands alone and is no longer, but for a wall between two doorways."""

POCKET = 2.0
"""Square metres of the inside of furniture, at most, where a scanner sees its outline."""

LARGEST = 5.0
"""Square metres of the largest furniture, of which a scanner sees the sides."""

BORDER = 0.15
"""Metres of unknown cells beside free ones that are as solid as walls: their insides, seen from
both sides."""

LENGTH = 0.5
"""Metres of a wall, at least, that goes on behind furniture."""

STRAIGHT = 0.5
"""Metres along a wall whose cells are straightened, where walls are turned from rows of cells."""

_EIGHT = np.ones((3, 3), np.bool_)
_KEYS = re.compile(rb"(?<![\w-])(image|resolution|levels)['\"]?\s*:")
"""Keys of a map, and the one that each building.yaml has, in any style of YAML."""

_ROW = np.array([[0, 0, 0], [1, 1, 1], [0, 0, 0]])


def is_map_file(path: Path) -> bool:
    """Return whether a file names the image of an occupancy grid, as ``map.yaml`` does."""
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file():
        return False
    with path.open("rb") as file:
        text = file.read(int(CONFIG_BYTES.value))
    return {*_KEYS.findall(text)} == {b"image", b"resolution"}


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
    if grid.resolution < FINE:
        problem = f"is {grid.resolution:g}: a cell is narrower than {FINE} m"
        raise WorldError(path, "resolution", problem, "Give metres of a cell.")
    end = np.add(grid.origin, np.multiply(cells.shape[::-1], grid.resolution))
    reach = float(np.abs(np.stack([grid.origin, end])).max())
    refused = partial(WorldError, path, "image")
    EXTENT.check(reach, refused, "Give metres of a cell, not millimetres.", "reaches")
    occupied = cells >= (OCCUPIED + FREE) // 2
    if not occupied.any():
        raise WorldError(path, "image", "has no occupied cell", "Give the map of a building.")
    unknown = cells == UNKNOWN
    near = unknown & ndimage.binary_dilation(
        cells == FREE, _EIGHT, iterations=max(1, round(BORDER / grid.resolution))
    )
    edges = sum(int(np.diff(occupied | near, axis=axis).sum()) for axis in (0, 1))
    MAP_EDGES.check(edges, refused, "Remove single cells from the image.")
    leaves = door_leaves(occupied | near, grid.resolution)
    walls = _walls((occupied | near) & ~leaves, unknown, grid)
    y, x = np.nonzero(occupied)
    at = (np.stack([x, y]) + 0.5) * grid.resolution + np.array(grid.origin)[:, None]
    obstacles = occupied.copy()
    obstacles[occupied] = ~shapely.contains_xy(walls.buffer(grid.resolution / 2), *at)
    border = near & ~leaves & ~_pockets(unknown, occupied, obstacles, grid.resolution)
    name = path.stem if path.stem != "map" else path.resolve().parent.name
    world = World(name, path)
    world.entries.append(Entry("ground", "storey", "storey", detail=StoreyDetail(0.0, WALL_HEIGHT)))
    for what, type_, outline, height in (
        ("walls", "wall", walls, WALL_HEIGHT),
        ("obstacles", None, grid.area(obstacles), OBSTACLE_HEIGHT),
        ("unexplored", "wall", grid.area(border), WALL_HEIGHT),
    ):
        if not outline.is_empty:
            entry = Entry(what, "object", type_, holder="ground", properties={"scanned": True})
            entry.shapes = [Shape("mesh", prism_mesh(outline, 0.0, height), outline)]
            world.entries.append(entry)
    world.notes.append(f"walls are {WALL_HEIGHT} m high, obstacles {OBSTACLE_HEIGHT} m: assumed")
    if grid.resolution > COARSE:
        world.notes.append(
            f"a cell is {grid.resolution:g} m wide: if its resolution is in millimetres, divide it "
            "by 1000"
        )
    return world


def _walls(occupied: Cells, unknown: Cells, grid: Grid) -> MultiPolygon:
    """The outline of walls: neither alone nor thick, or in line with a wall beside them."""
    turn = wall_heading(occupied)
    turned, hidden = occupied, unknown
    if abs(turn) * max(occupied.shape) > 1:
        cells, hidden = (
            ndimage.rotate(each.astype(np.uint8), math.degrees(turn), order=0) > 0
            for each in (occupied, unknown)
        )
        turned = _straightened(cells, grid.resolution)
    walls = _fixed(_thin(turned, hidden, grid.resolution), grid.resolution)
    size = grid.resolution
    middle = [np.array(cells.shape[::-1]) * size / 2 for cells in (turned, occupied)]
    outline = shapely.transform(cell_outline(walls), lambda xy: xy * size - middle[0])
    outline = shapely.affinity.rotate(outline, turn, origin=(0, 0), use_radians=True)
    return shapely.transform(outline, lambda xy: xy + middle[1] + grid.origin)


def _pockets(unknown: Cells, occupied: Cells, obstacles: Cells, resolution: float) -> Cells:
    """The unknown cells within furniture: small parts, beside more obstacles than walls."""
    parts, count = ndimage.label(unknown)
    small = np.bincount(parts.ravel(), minlength=count + 1) * resolution**2 < LARGEST
    small[0] = False
    grown = ndimage.grey_dilation(np.where(small[parts], parts, 0), size=(3, 3))
    beside, things = (
        np.bincount(grown[mask], minlength=count + 1) for mask in (occupied, obstacles)
    )
    found: Cells = (small & (things > beside / 2))[parts]
    return found


def _straightened(cells: Cells, resolution: float) -> Cells:
    """Cells as most of those beside them are, along rows or columns; others where no wall is."""
    window = max(1, round(STRAIGHT / resolution))
    straight = np.zeros_like(cells)
    for axis in (0, 1):
        straight |= ndimage.uniform_filter1d(cells.astype(np.float32), window, axis=axis) > 0.5
    apart: Cells = cells & ~ndimage.binary_dilation(straight, _EIGHT, iterations=2)
    return straight | apart


def _thin(occupied: Cells, unknown: Cells, resolution: float) -> Cells:
    """The occupied cells without furniture that is as thick as no wall."""
    free, count = ndimage.label(~occupied)
    areas = np.bincount(free.ravel(), minlength=count + 1) * resolution**2
    hidden = ndimage.mean(unknown, free, np.arange(count + 1)) > 0.95
    within = areas < np.where(hidden, LARGEST, POCKET)
    within[0] = False
    filled = occupied | within[free]
    reach = round(THICK / 2 / resolution)
    ball = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    thick = ndimage.binary_opening(filled, ball)
    thick = ndimage.binary_dilation(thick, _EIGHT, iterations=2, mask=filled)  # with its corners
    parts, _ = ndimage.label(thick, _EIGHT)
    thick &= ~_long(parts, resolution)[parts]
    thin: Cells = occupied & ~thick
    return (thin | _in_line(thin, thick, resolution)) & occupied


def _fixed(cells: Cells, resolution: float) -> Cells:
    """The parts of cells that are long, or joined with such a one by doorways."""
    parts, count = ndimage.label(cells, _EIGHT)
    joins = [parts[tuple(ends.astype(int).T)] for _, ends, _ in wall_gaps(cells, cells, resolution)]
    a, b = np.array(joins, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count + 1, count + 1))
    _, group = connected_components(graph, directed=False)
    found: Cells = np.isin(group, group[_long(parts, resolution)])[parts] & cells
    return found


def _long(parts: NDArray[np.int32], resolution: float) -> Cells:
    """Whether each part, the first of which is none, is as long as no furniture is."""
    spans = [max(s.stop - s.start for s in box) for box in ndimage.find_objects(parts)]
    return np.array([0, *spans]) * resolution >= LONGEST


def _in_line(thin: Cells, thick: Cells, resolution: float) -> Cells:
    """The thick cells on which a wall goes on, along rows and columns."""
    found = np.zeros_like(thick)
    for row in (_ROW, _ROW.T):
        long = ndimage.binary_opening(thin, row, iterations=round(LENGTH / resolution / 2))
        runs, _ = ndimage.label(thick | long, row)
        found |= np.isin(runs, np.unique(runs[long])) & thick
    return found
