"""Inflation beside the distance transforms of cv2 and scipy with a table of costs; one thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Row, medians_in_turn, print_rows
from navgrid.inflation import costs_by_distance, inflate
from semmap_native import inflation_variants

__all__ = ["main"]

RESOLUTION = 0.02
FALL: dict[str, Any] = {"inscribed_radius": 0.2, "cost_scaling_factor": 5.0}

JOBS: tuple[tuple[tuple[int, int], int, str, float], ...] = (
    ((1250, 2000), 28, "cv2", 8),
    ((10_000, 10_000), 11, "cv2", 8),
    ((1250, 2000), 28, "scipy", 12),
)
"""Rows and columns, radius in cells, the peer, and how many times as fast as it we have to be."""

WITH_AVX512 = {((10_000, 10_000), "cv2"): 30.0}
"""What is required where the processor has AVX-512."""


def occupied_cells(shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Walls, tables and noise: about one cell in forty."""
    random = np.random.default_rng(3)
    cells = np.zeros(shape, np.bool_)
    cells[::250] = cells[:, ::250] = True
    cells[100::250, :] = False
    for _ in range(shape[0] * shape[1] // 20_000):
        r, c = random.integers(0, shape[0] - 40), random.integers(0, shape[1] - 60)
        cells[r : r + int(random.integers(2, 40)), c : c + int(random.integers(2, 30))] = True
    return cells


def by_table(
    distance: NDArray[np.floating], radius: int, table: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Costs of distances in cells, as costmap_2d has them: by a table of the rounded square."""
    costs = np.zeros(distance.shape, np.uint8)
    near = distance <= radius
    costs[near] = table[np.rint(distance[near] ** 2).astype(np.int32)]
    return costs


def with_cv2(cells: NDArray[np.bool_], radius: int) -> Callable[[], NDArray[np.uint8]]:
    """The distance transform of cv2, of masks of 5 (PRECISE), and the table."""
    import cv2

    free = (~cells).astype(np.uint8)
    table = costs_by_distance(RESOLUTION, inflation_radius=radius * RESOLUTION, **FALL)
    return lambda: by_table(
        cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), radius, table
    )


def with_scipy(cells: NDArray[np.bool_], radius: int) -> Callable[[], NDArray[np.uint8]]:
    """The exact distance transform of scipy, and the table."""
    from scipy.ndimage import distance_transform_edt

    table = costs_by_distance(RESOLUTION, inflation_radius=radius * RESOLUTION, **FALL)
    return lambda: by_table(np.asarray(distance_transform_edt(~cells)), radius, table)


def main() -> None:
    """Print the table."""
    import cv2

    cv2.setNumThreads(1)
    rows = []
    for shape, radius, peer, least in JOBS:
        cells = occupied_cells(shape)
        if "avx512" in inflation_variants():
            least = WITH_AVX512.get((shape, peer), least)
        make = with_cv2 if peer == "cv2" else with_scipy

        def ours(cells: NDArray[np.bool_] = cells, radius: int = radius) -> NDArray[np.uint8]:
            return inflate(cells, RESOLUTION, inflation_radius=radius * RESOLUTION, **FALL)

        theirs = make(cells, radius)
        same = np.count_nonzero(ours() != theirs()) / cells.size
        quick, slow = medians_in_turn(ours, theirs, times=3 if cells.size > 1e7 else 9)
        rows.append(
            Row(
                f"{shape[1]:,} x {shape[0]:,}, R = {radius}",
                f"{1e3 * quick:.1f} ms: {slow / quick:.1f}x",
                f"{peer}: {1e3 * slow:.0f} ms; {100 * same:.3f} % of cells differ",
                f"at least {least:g}x",
                slow / quick >= least,
            )
        )
    print_rows(f"Inflation ({', '.join(inflation_variants())})", rows)


if __name__ == "__main__":
    main()
