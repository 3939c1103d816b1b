"""A robot's shape by heading: where it meets obstacles, and the cheapest ways that it can drive.

Deeken et al. (section 4.3) take each part for a disc. Here each part has its exact footprint,
turned to each of n headings, after Hornung et al.: a long robot fits lengthwise through a gap in
which its disc does not fit. It drives along its heading, and turns on the spot.
"""

from __future__ import annotations

import math
import os
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

import semmap_native
from navgrid.grid import Grid
from navgrid.slabs import area_cells
from navgrid.window import Window, grown, seen_from

if TYPE_CHECKING:
    from navgrid.costmap import Costmap

MOVES = (
    *((0, 1), (1, 2), (1, 1), (2, 1), (1, 0), (2, -1), (1, -1), (1, -2)),
    *((0, -1), (-1, -2), (-1, -1), (-2, -1), (-1, 0), (-2, 1), (-1, 1), (-1, 2)),
)
"""Rows and columns of the step along each heading, counter-clockwise."""

HEADINGS = np.array([math.atan2(rows, columns) for rows, columns in MOVES]) % (2 * math.pi)
"""(16,) radians, those of `MOVES`."""

Motion = Literal["stand", "step", "turn"]
"""At a heading; along it by its step; on the spot from it to the next heading."""

STEP = 3
"""Cells by which a step makes a footprint longer."""


def collisions(costmap: Costmap, headings: int = 16) -> NDArray[np.bool_]:
    """Return where any part of a robot would collide, by heading: (headings, rows, columns) bool.

    Heading i is ``2 * pi * i / headings`` radians, the robot's origin in the middle of the cell.
    Cells beyond the grid and unknown cells are not obstacles.
    """
    found = np.zeros((headings, *costmap.grid.shape), np.bool_)
    for number, part in enumerate(costmap.parts):
        occupied = np.zeros(costmap.grid.shape, np.bool_)
        for cells in costmap.occupied.values():
            occupied |= cells[number]
        found |= part_collisions(occupied, part.footprint, costmap.grid.resolution, headings)
    return found


def part_collisions(
    occupied: NDArray[np.bool_], footprint: ArrayLike, resolution: float, headings: int
) -> NDArray[np.bool_]:
    """Return where a footprint meets occupied cells, by heading: (headings, rows, columns) bool.

    The footprint is a convex (N, 2) polygon in the robot's frame, metres; x points ahead.
    ValueError for less than one heading.
    """
    if headings < 1:
        raise ValueError(f"headings is {headings}; give 1 or more")
    found = []
    for first in range(0, headings, len(MOVES)):
        here = range(min(headings - first, len(MOVES)))
        runs = []
        for k in here:
            heading = 2 * math.pi * (first + k) / headings
            cells, (at, _) = footprint_cells(footprint, heading, resolution)
            runs += _runs_of(cells, at, k)
        numbers = np.array(runs, np.int32).reshape(-1, 4)
        bits = semmap_native.collisions(np.ascontiguousarray(occupied), numbers)
        found += [(bits >> k & 1).astype(np.bool_) for k in here]
    return np.array(found)


def hits(
    occupied: NDArray[np.bool_],
    footprint: NDArray[np.float64],
    resolution: float,
    motion: Motion = "stand",
    padding: float = 0.0,
) -> NDArray[np.uint16]:
    """Return where a footprint meets (rows, columns) bool cells, by heading and in a motion.

    The footprint is a convex (N, 2) polygon in the robot's frame, metres, x ahead; the padding
    makes it larger on all sides. All that it passes in the motion counts; of a turn, the convex
    hull. Bit h of a cell's uint16 is set for heading h of `HEADINGS`, in the middle of the cell.
    Cells beyond the grid are not occupied.
    """
    corners = np.ascontiguousarray(footprint, dtype=np.float64)
    runs = _runs(corners.tobytes(), resolution, motion, padding)
    return semmap_native.collisions(np.ascontiguousarray(occupied), runs)


@lru_cache(maxsize=256)
def _runs(footprint: bytes, resolution: float, motion: Motion, padding: float) -> NDArray[np.int32]:
    """(n, 4) heading, row, first and last column of the cells of a footprint in a motion."""
    corners = np.frombuffer(footprint, np.float64).reshape(-1, 2)
    if padding:
        larger = shapely.Polygon(corners).buffer(padding).convex_hull
        corners = shapely.get_coordinates(larger)[:-1]
    found = []
    for h, (here, after) in enumerate(pairwise([*HEADINGS, 2 * math.pi])):
        passed = _turned(corners, here)
        if motion == "step":
            rows, columns = MOVES[h]
            passed = np.concatenate([passed, passed + np.array([columns, rows]) * resolution])
        elif motion == "turn":
            # The arc of a corner lies in the triangle of its ends and where their tangents meet.
            between = _turned(corners, (here + after) / 2) / math.cos((after - here) / 2)
            passed = np.concatenate([passed, between, _turned(corners, after)])
        cells, at = _cells_of(shapely.MultiPoint(passed).convex_hull, resolution)
        found += _runs_of(cells, at, h)
    runs = np.array(found, np.int32).reshape(-1, 4)
    runs.flags.writeable = False
    return runs


