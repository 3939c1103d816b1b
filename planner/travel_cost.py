"""How long it takes to drive from pose to pose inside a place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose


class Travel(NamedTuple):
    """Seconds and metres from n poses to m poses, (n, m) float64; infinite where no path leads."""

    seconds: NDArray[np.float64]
    metres: NDArray[np.float64]


class TravelCost(Protocol):
    """Measures paths inside of a place. A path takes as long in either direction."""

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        """The travel from each of n poses in a place to each of m; poses in the map's frame."""
        ...


class StraightTravelCost:
    """Straight lines at one speed, m/s, whatever is in the way."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        """The travel along straight lines from each of n poses to each of m."""
        metres = np.array([[math.dist(p[:3], q[:3]) for q in b] for p in a])
        metres = metres.reshape(len(a), len(b))
        return Travel(metres / self.speed, metres)
