"""The effect evaluator: did a grasp go as expected, and which is next (Tosello et al., IV-C).

A failure has a cause, and a cause a correction; where that does not help, a grasp of another kind
is tried. A grasp that works replaces one that failed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from semmap.manipulation.candidates import Grasp
from semmap.manipulation.trial import HEIGHT, Rest, TrialOutcome

Floats = NDArray[np.float64]

Cause = Literal["pushed", "missed", "dropped", "slipped", "turned"]
RestCause = Literal["toppled", "strayed"]

STEP = 0.03
"""Metres by which a correction moves a grasp."""

EMPTY = 0.003
"""Width below which closed fingers hold nothing, metres."""

SAME = 1e-3
"""Metres by which places of a grasp differ that are worth a trial each."""

CORRECTIONS = 3
"""Corrections of one grasp before another is tried."""


@dataclass(frozen=True)
class Expected:
    """The outcome of a successful grasp; metres and radians, the least or the most.

    Attributes
    ----------
    lifted : at least; pushed, slipped, turned : at most
    """

    lifted: float = 0.9 * HEIGHT
    pushed: float = 0.01
    slipped: float = 0.03
    turned: float = 0.35

    def mismatch(self, outcome: TrialOutcome) -> Cause | None:
        """Return how an outcome differs from the expected one; None for a success."""
        if outcome.pushed > self.pushed:
            return "pushed"
        if outcome.lifted < self.lifted:  # fingers of a hand meet beside what they hold
            return "missed" if outcome.grip < EMPTY else "dropped"
        if np.linalg.norm(outcome.turned) > self.turned:
            return "turned"
        return "slipped" if outcome.slipped > self.slipped else None


@dataclass(frozen=True)
class ExpectedRest:
    """Where an object rests that was put down or pushed; metres and radians, the most.

    Attributes
    ----------
    off : of its centre of mass from where it should be; tilted : of its vertical axis
    """

    off: float = 0.02
    tilted: float = 0.1

    def mismatch(self, rest: Rest, way: Sequence[float] = (0, 0, 0)) -> RestCause | None:
        """Return how it rests otherwise; None for a success.

        Parameters
        ----------
        way : (3,) by which the object should have moved
        """
        if rest.tilted > self.tilted:
            return "toppled"
        return "strayed" if np.linalg.norm(np.subtract(rest.moved, way)) > self.off else None


@dataclass(frozen=True, eq=False)
class Attempt:
    """One trial: the grasp, its outcome, and the cause of its failure, None for a success.

    `correction` (3,) moved it from the candidate: metres, in the frame of the grasp.
    """

    grasp: Grasp
    outcome: TrialOutcome
    cause: Cause | None
    correction: Floats


@dataclass(frozen=True, eq=False)
class Lesson:
    """The attempts on an object, in order; the last one succeeded if any did."""

    attempts: tuple[Attempt, ...]

    @property
    def learned(self) -> Attempt | None:
        """The attempt to store in place of the others; None where none succeeded."""
        last = self.attempts[-1] if self.attempts else None
        return last if last is not None and last.cause is None else None


def group_of(family: str) -> str:
    """Return the group of grasps that fail alike: approach, closing axis, offset."""
    words = family.split()
    return " ".join((*words[:2], words[3])) if len(words) == 5 else family


def corrected(grasp: Grasp, outcome: TrialOutcome, cause: Cause, down: Floats) -> Floats | None:
    """How to move a failed grasp, (3,) metres in its own frame, as is `down`; None for no idea."""
    # What hangs beside its support turns downwards: turn = lever x weight.
    lever = np.cross(down, np.array(outcome.turned))
    lever[0] = 0.0  # along the closing axis the fingers do not move
    length = float(np.linalg.norm(lever))
    if cause != "pushed" and length > 0.15:
        return lever / length * STEP
    across = np.array([outcome.shift[0], outcome.shift[1], 0.0])
    if cause == "pushed" and np.linalg.norm(across) > 0.001:
        return across
    if cause == "missed":
        return np.array([0.0, 0.0, STEP / 2])  # reach further
    return None


def learn_grasp(
    grasps: Iterable[Grasp],
    attempt: Callable[[Grasp], TrialOutcome],
    upright: Callable[[Grasp], Floats],
    *,
    tries: int = 12,
) -> Lesson:
    """Try grasps, correct failures, and return the attempts up to the first success.

    `upright` returns the direction of gravity in the frame of a grasp, (3,).
    """
    expected = Expected()
    failed: dict[str, int] = {}
    made: list[Attempt] = []
    for grasp in grasps:
        group = group_of(grasp.family)
        if failed.get(group, 0) > 1:
            continue
        moved, shift = grasp, np.zeros(3)
        before: list[Floats] = []
        for _ in range(CORRECTIONS + 1):
            if len(made) == tries:
                return Lesson(tuple(made))
            outcome = attempt(moved)
            cause = expected.mismatch(outcome)
            made.append(Attempt(moved, outcome, cause, shift))
            if cause is None:
                return Lesson(tuple(made))
            correction = corrected(moved, outcome, cause, upright(moved))
            if correction is None:
                break
            before.append(shift)
            shift = shift + correction
            if any(np.linalg.norm(shift - other) < SAME for other in before):
                break  # back where it failed
            moved = shifted(grasp, shift)
        failed[group] = failed.get(group, 0) + 1
    return Lesson(tuple(made))


def shifted(grasp: Grasp, shift: Floats) -> Grasp:
    """Return a grasp that is moved in its own frame, (3,) metres, without turning."""
    move = np.eye(4)
    move[:3, 3] = grasp.pose[:3, :3] @ shift
    before = np.zeros(3) if grasp.shift is None else grasp.shift
    return replace(
        grasp, pose=move @ grasp.pose, pre_grasp=move @ grasp.pre_grasp, shift=before + shift
    )
