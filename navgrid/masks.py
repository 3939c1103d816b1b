"""Keepout and speed masks of regions, for Nav2's costmap filters.

Values are those of `nav_msgs/OccupancyGrid`. A filter computes ``base + multiplier * value``; the
values 0 and -1 have no effect.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.slabs import area_cells
from semmap.finite_number import is_finite_number
from semmap.query.storey_scene import SceneEntity

SPEED_TYPES = frozenset({"speed_zone"})

KEEPOUT, SPEED_PERCENT, SPEED_ABSOLUTE = 0, 1, 2
"""Types of `nav2_msgs/CostmapFilterInfo`."""


@dataclass(frozen=True, eq=False)
class Mask:
    """A filter mask: cells, the type of the filter, and its multiplier; its base is 0."""

    cells: NDArray[np.int8]
    type: int
    multiplier: float


def keepout_mask(entities: Iterable[SceneEntity], grid: Grid) -> Mask | None:
    """Return a mask that is 100 in blocked regions and 0 elsewhere; None without such regions."""
    cells = np.zeros(grid.shape, np.int8)
    for region in entities:
        if region.is_blocked_region and region.footprint is not None:
            cells[area_cells(region.footprint, grid)] = 100
    return Mask(cells, KEEPOUT, 1.0) if cells.any() else None


def speed_mask(entities: Iterable[SceneEntity], grid: Grid) -> Mask | None:
    """Return the speed limits of speed zones, the lowest where several meet; None without zones.

    Zones are regions of the type ``speed_zone`` or with the property ``speed_limit``, in m/s;
    ``speed_percent`` is in percent of the robot's highest speed. Limits in m/s are rounded down to
    a hundredth of the highest one. ValueError for a zone without a usable limit, for one below a
    hundredth of the highest or below 1 percent, and for both units.
    """
    limits: list[tuple[float, bool, SceneEntity]] = []
    for region in entities:
        if region.kind == "region" and region.footprint is not None:
            if not (SPEED_TYPES & set(region.types) or "speed_limit" in region.properties):
                continue
            limits.append(_limit(region))
    if not limits:
        return None
    absolute = {is_absolute for _, is_absolute, _ in limits}
    if len(absolute) > 1:
        names = ", ".join(region.name for _, _, region in limits)
        raise ValueError(
            f"speed zones {names}: some limits are in m/s and some in percent, but a mask has one "
            "unit. Give all of them speed_limit, or all of them speed_percent"
        )
    highest = max(limit for limit, _, _ in limits)
    step = highest / 100 if absolute == {True} else 1.0
    cells = np.zeros(grid.shape, np.int8)
    for limit, _, region in sorted(limits, key=lambda item: -item[0]):
        value = math.floor(limit / step + 1e-9)
        if value < 1:
            raise ValueError(
                f"speed zone {region.name}: its limit {limit:g} is below {step:g}, the lowest that "
                f"a mask can have whose highest limit is {highest:g}: raise it, or take a zone of "
                "type keepout_zone"
            )
        assert region.footprint is not None
        cells[area_cells(region.footprint, grid)] = value
    kind = SPEED_ABSOLUTE if absolute == {True} else SPEED_PERCENT
    return Mask(cells, kind, step)


def _limit(region: SceneEntity) -> tuple[float, bool, SceneEntity]:
    for key, is_absolute, most in (("speed_limit", True, math.inf), ("speed_percent", False, 100)):
        value = region.properties.get(key)
        if value is None:
            continue
        if not is_finite_number(value) or not 0 < value <= most:
            unit = "m/s" if is_absolute else "percent, at most 100"
            raise ValueError(
                f"speed zone {region.name}: {key} is {value!r}; give a number above 0 in {unit}"
            )
        return float(value), is_absolute, region
    raise ValueError(
        f"speed zone {region.name} has no limit; give it speed_limit in m/s, or speed_percent"
    )