def _runs_of(cells: NDArray[np.bool_], at: int, shape: int) -> list[tuple[int, int, int, int]]:
    """The runs of a convex shape, one a row, relative to the robot's cell: row and column `at`."""
    rows = np.flatnonzero(cells.any(axis=1)).tolist()
    ends = [np.flatnonzero(cells[row])[[0, -1]].tolist() for row in rows]
    return [
        (shape, row - at, first - at, last - at)
        for row, (first, last) in zip(rows, ends, strict=True)
    ]


def _turned(corners: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    cos, sin = math.cos(heading), math.sin(heading)
    turned: NDArray[np.float64] = corners @ np.array([[cos, sin], [-sin, cos]])
    return turned


def footprint_cells(
    footprint: ArrayLike, heading: float, resolution: float
) -> tuple[NDArray[np.bool_], tuple[int, int]]:
    """Return the cells that a (N, 2) footprint, turned by a heading in radians, meets.

    And the row and column of the robot's cell.
    """
    turned = _turned(np.asarray(footprint, dtype=np.float64), heading)
    cells, at = _cells_of(shapely.Polygon(turned), resolution)
    return cells, (at, at)


def _cells_of(outline: shapely.Geometry, resolution: float) -> tuple[NDArray[np.bool_], int]:
    """The cells that an outline around a cell's middle meets; the row and column of that cell."""
    reach = math.ceil(float(np.abs(outline.bounds).max()) / resolution) + 1
    size = 2 * reach + 1
    low = -(reach + 0.5) * resolution
    return area_cells(outline, Grid((low, low), resolution, (size, size))), reach


class DriveSpace(NamedTuple):
    """Where a robot fits, by heading: bit h of the uint16 of a cell is heading h of `HEADINGS`.

    `fits`: standing in its middle. `steps`: along the heading to the cell of its step. `turns`: on
    the spot from a heading to the next.
    """

    fits: NDArray[np.uint16]
    steps: NDArray[np.uint16]
    turns: NDArray[np.uint16]


def drive_space(costmap: Costmap, window: Window) -> DriveSpace:
    """Return where the robot of a costmap fits and moves in a window of it."""
    outer = grown(window, costmap.reach + STEP, costmap.grid)
    inner = seen_from(outer, window)

    def free(motion: Motion) -> NDArray[np.uint16]:
        hit = np.zeros([o.stop - o.start for o in outer], np.uint16)
        for number in range(len(costmap.parts)):
            hit |= costmap.hits(number, outer, motion)
        return np.ascontiguousarray(~hit[inner])

    return DriveSpace(free("stand"), free("step"), free("turn"))


def drive(
    costs: NDArray[np.uint8],
    space: DriveSpace,
    resolution: float,
    cells: ArrayLike,
    targets: ArrayLike | None = None,
    *,
    slow: float = 1.0,
    threads: int | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (k, m) prices and lengths of the cheapest ways between cells; infinity: none.

    The targets are by default the cells. Threads, by default one a processor, change nothing.

    The robot drives along its heading, ahead or back, by the steps of `navgrid.travel`, and turns
    on the spot. All that its parts pass is free. A turn costs nothing, a step as in `travel`; its
    origin must not be in cells of 255. Ways begin and end at any heading, so that they are the same
    back. Cells are rows and columns; ValueError for one that is outside.
    """
    starts = _as_cells(cells)
    goals = None if targets is None else _as_cells(targets)
    if goals is not None and len(starts) > len(goals):
        back = drive(costs, space, resolution, goals, starts, slow=slow, threads=threads)
        return back[0].T, back[1].T
    ground = np.ascontiguousarray(costs)
    many = len(os.sched_getaffinity(0)) if threads is None else threads
    used = min(many, max(len(starts), 1))
    return semmap_native.drive(ground, *space, resolution, starts, goals, slow, used)


def _as_cells(given: ArrayLike) -> NDArray[np.int64]:
    return np.ascontiguousarray(given, dtype=np.int64).reshape(-1, 2)


def drive_way(
    costs: NDArray[np.uint8],
    space: DriveSpace,
    resolution: float,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    slow: float = 1.0,
) -> NDArray[np.int64] | None:
    """Return rows, columns and headings (N, 3) of the cheapest way of `drive`; None without one."""
    ends = np.array([start, goal], np.int64)
    found = semmap_native.drive_way(np.ascontiguousarray(costs), *space, resolution, ends, slow)
    return found if len(found) else None
