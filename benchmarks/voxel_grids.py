"""Occupancy grids of five worlds from meshes and from voxels: times, and cells that differ.

The worlds are in the folder ``SEMMAP_WORLDS``, by default ``../shared/worlds``, but for the office.
Both are of the same interval of heights. No cell of the meshes may be missing, and those that
voxels have and meshes do not are at most a voxel away from cells of the meshes.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, print_rows
from navgrid.grid import Grid
from navgrid.layer_members import LayerMembers
from navgrid.obstacle_layers import ObstacleLayers
from navgrid.policy import Policy
from navgrid.terrain import DriveLimits
from semmap.query.storey_scene import StoreyScene

WORLDS = {
    "small_house": "small_house/worlds/small_house.world",
    "bookstore": "bookstore/worlds/bookstore.world",
    "hotel": "rmf/hotel/hotel.building.yaml",
    "clinic": "rmf/clinic/clinic.building.yaml",
    "office": str(Path(__file__).parents[1] / "examples" / "office" / "office.sdf"),
}
SIZE = 0.05
INTERVAL = (0.05, 1.8)


def main() -> None:
    """Print the table."""
    default = Path(__file__).parents[2] / "shared" / "worlds"
    folder = Path(os.environ.get("SEMMAP_WORLDS", default))
    use_bench_database()
    rows = []
    with semmap.connect(migrate=True) as db:
        for name, file in WORLDS.items():
            if not (folder / file).is_file():
                rows.append(Row(name, f"{file} is not there", "", "", False))
                continue
            map_name = f"grids {name}"
            if map_name in db.maps:
                db.drop_map(map_name)
            db.import_file(folder / file, map=map_name)
            rows.append(measure(db.map(map_name), name))
            db.drop_map(map_name)
    print_rows(f"Occupancy grids in {INTERVAL} m from voxels of {SIZE} m", rows)


def measure(house: semmap.Map, name: str) -> Row:
    """The row of a world: all its storeys."""
    start = time.perf_counter()
    meshes = house.grids(interval=INTERVAL, resolution=SIZE)
    between = time.perf_counter()
    voxels = house.grids(interval=INTERVAL, resolution=SIZE, voxel_size=SIZE)
    end = time.perf_counter()
    lost = more = cells = 0
    farthest = 0
    for a, b in zip(meshes, voxels, strict=True):
        there, here = occupied(a.scene, a.grid), occupied(b.scene, a.grid)
        cells += int(there.sum())
        lost += int((there & ~here).sum())
        more += int((here & ~there).sum())
        farthest = max(farthest, _farthest(here, there))
    return Row(
        name,
        f"voxels {end - between:.2f} s; {lost} cells lost, {more} more, {farthest} voxels away",
        f"meshes {between - start:.2f} s; {cells} cells",
        "none lost, at most 1 away",
        lost == 0 and farthest <= 1,
    )


def occupied(scene: StoreyScene, grid: Grid) -> NDArray[np.bool_]:
    """The (rows, columns) cells of all layers."""
    layers = ObstacleLayers(LayerMembers(scene, Policy.default(), DriveLimits()), grid)
    found: NDArray[np.bool_] = np.any(
        [layers.cells(name, [INTERVAL])[0] for name in layers.members.layers], axis=0
    )
    return found


def _farthest(cells: NDArray[np.bool_], others: NDArray[np.bool_]) -> int:
    """How many cells the farthest of some cells is away from others, diagonal steps being one."""
    away = np.asarray(distance_transform_cdt(~others, metric="chessboard"))
    return int(away[cells].max(initial=0))


if __name__ == "__main__":
    main()
