"""A step of differential inverse kinematics: mink's quadratic program, within the joints' limits.

`mink.solve_ik` states limits as general constraints and checks them first; as bounds of the
unknowns, they take half of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.extra import library

DAMPING = 1e-4
"""The weight of the squared step, which makes the program strictly convex."""

SHARE = 0.95
"""The share of the way to a limit that one step may go, as mink has it."""

FREE = 1e30
"""The limit of a joint without one, for the solver."""


def limits_of(model: Any) -> tuple[Floats, Floats]:
    """(D,) the lowest and highest positions of joints, each of one axis, of a model of MuJoCo."""
    limited = np.asarray(model.jnt_limited, bool)
    low, high = np.asarray(model.jnt_range, np.float64).T
    return np.where(limited, low, -FREE), np.where(limited, high, FREE)


def joint_step(configuration: Any, tasks: Sequence[Any], limits: tuple[Floats, Floats]) -> Floats:
    """The step (D,) of the joints from a mink configuration towards its tasks."""
    program = library("mink").build_ik(configuration, tasks, 1.0, DAMPING, limits=[])
    at = configuration.q
    low, high = (SHARE * (limit - at) for limit in limits)
    none = np.zeros((0, len(at)))
    step: Floats
    step, _, ended, _ = library("daqp").solve(program.P, program.q, none, high, low)
    if ended < 1:
        raise library("mink").NoSolutionFound("daqp")
    return step
