"""The points of a LAZ file, decoded by a process of its own.

A damaged file can end its decoder, lazrs, by a stack that is too small, and the process with it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semmap.own_process import ProcessEnded, call_apart


def laz_points(path: Path) -> NDArray[np.float64]:
    """Read the points (N, 3) in the file's units; ValueError where they cannot be decoded."""
    try:
        return call_apart(_decoded, path.resolve())
    except ProcessEnded as error:
        raise ValueError(f"its compressed points cannot be decoded: it {error}") from error
    except RuntimeError as error:  # of laspy, or a panic of lazrs
        raise ValueError(str(error).rpartition("\n")[2]) from error


def _decoded(path: Path) -> NDArray[np.float64]:
    import laspy

    with laspy.open(path) as file:
        return np.ascontiguousarray(file.read().xyz, float)
