"""Grids from voxels contain those from meshes and exceed them by at most one voxel."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from sqlalchemy import Engine

import semmap
from navgrid.grid import Grid
from navgrid.occupancy_grid import StoreyGrid
from tests.navgrid.test_from_voxels import check_within_a_voxel


@pytest.mark.parametrize("world", ["house", "hotel", "clinic"])
def test_voxels_lose_no_cell_of_a_mesh(world: str, request: pytest.FixtureRequest) -> None:
    engine: Engine = request.getfixturevalue(world)
    with semmap.connect(engine.url.render_as_string(hide_password=False)) as db:
        here = db.map(world)
        for low, high in ((0.05, 1.8), (0.3, 0.6)):
            meshes = here.grids(interval=(low, high))
            voxels = here.grids(interval=(low, high), voxel_size=0.05)
            assert len(meshes) == len(voxels)
            for a, b in zip(meshes, voxels, strict=True):
                check_within_a_voxel(a.scene, b.scene, (low, high), 0.05, a.grid)


def placed(made: StoreyGrid, around: Grid) -> NDArray[np.bool_]:
    """The occupied cells of a grid in a larger one."""
    cells = np.zeros(around.shape, np.bool_)
    column, row = np.round((np.array(made.grid.origin) - around.origin) / around.resolution)
    rows, columns = made.cells.shape
    cells[int(row) : int(row) + rows, int(column) : int(column) + columns] = made.cells == 100
    return cells


@pytest.mark.parametrize("interval", [(0.05, 1.8), (0.07, 1.63), (0.31, 0.33), (0.01, 1.2)])
def test_intervals_may_end_within_voxels(bare_house: Engine, interval: tuple[float, float]) -> None:
    """The floor is 50 micrometres below z = 0, the bottom of the wardrobe 0.7 millimetres above."""
    with semmap.connect(bare_house.url.render_as_string(hide_password=False)) as db:
        here = db.map("house")
        (meshes,) = here.grids(interval=interval)
        (voxels,) = here.grids(interval=interval, voxel_size=0.05)
    assert meshes.scene.elevation == voxels.scene.elevation < 0
    least, found = placed(meshes, voxels.grid), voxels.cells == 100
    assert least.sum() > 2000
    assert not (least & ~found).any()
    assert not (found & ~binary_dilation(least, np.ones((3, 3)))).any()
