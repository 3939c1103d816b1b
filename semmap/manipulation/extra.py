"""The libraries of `semmap[manipulation]`, imported where they are used."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.manipulation.error import ManipulationError


@cache
def library(name: str) -> Any:
    """A module of the extra; ManipulationError says how to install it where it is not."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ManipulationError(
            f"{name} is not installed; install the extra: pip install 'semmap[manipulation]'"
        ) from error


def is_installed(name: str) -> bool:
    """Whether a module of the extra is there."""
    try:
        library(name)
    except ManipulationError:
        return False
    return True


def mujoco_pose(pose: NDArray[np.float64]) -> dict[str, Any]:
    """A pose (4, 4) as MuJoCo takes it: its quaternions are (w, x, y, z)."""
    x, y, z, w = Pose.from_matrix(pose)[3:]
    return {"pos": pose[:3, 3], "quat": (w, x, y, z)}
