"""Actions as rows: how a gripper acts on an object model, checked, in the model's frame."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import UUID

import numpy as np
from numpy.typing import ArrayLike

from semmap.geometry.pose import Pose
from semmap.manipulation.error import ManipulationError

KINDS = ("grasp", "place", "push", "turn", "open", "put")
"""Of actions; `turn` is a rotational push, `open` opens doors and drawers, `put` is composed."""

MOTIONS = {"push": (3,), "turn": (7,), "open": (3, 7)}
"""How many numbers the motion of a kind has: a translation (3), or an axis with an angle (7)."""

ROUND = 6
"""Decimals of lengths and angles in keys: actions that differ by less are the same."""


@dataclass(frozen=True)
class ActionRecord:
    """An action of a gripper on an object model (section III), in its frame; metres and radians.

    `pose` is that of the grasp frame at contact, between `pre_pose` and `post_pose`. `motion` is
    the way of a push or of what slides open, (3,); of a turn, or of what opens on a hinge, (7,): a
    point of the axis, its direction and the angle.
    `width` is between the fingers; `posture` and `pre_posture` are those of joints at contact and
    before (of a place, after). Trial and error moved it by `shift` in its own frame.
    """

    kind: str
    pose: Pose
    pre_pose: Pose | None = None
    post_pose: Pose | None = None
    motion: tuple[float, ...] | None = None
    approach: str | None = None
    family: str | None = None
    width: float | None = None
    posture: Mapping[str, float] = field(default_factory=dict)
    pre_posture: Mapping[str, float] = field(default_factory=dict)
    quality: float = 0.5
    shift: tuple[float, ...] | None = None

    @classmethod
    def of(cls, given: Any, where: str) -> ActionRecord:
        """The record of a candidate: an object with poses (4, 4), or a record; as `checked`."""
        if isinstance(given, cls):
            return given.checked(where)
        before, after = getattr(given, "pre_grasp", None), getattr(given, "retreat", None)
        motion, shift = getattr(given, "motion", None), getattr(given, "shift", None)
        return cls(
            kind=getattr(given, "kind", "grasp"),
            pose=pose_of(given.pose, f"{where}: pose"),
            pre_pose=None if before is None else pose_of(before, f"{where}: pre_grasp"),
            post_pose=None if after is None else pose_of(after, f"{where}: retreat"),
            motion=None if motion is None else tuple(float(v) for v in np.ravel(motion)),
            approach=getattr(given, "approach", None),
            family=getattr(given, "family", None),
            width=getattr(given, "width", None),
            posture=dict(getattr(given, "posture", {})),
            pre_posture=dict(getattr(given, "pre_posture", {})),
            quality=float(getattr(given, "quality", 0.5)),
            shift=None if shift is None else tuple(float(v) for v in np.ravel(shift)),
        ).checked(where)

    def checked(self, where: str) -> ActionRecord:
        """Return it if it can be stored, else raise ManipulationError, which names `where`."""
        if self.kind not in KINDS or self.kind == "put":
            raise ManipulationError(
                f"{where}: kind is {self.kind!r}: give one of {', '.join(KINDS[:-1])}; "
                "put is composed of a grasp and a place"
            )
        count, counts = len(self.motion or ()), MOTIONS.get(self.kind, (0,))
        if count not in counts:
            numbers = " or ".join(map(str, counts)) if any(counts) else "none"
            raise ManipulationError(
                f"{where}: motion has {count} numbers: a {self.kind} has {numbers}"
            )
        if not (math.isfinite(self.quality) and 0 <= self.quality <= 1):
            raise ManipulationError(f"{where}: quality is {self.quality}: give a share, 0 to 1")
        if self.width is not None and not (math.isfinite(self.width) and self.width >= 0):
            raise ManipulationError(f"{where}: width is {self.width}: give metres, at least 0")
        joints = [*self.posture.items(), *self.pre_posture.items()]
        if not all(math.isfinite(v) for v in self.motion or ()):
            raise ManipulationError(f"{where}: motion is not finite: give {count} finite numbers")
        if self.shift is not None and not (
            len(self.shift) == 3 and all(math.isfinite(v) for v in self.shift)
        ):
            raise ManipulationError(f"{where}: shift is {self.shift}: give metres x, y, z")
        for name, position in joints:
            if not math.isfinite(position):
                raise ManipulationError(f"{where}: joint {name} is at {position}: give a number")
        for name in ("pose", "pre_pose", "post_pose"):
            pose = getattr(self, name)
            if pose is not None:
                pose_of(pose, f"{where}: {name}")
        return self

    def moved(self, frame: Pose) -> ActionRecord:
        """The action, given in a frame, in the outer frame of that frame."""

        def turned(vector: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(float(v) for v in frame.rotation_matrix @ np.array(vector))

        motion = self.motion
        if motion is not None and len(motion) == 3:
            motion = turned(motion)
        elif motion is not None:
            point = tuple(float(v) for v in frame.apply([motion[:3]])[0])
            motion = (*point, *turned(motion[3:6]), motion[6])
        return replace(
            self,
            pose=frame @ self.pose,
            pre_pose=self.pre_pose and frame @ self.pre_pose,
            post_pose=self.post_pose and frame @ self.post_pose,
            motion=motion,
        )


def action_key(record: ActionRecord, object_key: str, gripper: str) -> UUID:
    """The key of an action: equal for equal contents, in all databases."""

    def rounded(numbers: Any) -> list[float] | None:
        return None if numbers is None else [round(float(v), ROUND) + 0.0 for v in numbers]

    def turned(pose: Pose | None) -> list[float] | None:
        """The numbers of a pose; of its two quaternions, the one whose last large part is > 0."""
        if pose is None:
            return None
        sign = next((math.copysign(1, q) for q in pose[:2:-1] if abs(q) > 1e-4), 1.0)
        return rounded([*pose[:3], *(sign * q for q in pose[3:])])

    content = [
        record.kind,
        object_key,
        gripper,
        turned(record.pose),
        turned(record.pre_pose),
        turned(record.post_pose),
        rounded(record.motion),
        sorted((name, *(rounded([at]) or ())) for name, at in record.posture.items()),
        sorted((name, *(rounded([at]) or ())) for name, at in record.pre_posture.items()),
    ]
    return _hash(content)


def composed_key(kind: str, steps: Sequence[UUID]) -> UUID:
    """The key of an action that is composed of others: equal for equal steps."""
    return _hash([kind, *map(str, steps)])


def _hash(content: list[Any]) -> UUID:
    return UUID(bytes=hashlib.sha256(json.dumps(content).encode()).digest()[:16], version=4)


def pose_of(given: ArrayLike | Pose, where: str) -> Pose:
    """A pose from (4, 4), (x, y, z, qx, qy, qz, qw) or a pose; ManipulationError for others."""
    try:
        numbers = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape not in ((4, 4), (7,)) or not np.isfinite(numbers).all():
        raise ManipulationError(f"{where}: is not a pose: give (4, 4) or seven finite numbers")
    if numbers.shape == (7,):
        length = float(np.linalg.norm(numbers[3:]))
        if abs(length - 1) > 1e-3:
            raise ManipulationError(
                f"{where}: its quaternion has the length {length:.4g}: give (qx, qy, qz, qw) of "
                "length 1"
            )
        return Pose(*map(float, numbers[:3]), *map(float, numbers[3:] / length))
    rotation = numbers[:3, :3]
    if (
        np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-4
        or np.linalg.det(rotation) < 0
        or np.abs(numbers[3] - (0, 0, 0, 1)).max() > 1e-9
    ):
        raise ManipulationError(
            f"{where}: is not a rigid transform: give a rotation (3, 3), a translation, and the "
            "last row 0 0 0 1"
        )
    return Pose.from_matrix(numbers)
