"""Keepout and speed masks of regions, with what Nav2's costmap filters need to be told.

Values are those of `nav_msgs/OccupancyGrid`. A filter computes ``base + multiplier * value``; a
value of 0 has no effect, nor has -1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navgrid.area import area_cells
from navgrid.grid import Grid
from navgrid.scene import Thing

__all__ = ["Mask", "keepout_mask", "speed_mask"]

KEEPOUT_TYPES = frozenset({"blocked_region", "staircase"})
SPEED_TYPES = frozenset({"speed_zone"})

KEEPOUT, SPEED_PERCENT, SPEED_ABSOLUTE = 0, 1, 2
"""Types of `nav2_msgs/CostmapFilterInfo`."""


@dataclass(frozen=True, eq=False)
class Mask:
    """A filter mask: (rows, columns) int8, and the filter's type, base and multiplier."""

    cells: NDArray[np.int8]
    type: int
    base: float
    multiplier: float


def keepout_mask(regions: Iterable[Thing], grid: Grid) -> Mask | None:
    """100 in blocked regions, staircases and what is said to be ``blocked: true``; else 0."""
    cells = np.zeros(grid.shape, np.int8)
    for region in regions:
        if region.kind != "region" or region.outline is None:
            continue
        if KEEPOUT_TYPES & set(region.types) or region.properties.get("blocked") is True:
            cells[area_cells(region.outline, grid)] = 100
    return Mask(cells, KEEPOUT, 0.0, 1.0) if cells.any() else None


def speed_mask(regions: Iterable[Thing], grid: Grid) -> Mask | None:
    """Speed limits of speed zones, the lowest where several meet.

    A zone's property ``speed_limit`` is in m/s, ``speed_percent`` in percent of the robot's top
    speed. Limits in m/s are rounded down to a hundredth of the highest one.

    Raises
    ------
    ValueError
        A zone without either, with one that is no speed, or zones of both sorts.
    """
    limits: list[tuple[float, bool, Thing]] = []
    for region in regions:
        if region.kind == "region" and region.outline is not None:
            if not (SPEED_TYPES & set(region.types) or "speed_limit" in region.properties):
                continue
            limits.append(_limit(region))
    if not limits:
        return None
    absolute = {is_absolute for _, is_absolute, _ in limits}
    if len(absolute) > 1:
        names = ", ".join(region.name for _, _, region in limits)
        raise ValueError(
            f"speed zones {names}: some limit in m/s, some in percent, and a mask has one of both. "
            "Give all of them speed_limit, or all of them speed_percent"
        )
    highest = max(limit for limit, _, _ in limits)
    step = highest / 100 if absolute == {True} else 1.0
    cells = np.zeros(grid.shape, np.int8)
    for limit, _, region in sorted(limits, key=lambda item: -item[0]):
        value = max(1, math.floor(limit / step + 1e-9))
        assert region.outline is not None
        cells[area_cells(region.outline, grid)] = value
    kind = SPEED_ABSOLUTE if absolute == {True} else SPEED_PERCENT
    return Mask(cells, kind, 0.0, step)


def _limit(region: Thing) -> tuple[float, bool, Thing]:
    for key, is_absolute, most in (("speed_limit", True, math.inf), ("speed_percent", False, 100)):
        value = region.properties.get(key)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= most:
            raise ValueError(f"speed zone {region.name}: its {key} is no speed: {value!r}")
        return float(value), is_absolute, region
    raise ValueError(f"speed zone {region.name}: give it speed_limit in m/s, or speed_percent")
