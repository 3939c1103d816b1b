import numpy as np
from numpy.typing import NDArray

def slices(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    heights: list[float],
    origin_x: float,
    origin_y: float,
    resolution: float,
    rows: int,
    columns: int,
) -> NDArray[np.bool_]: ...
