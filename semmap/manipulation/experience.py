"""What trials teach about other objects of the same shape: which grasps to try first.

A trial counts for similar ones: of the same kind of shape, by the likeness of sizes and of grasps.
Trials of another gripper count less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semmap.manipulation.candidates import Grasp
from semmap.manipulation.evaluation import Lesson, group_of, shifted
from semmap.manipulation.solids import Shape

__all__ = ["Experience"]

Floats = NDArray[np.float64]

PRIOR = 1.0
"""Trials that the quality of a grasp is worth."""

LIKENESS = 1.0
"""Difference of the logarithms of sizes at which a trial counts exp(-1/2)."""

STANCE = 0.3
"""Difference in uprightness at which a trial counts exp(-1/2): what lies is not what stands."""

OTHER_GRIPPER = 0.5
"""What a trial of another gripper counts."""


@dataclass(frozen=True, eq=False)
class _Record:
    kind: str
    size: Floats
    upright: float
    """|cos| of the angle of the shape's axis with the z axis of the model."""
    gripper: str
    group: str
    correction: Floats
    """(4,) across the approach, in the frame of the shape, and along it; by the largest size."""
    succeeded: bool


@dataclass(eq=False)
class Experience:
    """Outcomes of trials, by shape, gripper and group of grasps."""

    _records: list[_Record] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._records)

    def add(self, shape: Shape, gripper: str, lesson: Lesson) -> None:
        """Take in all attempts on an object."""
        size = np.log(np.array(shape.size))
        scale = float(max(shape.size))
        for attempt in lesson.attempts:
            self._records.append(
                _Record(
                    shape.kind,
                    size,
                    _upright(shape),
                    gripper,
                    group_of(attempt.grasp),
                    _in_shape(attempt.correction, attempt.grasp, shape) / scale,
                    attempt.cause is None,
                )
            )

    def ranked(self, shape: Shape, gripper: str, grasps: Sequence[Grasp]) -> list[Grasp]:
        """Return grasps, those first that experience and quality let expect a success of.

        The expected success is that of a Beta distribution whose prior is the quality, times the
        share of all trials with such shapes that succeeded. A grasp that succeeded after a
        correction is corrected alike.
        """
        scale = float(max(shape.size))
        known: dict[tuple[str, tuple[float, ...]], list[tuple[float, bool]]] = {}
        for record in self._records:
            weight = self._weight(record, shape, gripper)
            if weight > 0.05:
                key = (record.group, tuple(record.correction.tolist()))
                known.setdefault(key, []).append((weight, record.succeeded))
        by_group: dict[str, list[tuple[Floats, float, float]]] = {}
        for (group, numbers), trials in known.items():
            good = sum(w for w, ok in trials if ok)
            bad = sum(w for w, ok in trials if not ok)
            by_group.setdefault(group, []).append((np.array(numbers), good, bad))
        good = sum(g for trials in by_group.values() for _, g, _ in trials)
        bad = sum(b for trials in by_group.values() for _, _, b in trials)
        share = (good + PRIOR) / (good + bad + PRIOR)  # of all grasps of such shapes
        chosen = []
        for number, grasp in enumerate(grasps):
            plain_good = plain_bad = 0.0
            best, moved = -1.0, grasp
            good_shifts, good_weights = [], []
            for correction, good, bad in by_group.get(group_of(grasp), []):
                if not correction.any():
                    plain_good, plain_bad = plain_good + good, plain_bad + bad
                elif good > 0:
                    good_shifts.append(correction)
                    good_weights.append(good)
            best = _expectation(share * grasp.quality, plain_good, plain_bad)
            if good_weights:
                shift = np.average(good_shifts, axis=0, weights=good_weights) * scale
                shift = _in_grasp(shift, grasp, shape)
                corrected = _expectation(share * grasp.quality, sum(good_weights), 0.0)
                if corrected > best:
                    best, moved = corrected, shifted(grasp, shift)
            chosen.append((-best, number, moved))
        chosen.sort(key=lambda item: item[:2])
        return [grasp for _, _, grasp in chosen]

    def _weight(self, record: _Record, shape: Shape, gripper: str) -> float:
        if record.kind != shape.kind:
            return 0.0
        apart = float(np.linalg.norm(record.size - np.log(np.array(shape.size)))) / LIKENESS
        apart += abs(record.upright - _upright(shape)) / STANCE
        own = 1.0 if record.gripper == gripper else OTHER_GRIPPER
        return own * float(np.exp(-(apart**2) / 2))


def _upright(shape: Shape) -> float:
    return abs(float(shape.pose[2, 2]))


def _in_shape(correction: Floats, grasp: Grasp, shape: Shape) -> Floats:
    """(4,): the part across the approach in the frame of the shape, and the part along it."""
    turned = shape.pose[:3, :3].T @ grasp.pose[:3, :3]
    return np.append(turned @ (correction * [1, 1, 0]), correction[2])


def _in_grasp(correction: Floats, grasp: Grasp, shape: Shape) -> Floats:
    """(3,) in the frame of the grasp; the part along the approach comes from that of others."""
    turned = shape.pose[:3, :3].T @ grasp.pose[:3, :3]
    across = (turned.T @ correction[:3]) * [1, 1, 0]
    found: Floats = across + np.array([0.0, 0.0, correction[3]])
    return found


def _expectation(prior: float, good: float, bad: float) -> float:
    return (good + PRIOR * prior) / (good + bad + PRIOR)
