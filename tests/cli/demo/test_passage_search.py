"""Where Figure 9 is drawn: a way that only the layered costmap has."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from navgrid.grid import Grid
from semmap.cli.demo.passage_search import find_passage

GRID = Grid((10.0, -3.0), 0.05, (60, 80))


def costs(*free: tuple[slice, slice]) -> np.ndarray:
    made = np.full(GRID.shape, 254, np.uint8)
    for window in free:
        made[window] = 0
    return made


LEFT, RIGHT = np.s_[5:55, 5:35], np.s_[5:55, 45:75]


def test_two_halves_of_a_room_that_only_the_layered_costmap_joins() -> None:
    single, layered = costs(LEFT, RIGHT), costs(LEFT, RIGHT, np.s_[20:30, 35:45])
    found = find_passage(layered, single, GRID)
    assert found is not None
    (a, b), free = (GRID.cell(*point) for point in (found.start, found.goal)), single == 0
    parts, _ = label(free)
    assert free[a]
    assert free[b]
    assert parts[a] != parts[b]


def test_a_niche_below_a_table() -> None:
    single, layered = costs(LEFT), costs(LEFT, np.s_[20:40, 35:45])
    found = find_passage(layered, single, GRID)
    assert found is not None
    assert single[GRID.cell(*found.start)] == 0
    goal = GRID.cell(*found.goal)
    assert single[goal] == 254
    assert layered[goal] == 0


def test_none_where_both_know_the_same() -> None:
    assert find_passage(costs(LEFT, RIGHT), costs(LEFT, RIGHT), GRID) is None
    speck = costs(LEFT, np.s_[20:22, 35:37])  # too small to show anything
    assert find_passage(speck, costs(LEFT), GRID) is None
    apart = costs(np.s_[50:58, 60:78])  # no whole robot gets there
    assert find_passage(apart, costs(), GRID) is None
