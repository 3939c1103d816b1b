"""Rooms found in the maps of SLAM programs are those that plans were made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from scipy import ndimage

from navgrid.door_leaves import door_leaves
from tests.buildings.slam_plans import SIDE, Sums, drawn, found_in, random_plan, seen, write

SEEDS = range(700, 703)


@pytest.mark.parametrize("kind", ["drawn", "seen"])
@pytest.mark.parametrize("furnished", [False, True])
def test_most_rooms_and_doorways_of_a_scan_are_found(
    tmp_path: Path, kind: str, furnished: bool
) -> None:
    sums = Sums()
    for seed in SEEDS:
        plan = random_plan(seed, furnished)
        image = drawn(plan) if kind == "drawn" else seen(plan, seed)
        sums.add(plan, found_in(write(*image, tmp_path)))
    least = 0.8 if furnished else 0.9
    scores = (sums.rooms, sums.doors)
    assert sums.rooms.known > 20
    assert min(n for each in scores for n in (each.recall, each.precision)) >= least, scores


DOORWAY = shapely.box(2.0, 0.95, 2.9, 1.1)


@pytest.mark.parametrize(
    ("angle", "turn"), [(65.0, 0.0), (90.0, 0.0), (110.0, 0.0), (65.0, 30.0), (90.0, 30.0)]
)
def test_a_leaf_as_long_as_its_doorway_is_one_and_a_shelf_is_none(
    angle: float, turn: float
) -> None:
    wall = shapely.box(0, 0.95, 5, 1.1).difference(DOORWAY)
    leaf = shapely.affinity.rotate(shapely.box(2.0, 1.05, 2.9, 1.12), angle, origin=(2.0, 1.1))
    shelf = shapely.box(0.7, 1.05, 0.8, 1.85)  # as thin, and no doorway is beside it
    leaf, shelf, whole = (
        shapely.affinity.rotate(shape, turn, origin=(2.5, 1.5))
        for shape in (leaf, shelf, shapely.union_all([wall, leaf, shelf]))
    )
    y, x = (np.mgrid[:120, :120] + 0.5) * SIDE
    x, y = x - 0.5, y - 1.5
    solid = shapely.contains_xy(whole.buffer(SIDE / 2), x, y)  # the cells that it touches

    found = door_leaves(solid, SIDE)

    _, parts = ndimage.label(found, np.ones((3, 3)))
    assert parts == 1
    assert found[shapely.contains_xy(leaf, x, y)].mean() > 0.5
    assert not found[shapely.contains_xy(shelf, x, y)].any()
