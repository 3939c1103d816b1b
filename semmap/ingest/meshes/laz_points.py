"""The points of a LAZ file, decoded by a process of its own.

A damaged file can end its decoder, lazrs, by a stack that is too small, and the process with it.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def laz_points(path: Path) -> NDArray[np.float64]:
    """Read the points (N, 3) in the file's units; ValueError where they cannot be decoded."""
    command = [sys.executable, "-P", "-m", __name__, str(path.resolve())]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode > 0:
        raise ValueError(done.stderr.decode(errors="replace").strip().rpartition("\n")[2])
    if done.returncode:
        raise ValueError("its compressed points cannot be decoded")
    return np.frombuffer(done.stdout).reshape(-1, 3)


def _decode(path: str) -> None:
    """Write the points as doubles to standard output."""
    import laspy

    with laspy.open(path) as file:
        points = np.ascontiguousarray(file.read().xyz, float)
    sys.stdout.buffer.write(points.tobytes())


if __name__ == "__main__":
    _decode(sys.argv[1])
