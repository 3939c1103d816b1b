"""The effect evaluator: did a grasp go as expected, and which is next (Tosello et al., IV-C)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from semmap.arrays import Floats
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.part_trial import OpeningOutcome
from semmap.manipulation.trial import HEIGHT, Rest, TrialOutcome

Cause = Literal["pushed", "missed", "dropped", "slipped", "turned"]

STEP = 0.03
"""Metres by which a correction moves a grasp."""

EMPTY = 0.003
"""Width below which closed fingers hold nothing, metres."""

SAME = 1e-3
"""Metres by which places of a grasp differ that are worth a trial each."""

SHIFTED = 0.002
"""Metres below which moving a grasp changes nothing."""

CORRECTIONS = 3
"""Corrections of one grasp before another is tried."""


LIFTED, PUSHED, SLIPPED, TURNED = 0.9 * HEIGHT, 0.01, 0.03, 0.35
"""Of a successful grasp: the least lift, the most of all others; metres and radians."""

OFF, TILTED = 0.02, 0.1
"""The most by which an object rests beside its place, and turned; metres and radians."""

OPENED = 0.9
"""The share of its way that a part is moved, at least."""


def mismatch(outcome: TrialOutcome) -> Cause | None:
    """How the outcome of a grasp differs from the expected one; None for a success."""
    if outcome.pushed > PUSHED:
        return "pushed"
    if outcome.lifted < LIFTED:  # fingers of a hand meet beside what they hold
        return "missed" if outcome.grip < EMPTY else "dropped"
    if np.linalg.norm(outcome.turned) > TURNED:
        return "turned"
    return "slipped" if outcome.slipped > SLIPPED else None


def rest_mismatch(
    rest: Rest, way: ArrayLike = (0, 0, 0), off: float = OFF
) -> Literal["toppled", "strayed"] | None:
    """How an object rests that should have moved by `way` (3,) metres; None for a success."""
    if rest.tilted > TILTED:
        return "toppled"
    return "strayed" if np.linalg.norm(np.subtract(rest.moved, way)) > off else None


def opening_mismatch(
    outcome: OpeningOutcome,
) -> Literal["missed", "let go", "stuck"] | None:
    """How the outcome of an opening or a turn differs from the expected one; None for a success."""
    if not outcome.gripped:
        return "missed"
    if not outcome.held:
        return "let go"
    return "stuck" if outcome.opened < OPENED else None


@dataclass(frozen=True, eq=False)
class Attempt:
    """One trial of a grasp; `correction` (3,) moved it from the candidate, metres in its frame."""

    grasp: Grasp
    outcome: TrialOutcome
    cause: Cause | None
    correction: Floats


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
    corrections: int = CORRECTIONS,
) -> list[Attempt]:
    """Try and correct grasps until one succeeds; `upright` tells gravity (3,) in their frames."""
    failed: dict[str, int] = {}
    made: list[Attempt] = []
    for grasp in grasps:
        group = group_of(grasp.family)
        if failed.get(group, 0) > 1:
            continue
        moved, shift = grasp, np.zeros(3)
        before: list[Floats] = []
        for _ in range(corrections + 1):
            if len(made) == tries:
                return made
            outcome = attempt(moved)
            cause = mismatch(outcome)
            made.append(Attempt(moved, outcome, cause, shift))
            if cause is None:
                return made
            correction = corrected(moved, outcome, cause, upright(moved))
            if correction is None:
                break
            before.append(shift)
            shift = shift + correction
            if any(np.linalg.norm(shift - other) < SAME for other in before):
                break  # back where it failed
            moved = shifted(grasp, shift)
        failed[group] = failed.get(group, 0) + 1
    return made


def shifted(grasp: Grasp, shift: Floats) -> Grasp:
    """Return a grasp that is moved in its own frame, (3,) metres, without turning."""
    move = np.eye(4)
    move[:3, 3] = grasp.pose[:3, :3] @ shift
    before = np.zeros(3) if grasp.shift is None else grasp.shift
    return replace(
        grasp, pose=move @ grasp.pose, pre_grasp=move @ grasp.pre_grasp, shift=before + shift
    )
