from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

_Faces = NDArray[np.int32] | NDArray[np.int64]

def occupancy(
    vertices: NDArray[np.float64],
    faces: _Faces,
    intervals: list[tuple[float, float]],
    origin_x: float,
    origin_y: float,
    resolution: float,
    rows: int,
    columns: int,
    solids: NDArray[np.int32] | None,
    solid_count: int,
    fill: bool,
    filled: NDArray[np.bool_] | None,
    threads: int,
) -> NDArray[np.bool_]: ...
def closed_solids(
    vertices: NDArray[np.float64],
    faces: _Faces,
    solids: NDArray[np.int32] | None,
    solid_count: int,
    threads: int,
) -> NDArray[np.bool_]: ...
def inflate(
    occupied: NDArray[np.bool_],
    radius: int,
    costs: NDArray[np.uint8],
    variant: Literal["baseline", "avx2", "avx512"] | None = None,
) -> NDArray[np.uint8]: ...
def inflation_variants() -> list[Literal["baseline", "avx2", "avx512"]]: ...
def travel(
    costs: NDArray[np.uint8],
    resolution: float,
    cells: NDArray[np.int64],
    slow: float,
    targets: NDArray[np.int64] | None,
    threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def collisions(occupied: NDArray[np.bool_], runs: NDArray[np.int32]) -> NDArray[np.uint16]: ...
def drive(
    costs: NDArray[np.uint8],
    fits: NDArray[np.uint16],
    steps: NDArray[np.uint16],
    turns: NDArray[np.uint16],
    resolution: float,
    cells: NDArray[np.int64],
    targets: NDArray[np.int64] | None,
    slow: float,
    threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def drive_way(
    costs: NDArray[np.uint8],
    fits: NDArray[np.uint16],
    steps: NDArray[np.uint16],
    turns: NDArray[np.uint16],
    resolution: float,
    ends: NDArray[np.int64],
    slow: float,
) -> NDArray[np.int64]: ...
def way(
    costs: NDArray[np.uint8], resolution: float, ends: NDArray[np.int64], slow: float
) -> NDArray[np.int64]: ...
def fit_shape(
    kind: str,
    rotation: NDArray[np.float64],
    origin: NDArray[np.float64],
    bounds: NDArray[np.float64],
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    whole: NDArray[np.float64],
    spacing: float,
    noise: float,
    table: tuple[NDArray[np.float64], float] | None,
    turns: int,
) -> (
    tuple[
        NDArray[np.float64],
        NDArray[np.float64],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.float64],
    ]
    | None
): ...
def shape_distances(
    kind: str,
    rotation: NDArray[np.float64],
    origin: NDArray[np.float64],
    bounds: NDArray[np.float64],
    points: NDArray[np.float64],
) -> NDArray[np.float64]: ...
def shape_cost(
    kind: str,
    rotation: NDArray[np.float64],
    origin: NDArray[np.float64],
    bounds: NDArray[np.float64],
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    tolerance: float,
) -> float: ...
def local_planes(
    points: NDArray[np.float64], near: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

_Ends = Sequence[tuple[int, float]]

class Graph:
    def __init__(
        self,
        tails: NDArray[np.int64],
        heads: NDArray[np.int64],
        weights: NDArray[np.float64],
        least: NDArray[np.float64],
        nodes: int,
    ) -> None: ...
    def prepare(self) -> None: ...
    def weights(self) -> NDArray[np.float64]: ...
    def set_weights(self, edges: NDArray[np.int64], weights: NDArray[np.float64]) -> None: ...
    def shortest(
        self, sources: _Ends, targets: _Ends
    ) -> tuple[float, NDArray[np.int64]] | None: ...
    def alternatives(
        self, sources: _Ends, targets: _Ends, count: int
    ) -> list[tuple[float, NDArray[np.int64]]]: ...
    def distances(
        self, sources: NDArray[np.int64], targets: NDArray[np.int64], threads: int
    ) -> NDArray[np.float64]: ...
