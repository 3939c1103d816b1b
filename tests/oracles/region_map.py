"""The state of a region map of `semmap_vdb`, compared with its voxels, entity by entity."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
from numpy.typing import NDArray

from semmap_vdb import RegionMap, Shape


def check_region_map(regions: RegionMap) -> None:
    """Raise AssertionError where sets, index, tiles or nodes are not those of the voxels."""
    memory = regions.memory()
    bytes_, active, leaves, tiles, set_count = memory[0], *memory[3:]
    grid, rows = regions.state()
    at, numbers = grid.read()
    sets = dict(rows)
    assert len(at) == active
    assert set(numbers.tolist()) == set(sets), "a voxel holds the number of no set, or no voxel"
    assert len(sets) == set_count == len({tuple(members) for members in sets.values()})
    for entity in {member for members in sets.values() for member in members}:
        own = [number for number, members in sets.items() if entity in members]
        index = regions.voxels(entity)
        assert same_rows(index, at[np.isin(numbers, own)]), "an index is not that of the voxels"
        assert regions.size(entity) == len(index)
    corners, block = np.unique(at & ~7, axis=0, return_inverse=True)
    kinds = Counter(np.unique(np.stack([block.ravel(), numbers], axis=1), axis=0)[:, 0].tolist())
    full = np.bincount(block.ravel(), minlength=len(corners)) == 512
    uniform = np.array([full[b] and kinds[b] == 1 for b in range(len(corners))], bool)
    assert (tiles, leaves) == (uniform.sum(), (~uniform).sum()), "a uniform leaf is no tile"
    inside = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = (corners[~uniform][:, None] + inside).reshape(-1, 3)
    shown = grid.at((places + 0.5) * grid.voxel_size)
    assert np.count_nonzero(shown) == active - 512 * tiles, "a voxel has a set and is not active"
    root, upper, lower, leaf = bytes_of_nodes()
    uppers, lowers = (len(np.unique(corners & ~(edge - 1), axis=0)) for edge in (4096, 128))
    assert bytes_ == root + uppers * upper + lowers * lower + leaves * leaf, "a node is not pruned"


def same_rows(a: NDArray[np.int32], b: NDArray[np.int32]) -> bool:
    """Whether two arrays have the same rows, in any order."""
    return len(a) == len(b) and bool((a[np.lexsort(a.T)] == b[np.lexsort(b.T)]).all())


@cache
def bytes_of_nodes() -> tuple[int, int, int, int]:
    """What the root, a node of 4096^3 voxels, one of 128^3 and a leaf take."""

    def taken(*x: float) -> int:
        regions = RegionMap(1.0)
        regions.insert(0, Shape.points(np.array([(each, 0.5, 0.5) for each in x])))
        return regions.memory()[0]

    alone = taken(0.5)
    leaf = taken(0.5, 8.5) - alone
    lower = taken(0.5, 128.5) - alone - leaf
    upper = taken(0.5, 4096.5) - alone - leaf - lower
    return alone - upper - lower - leaf, upper, lower, leaf
