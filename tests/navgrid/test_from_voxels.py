"""Cells from voxels equal the slabs of the same meshes within one voxel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from navgrid.costmap import Costmap
from navgrid.grid import Grid
from navgrid.layer_members import LayerMembers
from navgrid.obstacle_layers import Interval, ObstacleLayers
from navgrid.occupancy_grid import storey_grid
from navgrid.policy import Policy
from navgrid.terrain import DriveLimits
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.store.reader import Occupant
from semmap.geometry.voxels import Voxels
from semmap.query.storey_scene import NO_TRIANGLES, SceneEntity, StoreyScene
from tests.navgrid.scenes import ARM, BASE, room, scene, sheet, solid

GRID = Grid((-0.5, -0.5), 0.05, (70, 90))


def voxelised(storey: StoreyScene, size: float) -> StoreyScene:
    """The scene with the voxels that grids have of it, in place of all meshes."""
    regions = RegionMap(size)
    for each in storey.entities:
        occupant = Occupant(each.id, each.name, each.triangles, encloses_air=each.kind == "room")
        for region in occupant.cover(size):
            regions.insert(each.id, region)
    return replace(
        storey,
        entities=tuple(
            replace(
                each,
                triangles=NO_TRIANGLES,
                voxels=Voxels(size, regions.voxels(each.id).astype(np.int64), each.triangles),
            )
            for each in storey.entities
        ),
    )


def occupied(
    storey: StoreyScene, interval: Interval, grid: Grid = GRID, limits: DriveLimits | None = None
) -> NDArray[np.bool_]:
    members = LayerMembers(storey, Policy.default(), limits or DriveLimits())
    layers = ObstacleLayers(members, grid)
    found = np.zeros(grid.shape, np.bool_)
    for name in members.layers:
        found |= layers.cells(name, [interval])[0]
    return found


def check_within_a_voxel(
    meshes: StoreyScene, voxels: StoreyScene, interval: Interval, size: float, grid: Grid = GRID
) -> None:
    """Voxels have each cell of the meshes, and no other beyond a voxel."""
    around = np.ones((2 * int(np.ceil(size / grid.resolution)) + 1,) * 2)
    found, least = occupied(voxels, interval, grid), occupied(meshes, interval, grid)
    assert not (least & ~found).any()
    assert not (found & ~binary_dilation(least, around)).any()


def things(seed: int) -> list[SceneEntity]:
    """Turned boxes, thin ones among them, and open sheets, level and slanted."""
    random = np.random.default_rng(seed)
    found = []
    for number in range(random.integers(1, 6)):
        x, y, z = random.uniform(0, (2.5, 2, 1.5))
        dx, dy, dz = random.choice([0.01, 0.04, 0.3, 0.9], 3) * random.uniform(0.9, 1.6, 3)
        if random.random() < 0.6:
            yaw = random.choice([0.0, 0.7])
            found.append(solid(number, (x, y, z), (x + dx, y + dy, z + dz), "table", yaw=yaw))
        else:
            corners = [(x, y, z), (x + dx, y, z), (x + dx, y + dy, z + dz - 0.04)]
            found.append(sheet(number, corners, "shelf"))
    return found


@settings(max_examples=60)
@given(
    st.integers(0, 10_000), st.sampled_from([0.05, 0.1, 0.03]), st.floats(0, 1), st.floats(0.1, 1)
)
def test_voxels_and_slabs_agree_within_a_voxel(
    seed: int, size: float, low: float, tall: float
) -> None:
    storey = scene(*things(seed))
    check_within_a_voxel(storey, voxelised(storey, size), (low, low + tall), size)


@settings(max_examples=30)
@given(
    st.floats(-1, 1),
    st.floats(0, 0.7),
    st.sampled_from([0.05, 0.1]),
    st.floats(0, 1),
    st.floats(0.1, 1),
    st.sampled_from(["closed", "open"]),
)
def test_walls_and_doors_of_voxels(
    floor: float, yaw: float, size: float, low: float, tall: float, state: str
) -> None:
    """The shell of a room, whose floor is driven on, and a door that is an obstacle when shut."""
    shell = solid(1, (0, 0, floor), (2, 1.5, floor + 2.2), kind="room", yaw=yaw)
    door = solid(
        2, (2.2, 0, floor), (2.25, 0.9, floor + 2), "door", kind="connector", state=state, yaw=yaw
    )
    floors = (room("hall", 0, 0, 2, 1.5, floor),)
    storey = scene(shell, door, floors=floors, elevation=floor)
    check_within_a_voxel(storey, voxelised(storey, size), (low, low + tall), size)
    found = occupied(voxelised(storey, size), (0.3, 1.0))
    assert not found[GRID.cell(1.0, 0.75)], "a room encloses air"
    walls = occupied(voxelised(scene(shell, floors=floors, elevation=floor), size), (0.3, 1.0))
    in_the_door = GRID.cell(2.225, 0.45)
    assert found[in_the_door] == (state == "closed" or walls[in_the_door])


@settings(max_examples=20)
@given(st.sampled_from([0.0, 0.034, -0.013]), st.sampled_from([0.05, 0.08]), st.floats(0.05, 0.3))
def test_floors_of_voxels_are_not_obstacles(top: float, size: float, step: float) -> None:
    """Slabs and sheets are driven on at any height of the floor; a block on them is in the way."""
    for ground in (
        solid(1, (0, 0, top - 0.2), (3, 2.5, top), "floor", "building_element"),
        sheet(1, [(0, 0, top), (3, 0, top), (3, 2.5, top), (0, 2.5, top)], "floor"),
    ):
        block = solid(2, (1, 1, top), (1.5, 1.5, top + size + step))
        storey = scene(ground, block, floors=(room("hall", 0, 0, 3, 2.5, top),), elevation=top)
        found = occupied(voxelised(storey, size), (0.02, 1.0))
        rows, columns = np.nonzero(found)
        assert len(rows)
        for cells in (rows, columns):
            ends = GRID.origin[0] + np.array([cells.min(), cells.max() + 1]) * GRID.resolution
            assert np.abs(ends - (1.0, 1.5)).max() <= size + GRID.resolution


def test_updates_and_causes_of_voxels() -> None:
    """Changed voxels are computed near them alone; the result is that of a new costmap."""
    storey = voxelised(
        scene(solid(1, (0.5, 0.5, 0), (1, 1, 1)), solid(2, (2, 1, 0.9), (2.5, 2, 1))), 0.05
    )
    made = Costmap(storey, [BASE, ARM], GRID)
    (cause, *_) = made.explain(0.75, 0.75)
    assert (cause.cost, cause.entities) == (254, ("solid1",))
    assert {c.part for c in made.explain(2.25, 1.5) if c.distance == 0} == {"arm"}
    moved = replace(storey.entities[0], voxels=Voxels(0.05, np.array([[60, 40, 4], [60, 40, 5]])))
    made.update([moved], gone=[2])
    fresh = Costmap(replace(storey, entities=(moved,)), [BASE, ARM], GRID)
    np.testing.assert_array_equal(made.costs, fresh.costs)
    assert made.master[made.grid.cell(3.02, 2.02)] == 254


def test_a_grid_is_made_of_voxels() -> None:
    storey = voxelised(scene(solid(1, (0.5, 0.5, 0.4), (1.5, 0.8, 0.45), "shelf")), 0.05)
    made = storey_grid(storey, resolution=0.05)
    assert 20 * 6 <= (made.cells == 100).sum() <= 22 * 8
    planes = storey_grid(storey, resolution=0.05, increment=0.05)
    assert ((planes.cells == 100) == (made.cells == 100)).all()
