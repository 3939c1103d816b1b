"""Scans: some things and parts of a random building come as clouds of points, not as meshes."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.buildings.building import Building, Item

VOXEL = 0.05
"""Metres of the voxels that a cloud occupies; their lattice begins at the map's origin."""

SCANNED = 3
"""How many things and parts are scanned, at most."""

SHORT = 1.6
"""Metres of the longest piece of a wall that is scanned; a scan is no wall by its shape."""


def scanned(building: Building) -> Building:
    """The building with some scans: of things that bear nothing, and of short pieces of walls."""
    chance = random.Random(f"scans of {building.seed}")
    bearing = {item.on for item in building.items}
    may = [
        i
        for i in building.items
        if (i.what == "thing" and i.name not in bearing and i.shape is None)
        or (i.what == "wall" and max(i.size) < SHORT)
    ]
    chosen = {i.name for i in chance.sample(may, min(len(may), chance.randint(0, SCANNED)))}
    items = [_scan(building, i, chance) if i.name in chosen else i for i in building.items]
    return replace(building, items=items)


def _scan(building: Building, item: Item, chance: random.Random) -> Item:
    """An item by points on its faces and at its corners."""
    rng = np.random.default_rng(chance.randrange(2**32))
    points = rng.uniform(-0.5, 0.5, (chance.choice([40, 300, 3000]), 3))
    axis = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), axis] = rng.choice([-0.5, 0.5], len(points))
    points[:8] = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    own = points * (*item.size, item.high - item.low)
    cos, sin = np.cos(building.angle), np.sin(building.angle)
    at = own @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    middle = np.array([*item.centre, (item.low + item.high) / 2])
    what = "stub" if item.what == "wall" else item.what
    return replace(item, what=what, points=at + middle)


def write_scans(building: Building, folder: Path) -> list[Path]:
    """Write each scan as a PLY file that is named as the thing."""
    paths = []
    for item in building.items:
        if item.points is not None:
            path = folder / f"{item.name}.ply"
            head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(item.points)}\n"
            head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
            path.write_bytes(head.encode() + item.points.astype("<f8").tobytes())
            paths.append(path)
    return paths


def cloud_cells(
    points: NDArray[np.float64],
    heights: tuple[float, float],
    origin: tuple[float, float],
    size: float,
    shape: tuple[int, int],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The cells that a cloud must block, and those that it may.

    A voxel with a point in it must block the cells with which it shares area, if it shares height
    with the interval; what it only touches, it may block. A point at the border of two voxels, by
    rounding, is in either of them.
    """
    must, may = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    low, high = (np.floor(points / VOXEL + d).astype(int) for d in (-1e-6, 1e-6))
    for corner in np.ndindex(2, 2, 2):
        voxels = np.where(np.array(corner, bool), high, low)
        _block(may, voxels, heights, origin, size, 1e-6)
    _block(must, low[(low == high).all(axis=1)], heights, origin, size, -1e-6)
    return must, may


def _block(
    cells: NDArray[np.bool_],
    voxels: NDArray[np.int64],
    heights: tuple[float, float],
    origin: tuple[float, float],
    size: float,
    slack: float,
) -> None:
    bottom = voxels[:, 2] * VOXEL
    there = (bottom <= heights[1] + slack) & (bottom + VOXEL >= heights[0] - slack)
    for x, y in np.unique(voxels[there, :2], axis=0) * VOXEL:
        first = np.floor((np.array([y, x]) - slack - origin[::-1]) / size).astype(int)
        last = np.ceil((np.array([y, x]) + VOXEL + slack - origin[::-1]) / size).astype(int)
        (r0, c0), (r1, c1) = np.maximum(first, 0), np.maximum(last, 0)
        cells[r0:r1, c0:c1] = True
