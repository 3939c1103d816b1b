"""Grids from voxels contain those from meshes and exceed them by at most one voxel."""

from __future__ import annotations

import pytest
from sqlalchemy import Engine

import semmap
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
