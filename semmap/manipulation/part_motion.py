"""How a part moves that is opened or turned: about a hinge, or along a slide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from semmap.arrays import Floats
from semmap.finite_number import finite_numbers, is_finite_number
from semmap.geometry.pose import Pose
from semmap.manipulation.error import ManipulationError

LONGEST = 0.02
"""Metres that a point of the part moves between two of `PartMotion.steps`, at most."""

WIDEST = np.radians(5)
"""Radians that the part turns between two of `PartMotion.steps`, at most."""


@dataclass(frozen=True, eq=False)
class PartMotion:
    """A rigid motion from the present pose: about an axis through `point` (3,), else along it.

    `direction` is a unit vector (3,), `amount` radians about it (right-handed), or metres.
    """

    point: Floats | None
    direction: Floats
    amount: float

    @classmethod
    def about(cls, hinge: Sequence[float], angle: float) -> PartMotion:
        """A hinge: a point of its axis and the axis' direction; radians.

        ManipulationError where they are not six finite numbers, or the direction has no length.
        """
        given = finite_numbers(hinge, 6)
        if given is None or np.linalg.norm(given[3:]) < 1e-9:
            raise ManipulationError(
                f"hinge is {list(hinge)}: give a point of the axis and its direction, "
                "x, y, z, dx, dy, dz"
            )
        direction = np.array(given[3:]) / np.linalg.norm(given[3:])
        return cls(np.array(given[:3]), direction, _amount(angle, "radians"))

    @classmethod
    def along(cls, slide: Sequence[float], way: float) -> PartMotion:
        """A slide: its direction; metres. ManipulationError as `about`."""
        given = finite_numbers(slide, 3)
        if given is None or np.linalg.norm(given) < 1e-9:
            raise ManipulationError(f"slide is {list(slide)}: give its direction dx, dy, dz")
        return cls(None, np.array(given) / np.linalg.norm(given), _amount(way, "metres"))

    @classmethod
    def of_numbers(cls, motion: Sequence[float]) -> PartMotion:
        """The motion of an action record: a translation, or an axis with an angle."""
        if len(motion) == 3:
            return cls.along(motion, float(np.linalg.norm(motion)))
        return cls.about(motion[:6], motion[6])

    @property
    def numbers(self) -> tuple[float, ...]:
        """The motion of an action record, as `of_numbers` reads it."""
        if self.point is None:
            return tuple((self.amount * self.direction).tolist())
        return (*self.point.tolist(), *self.direction.tolist(), self.amount)

    @property
    def is_hinge(self) -> bool:
        """Whether it turns about an axis."""
        return self.point is not None

    def at(self, share: float) -> Floats:
        """The displacement (4, 4) after a share of the whole motion."""
        found = np.eye(4)
        if self.point is None:
            found[:3, 3] = share * self.amount * self.direction
            return found
        turn = Rotation.from_rotvec(share * self.amount * self.direction).as_matrix()
        found[:3, :3] = turn
        found[:3, 3] = self.point - turn @ self.point
        return found

    def levers(self, points: Floats) -> Floats:
        """(N,) metres from the axis of a hinge; 1 for a slide, which moves all points alike."""
        if self.point is None:
            return np.ones(len(points))
        levers: Floats = np.linalg.norm(np.cross(self.direction, points - self.point), axis=1)
        return levers

    def headings(self, points: Floats) -> Floats:
        """(N, 3) unit vectors in which points (N, 3) begin to move; 0 on the axis of a hinge."""
        if self.point is None:
            ways = np.tile(self.direction, (len(points), 1))
        else:
            ways = np.cross(self.direction, points - self.point)
        length = np.linalg.norm(ways, axis=1, keepdims=True)
        found: Floats = np.sign(self.amount) * ways / np.maximum(length, 1e-12)
        return found

    def steps(self, points: Floats) -> Floats:
        """(K, 4, 4) displacements from none to all; points (N, 3) move some 2 cm between them."""
        longest = abs(self.amount) * float(self.levers(points).max(initial=1e-9))
        count = longest / LONGEST
        if self.is_hinge:
            count = max(count, abs(self.amount) / WIDEST)
        return np.array([self.at(share) for share in np.linspace(0, 1, int(np.ceil(count)) + 1)])

    def moved(self, frame: Pose) -> PartMotion:
        """The motion, given in a frame, in the outer frame of that frame."""
        point = None if self.point is None else frame.apply([self.point])[0]
        return replace(self, point=point, direction=frame.rotation_matrix @ self.direction)

    def is_like(self, other: PartMotion) -> bool:
        """Whether both move a part alike: within 1 mm, 1 mm of the axis, and a degree."""
        if self.is_hinge != other.is_hinge:
            return False
        one, two = (np.sign(each.amount) * each.direction for each in (self, other))
        if one @ two < np.cos(np.radians(1)):
            return False
        if abs(abs(self.amount) - abs(other.amount)) > (np.radians(1) if self.is_hinge else 1e-3):
            return False
        return self.point is None or bool(other.levers(self.point[None])[0] < 1e-3)


def _amount(given: float, unit: str) -> float:
    if not (is_finite_number(given) and abs(given) > 1e-4):
        raise ManipulationError(f"travel is {given}: give {unit}, not 0")
    return float(given)
