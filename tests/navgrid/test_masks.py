"""Keepout and speed masks, as Nav2's filters compute with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

from navgrid.grid import Grid
from navgrid.masks import Mask, keepout_mask, speed_mask
from semmap.query.storey_scene import SceneEntity

GRID = Grid((0.0, 0.0), 0.1, (20, 30))


def zone(number: int, x0: float, x1: float, *types: str, **properties: Any) -> SceneEntity:
    return SceneEntity(
        number,
        f"zone{number}",
        "region",
        (*types, "region"),
        footprint=shapely.box(x0, 0.52, x1, 1.48),
        properties=properties,
    )


def limit(mask: Mask, row: int, column: int) -> float:
    """What a filter makes of a cell: ``multiplier * value``."""
    return mask.multiplier * float(mask.cells[row, column])


def test_blocked_regions_are_100_in_the_keepout_mask() -> None:
    mask = keepout_mask(
        [
            zone(1, 0.52, 0.98, "staircase"),
            zone(2, 2.02, 2.28, blocked=True),
            zone(3, 1.02, 1.98, "home_region"),
        ],
        GRID,
    )
    assert mask is not None
    assert mask.type == 0
    assert set(np.unique(mask.cells)) == {0, 100}
    assert mask.cells[5:15, 5:10].all()
    assert mask.cells[5:15, 20:23].all()
    assert (mask.cells == 100).sum() == 10 * 5 + 10 * 3
    assert keepout_mask([zone(3, 0, 1, "home_region")], GRID) is None


def test_speed_limits_in_metres_per_second() -> None:
    mask = speed_mask(
        [
            zone(1, 0.52, 1.98, "speed_zone", speed_limit=0.8),
            zone(2, 1.02, 1.48, "speed_zone", speed_limit=0.299),
        ],
        GRID,
    )
    assert mask is not None
    assert mask.type == 2
    assert limit(mask, 10, 6) == pytest.approx(0.8)
    assert 0.29 < limit(mask, 10, 12) <= 0.299, "the lowest, rounded down"
    assert mask.cells[10, 25] == 0


def test_speed_limits_in_percent() -> None:
    mask = speed_mask([zone(1, 0.52, 1.98, "speed_zone", speed_percent=40)], GRID)
    assert mask is not None
    assert mask.type == 1
    assert limit(mask, 10, 10) == 40
    assert speed_mask([zone(1, 0, 1, "home_region")], GRID) is None


@pytest.mark.parametrize(
    ("zones", "message"),
    [
        ([{}], "give it speed_limit in m/s, or speed_percent"),
        ([{"speed_limit": 0}], "speed_limit is 0; give a number above 0 in m/s"),
        ([{"speed_limit": "slow"}], "speed_limit is 'slow'; give a number"),
        ([{"speed_percent": 120}], "speed_percent is 120; .* percent, at most 100"),
        ([{"speed_percent": 0.5}], "zone0: its limit 0.5 is below 1, the lowest .* raise it"),
        ([{"speed_limit": 2}, {"speed_limit": 0.01}], "zone1: its limit 0.01 is below 0.02"),
        ([{"speed_limit": 1.0}, {"speed_percent": 50}], "some limits are in m/s and some"),
    ],
)
def test_invalid_speed_zones_are_refused(zones: list[dict[str, Any]], message: str) -> None:
    regions = [zone(n, 0.5, 1.0, "speed_zone", **z) for n, z in enumerate(zones)]
    with pytest.raises(ValueError, match=message):
        speed_mask(regions, GRID)
