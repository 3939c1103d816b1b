"""Inflation: costs that fall off around occupied cells, with the meaning of costmap_2d.

Distances between the centres of cells are exact: they are compared as squares of whole numbers.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native

FREE, INSCRIBED, LETHAL, UNKNOWN = 0, 253, 254, 255

LARGEST_RADIUS = 4096
"""The largest inflation radius, cells."""

_SAME = 1e-9  # of a cell: 0.56 / 0.02 is 28


def inflate(
    occupied: ArrayLike,
    resolution: float,
    *,
    inscribed_radius: float,
    inflation_radius: float,
    cost_scaling_factor: float,
    unknown: ArrayLike | None = None,
    inflate_unknown: bool = False,
    variant: Literal["baseline", "avx2", "avx512"] | None = None,
) -> NDArray[np.uint8]:
    """Return the cost of each cell by its distance d to the nearest occupied cell.

    The cost is 254 for d = 0, 253 up to the inscribed radius, then
    ``252 * exp(-cost_scaling_factor * (d - inscribed_radius))``, truncated, and 0 beyond
    ``ceil(inflation_radius / resolution)`` cells. Cells at exactly a radius are within it.

    Parameters
    ----------
    occupied : (rows, columns) bool
    resolution, inscribed_radius, inflation_radius : float, metres
    cost_scaling_factor : float, 1/metre
    unknown : (rows, columns) bool, optional
        These cells keep 255 unless they are within the inscribed radius, as in costmap_2d's
        inflation layer; with `inflate_unknown`, unless their cost is above 0.
    variant : "baseline", "avx2" or "avx512", optional
        The instructions to use, by default the fastest available; the result is the same.

    Returns
    -------
    (rows, columns) uint8

    Raises
    ------
    ValueError
        An array has a wrong shape or type, a number is negative or not finite, or a radius has more
        than `LARGEST_RADIUS` cells.

    Examples
    --------
    >>> row = np.array([[True, False, False, False, False]])
    >>> inflate(row, 0.1, inscribed_radius=0.1, inflation_radius=0.3, cost_scaling_factor=5)
    array([[254, 253, 152,  92,   0]], dtype=uint8)
    """
    cells = _mask("occupied", occupied)
    costs = costs_by_distance(
        resolution,
        inscribed_radius=inscribed_radius,
        inflation_radius=inflation_radius,
        cost_scaling_factor=cost_scaling_factor,
        farthest=max(cells.shape),
    )
    radius = math.isqrt(len(costs) - 1)
    inflated = semmap_native.inflate(cells, radius, costs, variant)
    if unknown is not None:
        hidden = _mask("unknown", unknown)
        if hidden.shape != cells.shape:
            raise ValueError(
                f"unknown has the shape {hidden.shape}; give that of occupied, {cells.shape}"
            )
        least = FREE + 1 if inflate_unknown else INSCRIBED
        inflated[hidden & (inflated < least)] = UNKNOWN
    return inflated


def costs_by_distance(
    resolution: float,
    *,
    inscribed_radius: float,
    inflation_radius: float,
    cost_scaling_factor: float,
    farthest: int | None = None,
) -> NDArray[np.uint8]:
    """Return the cost at each squared distance in cells, up to the inflation radius of `inflate`.

    (n**2 + 1,) uint8 for a radius of n cells. `farthest` is the longer side of the grid, cells:
    larger distances are left out.
    """
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"resolution is {resolution}; give a finite number above 0")
    for name, value in (
        ("inscribed_radius", inscribed_radius),
        ("inflation_radius", inflation_radius),
        ("cost_scaling_factor", cost_scaling_factor),
    ):
        if not (math.isfinite(value) and value >= 0):
            raise ValueError(f"{name} is {value}; give a finite number, 0 or more")
    reach = inflation_radius / resolution - _SAME
    if farthest is not None:
        reach = min(reach, 1.5 * farthest)  # the diagonal
    if reach > LARGEST_RADIUS:
        raise ValueError(
            f"inflation_radius: {inflation_radius} m are {reach:.0f} cells of {resolution} m; "
            f"give at most {LARGEST_RADIUS} cells"
        )
    radius = max(math.ceil(reach), 0)
    cells = np.sqrt(np.arange(radius**2 + 1, dtype=np.float64))
    metres = cells * resolution
    with np.errstate(under="ignore"):
        costs = (252 * np.exp(-cost_scaling_factor * (metres - inscribed_radius).clip(0))).astype(
            np.uint8
        )
    costs[cells <= inscribed_radius / resolution + _SAME] = INSCRIBED
    costs[0] = LETHAL
    return costs


def _mask(name: str, value: ArrayLike) -> NDArray[np.bool_]:
    mask = np.asarray(value)
    if mask.ndim != 2 or mask.dtype != np.bool_:
        raise ValueError(
            f"{name} is {mask.dtype} of shape {mask.shape}; give a (rows, columns) array of bool"
        )
    return np.ascontiguousarray(mask)
