"""The cheapest ways of a shape over a costmap: along its heading, with turns on the spot."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native
from navgrid.headings import Motion
from navgrid.window import Window, grown

if TYPE_CHECKING:
    from navgrid.costmap import Costmap

STEP = 3
"""Cells by which a step makes a footprint longer."""


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
    inner = tuple(
        slice(w.start - o.start, w.stop - o.start) for w, o in zip(window, outer, strict=True)
    )

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
    targets: ArrayLike,
    *,
    slow: float = 1.0,
    threads: int = 1,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (k, m) prices and lengths of the cheapest ways between cells; infinity: none.

    The robot drives along its heading, ahead or back, by the steps of `navgrid.travel`, and turns
    on the spot. All that its parts pass is free. A turn costs nothing, a step as in `travel`; its
    origin must not be in cells of 255. Ways begin and end at any heading, so that they are the same
    back. Cells are rows and columns; ValueError for one that is outside.
    """
    starts, goals = (
        np.ascontiguousarray(c, dtype=np.int64).reshape(-1, 2) for c in (cells, targets)
    )
    costs = np.ascontiguousarray(costs)
    fits, steps, turns = space
    return semmap_native.drive(costs, fits, steps, turns, resolution, starts, goals, slow, threads)


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
