"""Inflation against scipy's exact distances with the formula of costmap_2d, every cell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navgrid.inflation import costs_by_distance, inflate
from semmap_native import inflation_variants


def by_scipy(
    cells: NDArray[np.bool_], resolution: float, inscribed: float, radius: float, k: float
) -> NDArray[np.uint8]:
    """The formula at the exact distance of cell centres; whole squared distances in cells."""
    cost = np.zeros(cells.shape, np.uint8)
    if not cells.any():
        return cost
    squared = np.rint(np.asarray(distance_transform_edt(~cells)) ** 2).astype(np.int64)
    reach = math.ceil(radius / resolution - 1e-9)
    distance = np.sqrt(squared)
    falling = 252 * np.exp(-k * np.maximum(distance * resolution - inscribed, 0))
    cost = falling.astype(np.uint8)
    cost[distance <= inscribed / resolution + 1e-9] = 253
    cost[squared > reach * reach] = 0
    cost[cells] = 254
    return cost


@settings(max_examples=120, deadline=None)
@given(
    st.integers(1, 150),
    st.integers(1, 150),
    st.sampled_from([0.0, 0.0005, 0.01, 0.3, 1.0]),
    st.sampled_from([0.02, 0.05, 0.1]),
    st.floats(0, 0.5),
    st.floats(0, 3.0),
    st.floats(0, 20),
    st.integers(0, 2**32 - 1),
)
def test_costs_agree_with_scipy(
    rows: int,
    columns: int,
    share: float,
    resolution: float,
    inscribed: float,
    radius: float,
    k: float,
    seed: int,
) -> None:
    cells = np.random.default_rng(seed).random((rows, columns)) < share
    wanted = by_scipy(cells, resolution, inscribed, radius, k)
    for variant in inflation_variants():
        got = inflate(
            cells,
            resolution,
            inscribed_radius=inscribed,
            inflation_radius=radius,
            cost_scaling_factor=k,
            variant=variant,
        )
        np.testing.assert_array_equal(got, wanted, err_msg=variant)


@pytest.mark.parametrize("radius", [0, 1, 5, 11, 12, 28, 100, 181, 182, 400])
def test_radii_around_each_kernel_size_agree_with_scipy(radius: int) -> None:
    cells = np.zeros((300, 700), np.bool_)
    cells[[0, 150, 299], [0, 350, 699]] = True
    wanted = by_scipy(cells, 1.0, 2.0, float(radius), 0.01)
    for variant in inflation_variants():
        got = inflate(
            cells,
            1.0,
            inscribed_radius=2.0,
            inflation_radius=radius,
            cost_scaling_factor=0.01,
            variant=variant,
        )
        np.testing.assert_array_equal(got, wanted, err_msg=variant)


@pytest.mark.parametrize(
    ("metres", "resolution", "cells"),
    [
        (0.56, 0.02, 28),
        (0.15, 0.05, 3),
        (0.3, 0.1, 3),
        (0.151, 0.05, 4),
        (0.0, 0.05, 0),
        (0.7, 0.1, 7),
    ],
)
def test_a_radius_of_whole_cells_includes_its_rim(
    metres: float, resolution: float, cells: int
) -> None:
    row = np.zeros((1, 40), np.bool_)
    row[0, 0] = True
    reach = inflate(
        row, resolution, inscribed_radius=0, inflation_radius=metres, cost_scaling_factor=0
    )
    assert np.flatnonzero(reach[0]).max() == cells
    rim = inflate(
        row, resolution, inscribed_radius=metres, inflation_radius=5, cost_scaling_factor=1
    )
    assert np.flatnonzero(rim[0] >= 253).max() == math.floor(metres / resolution + 1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_unknown_cells_are_treated_as_in_costmap_2d(seed: int, inflate_unknown: bool) -> None:
    random = np.random.default_rng(seed)
    cells, hidden = random.random((40, 50)) < 0.02, random.random((40, 50)) < 0.3
    how = {"inscribed_radius": 0.1, "inflation_radius": 0.5, "cost_scaling_factor": 4.0}
    plain = inflate(cells, 0.05, **how)
    got = inflate(cells, 0.05, unknown=hidden, inflate_unknown=inflate_unknown, **how)
    least = 1 if inflate_unknown else 253
    assert (got[~hidden] == plain[~hidden]).all()
    assert (got[hidden & (plain >= least)] == plain[hidden & (plain >= least)]).all()
    assert (got[hidden & (plain < least)] == 255).all()


def test_costs_by_distance_follow_the_formula() -> None:
    table = costs_by_distance(
        0.1, inscribed_radius=0.2, inflation_radius=0.5, cost_scaling_factor=10
    )
    assert len(table) == 26
    assert table[0] == 254
    assert (table[1:5] == 253).all()
    assert table[9] == int(252 * math.exp(-1.0))
    assert (np.diff(table.astype(int)) <= 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"occupied": np.zeros(4, np.bool_)}, "give a .* array of bool"),
        ({"occupied": np.zeros((2, 2), np.uint8)}, "give a .* array of bool"),
        ({"resolution": 0.0}, "resolution is 0.0; give a finite number above 0"),
        ({"resolution": math.nan}, "resolution is nan; give a finite"),
        ({"inscribed_radius": -1.0}, "inscribed_radius"),
        ({"inflation_radius": math.inf}, "inflation_radius"),
        ({"cost_scaling_factor": math.nan}, "cost_scaling_factor"),
        ({"unknown": np.zeros((3, 3), np.bool_)}, "unknown has the shape"),
    ],
)
def test_invalid_arguments_are_refused(change: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "occupied": np.zeros((2, 2), np.bool_),
        "resolution": 0.1,
        "inscribed_radius": 0.1,
        "inflation_radius": 0.3,
        "cost_scaling_factor": 1.0,
        **change,
    }
    with pytest.raises(ValueError, match=message):
        inflate(arguments.pop("occupied"), arguments.pop("resolution"), **arguments)


def test_a_grid_without_obstacles_has_no_costs() -> None:
    none = inflate(
        np.zeros((0, 5), np.bool_),
        0.1,
        inscribed_radius=0.1,
        inflation_radius=1,
        cost_scaling_factor=1,
    )
    assert none.shape == (0, 5)
