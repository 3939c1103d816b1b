"""What is inside of closed meshes, in the mirror's voxels and in the cells of grids."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_fill_holes
from sqlalchemy import Engine

import semmap
from navgrid.grid import Grid
from navgrid.slabs import occupancy
from planner.live_topology import LiveTopology
from semmap.fields.regions.shaped_region import voxels_of
from semmap.fields.store.reader import Occupant, read_occupants, read_walls
from semmap.geometry.parts import closed_as_whole, closed_parts
from semmap.geometry.tin import to_mesh

SIZE = 0.05
LARGEST = 8.0  # metres of the entities that are compared: the walls of a building are larger

AROUND = np.ones((3, 3))  # cells that touch at a corner are joined

Layers = NDArray[np.bool_]


def layers_of(entity: Occupant) -> tuple[Layers, Layers, Layers]:
    """Voxels of the mirror, and filled and hollow cells of slabs that are as high as voxels.

    All are (layers, rows, columns).
    """
    mesh = to_mesh(entity.triangles)
    low = np.floor(mesh.vertices.min(axis=0) / SIZE).astype(int) - 2
    high = np.floor(mesh.vertices.max(axis=0) / SIZE).astype(int) + 3
    shape = tuple(high - low)[::-1]
    voxels = np.zeros(shape, bool)
    for region in entity.regions(SIZE):
        x, y, z = (np.asarray(voxels_of(region, SIZE)).reshape(-1, 3) - low).T
        voxels[z, y, x] = True
    grid = Grid((low[0] * SIZE, low[1] * SIZE), SIZE, shape[1:])
    heights = [(z * SIZE, (z + 1) * SIZE) for z in range(low[2], high[2])]
    filled, hollow = (
        occupancy((mesh.vertices, mesh.faces), heights, grid, fill=fill) for fill in (True, False)
    )
    return voxels, filled, hollow


@pytest.mark.parametrize(
    ("world", "mixed", "least"), [("house", 40, 1000), ("hotel", 0, 0), ("clinic", 0, 0)]
)
def test_one_rule_says_what_is_closed(
    world: str, mixed: int, least: int, request: pytest.FixtureRequest
) -> None:
    """Grids ask it of an entity, fields of each part: no cell that a robot gets to differs."""
    engine: Engine = request.getfixturevalue(world)
    url = engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as db, LiveTopology(db.map(world)).snapshot() as seen:
        entities = [*read_occupants(seen), *read_walls(seen)]
    some, seen_mixed, inside = 0, 0, 0
    for entity in entities:
        if not len(entity.triangles) or entity.encloses_air:
            continue
        if np.ptp(entity.triangles.reshape(-1, 3), axis=0).max() > LARGEST:
            continue
        mesh = to_mesh(entity.triangles)
        closed = closed_parts(mesh)[1]
        whole = closed_as_whole(mesh)
        assert not whole or closed.all()
        voxels, filled, hollow = layers_of(entity)
        some += 1
        seen_mixed += not whole and bool(closed.any())
        inside += int((filled & ~hollow).sum())
        assert not (filled & ~hollow & ~voxels).any(), entity.name
        if not whole:
            filled = np.array([binary_fill_holes(cells, AROUND) for cells in filled])
        near = binary_dilation(filled, np.ones((3, 3, 3)))  # faces on borders of voxels
        assert not (voxels & ~near).any(), entity.name
    assert some > 40
    assert inside >= least
    assert seen_mixed >= mixed
