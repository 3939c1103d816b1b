"""Rigid poses: a translation in metres and a unit quaternion (x, y, z, w).

Why: docs/decisions/pose_keeps_its_own_arithmetic.md
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


class Pose(NamedTuple):
    """Where a frame stands in another: ``p_outer = rotation_matrix @ p_inner + translation``.

    It is a translation in metres, right-handed, z up, and a unit quaternion.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    @classmethod
    def from_rpy(cls, x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Self:
        """A pose from fixed-axis roll, pitch and yaw in radians, as SDF and URDF write it."""
        cr, sr = math.cos(roll / 2), math.sin(roll / 2)
        cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        return cls(
            x,
            y,
            z,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )

    @classmethod
    def planar(cls, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> Self:
        """A pose on level ground, turned about z by `yaw` radians."""
        return cls(x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Self:
        """A pose from a (4, 4) rigid transform."""
        m = np.asarray(matrix, dtype=float)
        k = np.array(
            [
                [m[0, 0] - m[1, 1] - m[2, 2], 0, 0, 0],
                [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0, 0],
                [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0],
                [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m[:3, :3])],
            ]
        )
        q = np.linalg.eigh(k / 3.0)[1][:, -1]
        if q[3] < 0:
            q = -q
        return cls(*(float(v) for v in m[:3, 3]), *(float(v) for v in q))

    @classmethod
    def of_json(cls, given: Mapping[str, float] | Sequence[float]) -> Self:
        """A pose as JSON has it: an object with the names of its numbers, or all seven in order."""
        return cls(**given) if isinstance(given, Mapping) else cls(*given)

    @property
    def row(self) -> list[float]:
        """The seven numbers as the database keeps them.

        A number below 1e-30 is 0: PostgreSQL refuses products that underflow.
        """
        numbers = (self.x, self.y, self.z, self.qx, self.qy, self.qz, self.qw)
        return [0.0 if abs(v) < 1e-30 else float(v) for v in numbers]

    @property
    def translation(self) -> NDArray[np.float64]:
        """(3,) metres."""
        return np.array([self.x, self.y, self.z])

    @property
    def rotation(self) -> Rotation:
        """The rotation as SciPy's `Rotation`."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_quat((self.qx, self.qy, self.qz, self.qw))

    @property
    def rotation_matrix(self) -> NDArray[np.float64]:
        """(3, 3) rotation matrix."""
        x, y, z, w = self.qx, self.qy, self.qz, self.qw
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) homogeneous transform."""
        m = np.eye(4)
        m[:3, :3] = self.rotation_matrix
        m[:3, 3] = self.translation
        return m

    @property
    def yaw(self) -> float:
        """Heading of the x axis in the outer xy plane, radians in (-pi, pi]."""
        r = self.rotation_matrix
        return math.atan2(r[1, 0], r[0, 0])

    def __matmul__(self, inner: Pose) -> Pose:
        """`outer @ inner`: the pose of `inner`, given in this frame, in the outer frame."""
        x, y, z = self.apply(np.array([[inner.x, inner.y, inner.z]]))[0]
        ax, ay, az, aw = self.qx, self.qy, self.qz, self.qw
        bx, by, bz, bw = inner.qx, inner.qy, inner.qz, inner.qw
        q = np.array(
            [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ]
        )
        q /= np.linalg.norm(q)
        return Pose(float(x), float(y), float(z), *(float(v) for v in q))

    def inverse(self) -> Pose:
        """The pose of the outer frame in this one."""
        t = -self.rotation_matrix.T @ self.translation
        return Pose(float(t[0]), float(t[1]), float(t[2]), -self.qx, -self.qy, -self.qz, self.qw)

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points (N, 3) of this frame, in the outer frame."""
        p: NDArray[np.float64] = np.asarray(points, dtype=float) @ self.rotation_matrix.T
        return p + self.translation


IDENTITY = Pose()
