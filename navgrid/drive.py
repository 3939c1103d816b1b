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
    """Where a robot fits, by heading: bit h is heading h of `navgrid.headings.HEADINGS`.

    Attributes
    ----------
    fits : (rows, columns) uint16
        Standing in the middle of a cell.
    steps : (rows, columns) uint16
        Along the heading from a cell to that of its step.
    turns : (rows, columns) uint16
        On the spot from a heading to the next.
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
    """Return the price and the length of the cheapest ways from cells to cells.

    The robot drives along its heading, ahead or back, by the steps of `navgrid.travel`, and turns
    on the spot. All that its parts pass is free. A turn costs nothing, a step as in `travel`. Ways
    begin and end at any heading, so that they are the same back.

    Parameters
    ----------
    costs : (rows, columns) uint8
        With the meaning of costmap_2d; the robot's origin must not be in cells of 255.
    space : DriveSpace
        Of the same cells.
    resolution : float, metres
    cells, targets : (k, 2) and (m, 2) integers
        Rows and columns.
    slow : float
        The extra cost of a metre on the most expensive cells.

    Returns
    -------
    prices, metres : (k, m) float64
        Infinity where there is no way.

    Raises
    ------
    ValueError
        An array has a wrong shape or type, or a cell is outside of the costmap.
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
