"""Point clouds: files, checks, downsampling, normals and noise."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

import semmap_native
from semmap.error import Error
from semmap.limits import CLOUD_POINTS
from semmap.npy_file import read_npy

Floats = NDArray[np.float64]

FARTHEST = 1e6
"""Metres; farther coordinates are those of broken files, and squares of them overflow."""

HEADER_BYTES = 4096
"""In which a PLY file states how many points it has."""

NEIGHBOURS = 20
"""Points of a local plane."""


class PerceptionError(Error, ValueError):
    """A cloud or mesh that cannot be used: the text says what, where and the fix."""


def read_cloud(path: Path) -> Floats:
    """Return the points (n, 3) of a PLY file, or the array of a NumPy file, metres.

    Raises PerceptionError: the file is missing, of another format, too large, or has no points.
    """
    if not path.is_file():
        raise PerceptionError(f"{path} does not exist: give a PLY or NPY file with points")
    try:
        if path.suffix.lower() == ".npy":
            points = read_npy(path, CLOUD_POINTS, 3)
        else:
            import trimesh

            with path.open("rb") as file:
                stated = re.search(rb"element vertex (\d+)", file.read(HEADER_BYTES))
            _refuse_large(int(stated[1]) if stated else 0, str(path))
            loaded: Any = trimesh.load(path, process=False, file_type="ply")
            points = loaded.vertices
        points = np.asarray(points, np.float64)
    except PerceptionError:
        raise
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


def checked_points(points: ArrayLike, least: int, what: str = "the cloud") -> Floats:
    """Return the finite points (m, 3) of a cloud (n, 3) or (height, width, 3), metres.

    Raises PerceptionError: another shape, more points than the limit, less than `least` finite
    points, or a coordinate of more than 1,000 km.
    """
    try:
        found = np.asarray(points, np.float64)
    except (TypeError, ValueError) as error:
        raise PerceptionError(f"{what} is not an array of numbers: give (n, 3) metres") from error
    if found.ndim not in (2, 3) or found.shape[-1] != 3:
        raise PerceptionError(f"{what} has shape {found.shape}: give (n, 3) or (height, width, 3)")
    found = found.reshape(-1, 3)
    _refuse_large(len(found), what)
    finite = found[np.isfinite(found).all(axis=1)]
    if len(finite) < least:
        raise PerceptionError(
            f"{what} has {len(finite)} finite points of {len(found)}, {least} are needed: "
            "check the range and the mask of the camera"
        )
    farthest = float(np.abs(finite).max(initial=0))
    if farthest > FARTHEST:
        raise PerceptionError(
            f"{what} has a coordinate of {farthest:.3g} m: give metres in the frame of the sensor "
            "or of a building"
        )
    return finite


def _refuse_large(points: int, what: str) -> None:
    def refused(problem: str, fix: str) -> PerceptionError:
        return PerceptionError(f"{what} {problem}. {fix}")

    CLOUD_POINTS.check(points, refused, "Downsample it.")


def voxel_downsample(points: Floats, size: float) -> Floats:
    """Return the mean point of each occupied voxel, by voxel: (m, 3) of (n, 3) metres."""
    if not size > 0:
        raise PerceptionError(f"the voxel size is {size} m: give a number above 0")
    if float(np.prod(np.ptp(points / size, axis=0) + 2)) > 2**62:
        raise PerceptionError(
            f"the cloud is {np.ptp(points, axis=0).max():.3g} m wide, too wide for voxels of "
            f"{size} m: remove far points or give larger voxels"
        )
    cell = np.floor(points / size)
    cell = (cell - cell.min(axis=0)).astype(np.int64)
    span = cell.max(axis=0) + 1
    key = (cell[:, 0] * span[1] + cell[:, 1]) * span[2] + cell[:, 2]
    _, of, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = [np.bincount(of, weights=column) for column in points.T]
    return np.stack(sums, axis=1) / count[:, None]


@dataclass(frozen=True, eq=False)
class Surfels:
    """Points of a surface with normals."""

    points: Floats  # (n, 3), metres
    normals: Floats  # (n, 3), unit length; the sign is arbitrary
    noise: float  # standard deviation of the points about their local planes, metres
    spacing: float  # median distance of neighbours, metres

    def take(self, count: int) -> Surfels:
        """Return the first points, whose spacing is wider."""
        wider = self.spacing * max(len(self.points) / count, 1.0) ** 0.5
        return Surfels(self.points[:count], self.normals[:count], self.noise, wider)


def surfels(points: Floats, neighbours: int = NEIGHBOURS, alone: float | None = None) -> Surfels:
    """Return points (n, 3) with the normals of the planes through so many nearest neighbours.

    Points are left out whose neighbours are `alone` times farther than usual; none for None.
    """
    k = min(neighbours, len(points))
    distance, near = cKDTree(points, balanced_tree=False).query(points, k)
    kept = np.ones(len(points), bool)
    if alone is not None:
        reach = distance[:, k // 2]
        kept = reach <= alone * np.median(reach)
        distance, near = distance[kept], near[kept]
    normals, variances = semmap_native.local_planes(points, np.ascontiguousarray(near, np.int64))
    noise = float(np.sqrt(max(np.median(variances), 0.0) * k / max(k - 3, 1)))
    spacing = float(np.median(distance[:, min(4, k - 1)])) / np.sqrt(4 / np.pi)
    return Surfels(points[kept], normals, noise, spacing)
