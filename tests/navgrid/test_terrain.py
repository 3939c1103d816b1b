"""The floor that is not an obstacle: steps, ramps and thresholds by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.terrain import DriveLimits, drivable, floor_levels
from semmap.geometry.mesh import box_mesh
from semmap.query.storey_scene import FloorArea

GRID = Grid((0.0, 0.0), 0.1, (20, 60))
HALL = FloorArea("hall", shapely.box(0, 0, 6, 2), 0.0)


def fan(*corners: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.array([(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)])


def plate(x0: float, x1: float, z0: float, z1: float) -> NDArray[np.float64]:
    """A floor of 2 m depth that rises from z0 to z1."""
    return fan((x0, 0, z0), (x1, 0, z1), (x1, 2, z1), (x0, 2, z0))


def driven(parts: list[NDArray[np.float64]], **gait: float) -> list[bool]:
    """Of each part, whether all of its faces are driven on; none are in part."""
    found = drivable(np.concatenate(parts), [0.0], DriveLimits(**gait))
    ends = np.cumsum([len(p) for p in parts])
    each = np.split(found, ends[:-1])
    assert all(e.all() or not e.any() for e in each)
    return [bool(e.all()) for e in each]


@pytest.mark.parametrize(
    ("parts", "gait", "wanted"),
    [
        ([plate(0, 2, 0, 0)], {}, [True]),
        ([plate(0, 2, 0, 0), plate(2, 4, 0.1, 0.1)], {}, [True, False]),
        ([plate(0, 2, 0, 0), plate(2, 4, 0.1, 0.1)], {"max_step": 0.12}, [True, True]),
        ([plate(0, 2, 0, 0), plate(2, 4, 0, 0.2), plate(4, 6, 0.2, 0.2)], {}, [True] * 3),
        ([plate(0, 2, 0, 0), plate(2, 4, 0, 0.4), plate(4, 6, 0.4, 0.4)], {}, [True, False, False]),
        ([plate(0, 2, 0, 0), plate(2, 4, 0, -0.2), plate(4, 6, -0.2, -0.2)], {}, [True] * 3),
        ([plate(0, 2, 0, 0), plate(2.2, 4, 0.03, 0.03)], {}, [True, False]),
        ([plate(2, 4, 0.03, 0.03)], {}, [False]),
        ([plate(0, 2, 0, 0), plate(2, 3, 0.015, 0.015), plate(3, 4, 0.03, 0.03)], {}, [True] * 3),
    ],
    ids=[
        "ground",
        "a step too high",
        "a step",
        "a ramp",
        "too steep",
        "down",
        "a gap",
        "apart",
        "stairs",
    ],
)
def test_faces_connected_to_the_floor_are_drivable(
    parts: list[NDArray[np.float64]], gait: dict[str, float], wanted: list[bool]
) -> None:
    assert driven(parts, **gait) == wanted


def test_walls_are_not_drivable() -> None:
    box = box_mesh((1, 0, 0), (2, 1, 0.5)).triangles
    assert drivable(box, [0.0], DriveLimits()).sum() == 2  # its bottom alone


@settings(max_examples=80, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.2, 1), st.floats(-0.06, 0.06)), min_size=1, max_size=8),
    st.sampled_from([0.0, 0.01, 0.02, 0.05]),
)
def test_a_row_of_plates_agrees_with_a_walk_over_it(
    row: list[tuple[float, float]], max_step: float
) -> None:
    """Brute force: from the first plate on, each is reached if the step to the last is not high."""
    parts, x, z, reached, wanted = [plate(-1, 0, 0, 0)], 0.0, 0.0, True, [True]
    near = []
    for width, step in row:
        reached = reached and abs(step) <= max_step
        near.append(abs(abs(step) - max_step) < 1e-6)
        x, z = x + width, z + step
        parts.append(plate(x - width, x, z, z))
        wanted.append(reached or abs(z) < max(max_step, 1e-6))
        if abs(z) < max(max_step, 1e-6):
            reached = True
        near[-1] |= abs(abs(z) - max_step) < 1e-6
    if any(near):
        return
    # What lies within a step of the floor is ground, and leads back to plates before it.
    found = drivable(np.concatenate(parts), [0.0], DriveLimits(max_step=max_step))
    got = found.reshape(-1, 2).all(axis=1).tolist()
    for k in range(len(wanted) - 2, -1, -1):
        step = abs(row[k][1])
        wanted[k] = wanted[k] or (wanted[k + 1] and step <= max_step)
    assert got == wanted


def test_floor_levels_follow_rooms_and_ramps() -> None:
    low = FloorArea("low", shapely.box(0, 0, 2, 2), 0.0)
    high = FloorArea("high", shapely.box(4, 0, 6, 2), 0.2)
    ramp = plate(2, 4, 0.0, 0.2)
    found = floor_levels([low, high], ramp, 0.0, DriveLimits(max_step=0.04), GRID)
    floor = np.full(GRID.shape, np.nan)
    for level in found:
        floor[level.cells] = np.fmax(floor[level.cells], level.floor)
    assert np.allclose(floor[:, :19], 0)
    assert np.allclose(floor[:, 42:], 0.2)
    x = np.arange(22, 39) * 0.1 + 0.1
    assert (floor[10, 22:39] >= (x - 2) * 0.1 - 1e-9).all(), "never below the ramp"
    assert (floor[10, 22:39] <= (x - 2) * 0.1 + 0.0101).all(), "by a quarter of a step above"
    flat = [lev for lev in found if lev.floor == 0.0]
    assert not flat[0].cells[10, 22:39].any(), "no floor under the ramp"


def test_floor_levels_cover_every_cell_once() -> None:
    found = floor_levels(
        [HALL], np.empty((0, 3, 3)), 0.5, DriveLimits(), Grid((-1, -1), 0.1, (40, 80))
    )
    assert [lev.floor for lev in found] == [0.0, 0.5]
    assert (found[0].cells ^ found[1].cells).all()


@pytest.mark.parametrize(
    "gait", [{"max_step": -0.1}, {"max_step": math.nan}, {"max_slope": 2.0}, {"max_slope": -0.1}]
)
def test_invalid_limits_are_refused(gait: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="less than a right angle"):
        DriveLimits(**gait)
