"""How long the ways inside of places are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose

__all__ = ["StraightWalks", "Walked", "Walks"]


class Walked(NamedTuple):
    """Seconds and metres, (n, m) float64, from n poses to m; both inf where no way leads."""

    seconds: NDArray[np.float64]
    metres: NDArray[np.float64]


class Walks(Protocol):
    """What tells the way inside of a place; as long there as back."""

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Walked:
        """From each of n poses of a place to each of m, in the map's frame."""
        ...


class StraightWalks:
    """As the crow flies, at one speed, metres a second."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Walked:
        """From each of n poses to each of m."""
        metres = np.array([[math.dist(_point(p), _point(q)) for q in b] for p in a])
        metres = metres.reshape(len(a), len(b))
        return Walked(metres / self.speed, metres)


def _point(pose: Pose) -> tuple[float, float, float]:
    return pose.x, pose.y, pose.z
