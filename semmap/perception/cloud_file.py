"""Point clouds from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from semmap.perception.error import PerceptionError
from semmap.perception.point_cloud import Floats


def read_cloud(path: Path) -> Floats:
    """Return the points (n, 3) of a PLY file, or the array of a NumPy file, metres.

    Raises PerceptionError: the file is missing, of another format, or has no points.
    """
    if not path.is_file():
        raise PerceptionError(f"{path} does not exist: give a PLY or NPY file with points")
    try:
        if path.suffix.lower() == ".npy":
            points = np.load(path, allow_pickle=False)
        else:
            import trimesh

            loaded: Any = trimesh.load(path, process=False, file_type="ply")
            points = loaded.vertices
        points = np.asarray(points, np.float64)
    except Exception as error:  # third-party loaders raise anything on broken bytes
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise PerceptionError(
            f"{path} cannot be read as a point cloud ({reason}): export it as PLY or NPY"
        ) from error
    if points.ndim not in (2, 3) or points.shape[-1] != 3 or not points.size:
        raise PerceptionError(
            f"{path} has an array of shape {points.shape}: give (n, 3) or (height, width, 3)"
        )
    return points
