"""The lip and the vacuum of a suction cup, beside closed forms and a ring of springs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from semmap.manipulation.error import ManipulationError
from semmap.manipulation.suction import Cup, heaviest, strain, tightness

CUP = Cup(0.015, 60.0)
SPRINGS = 360


def seen(height: object, cup: Cup = CUP) -> float:
    """How tight a cup is on a surface whose height, metres, is a function of x and y."""
    assert callable(height)
    ring, inside = (np.array([height(*at) for at in some]) for some in (cup.ring, cup.inside))
    return float(tightness(cup, ring, inside))


@given(st.floats(0.005, 0.05), st.floats(1.02, 20))
def test_a_ring_on_a_cylinder_bends_by_its_height(radius: float, ratio: float) -> None:
    cup, around = Cup(radius, 10), ratio * radius
    bend = around - math.sqrt(around**2 - radius**2)
    expected = max(0.0, 1 - bend / (0.2 * radius)) if bend <= 0.3 * radius else 0.0
    found = seen(lambda x, y: around - math.sqrt(around**2 - x**2), cup)
    assert found == pytest.approx(expected, abs=1e-9)


@given(st.floats(0.005, 0.05), st.floats(1.02, 20), st.booleans())
def test_a_sphere_is_tight_until_it_is_too_far_inside(
    radius: float, ratio: float, hollow: bool
) -> None:
    cup, around = Cup(radius, 10), ratio * radius
    sign = -1 if hollow else 1
    bulge = around - math.sqrt(around**2 - radius**2)
    if abs(bulge - 0.3 * radius) < 1e-9:
        return
    found = seen(lambda x, y: sign * (around - math.sqrt(around**2 - x**2 - y**2)), cup)
    assert found == pytest.approx(1.0 if bulge < 0.3 * radius else 0.0, abs=1e-6)


@given(st.floats(0, 1.2))
def test_a_tilted_plane_bends_the_lip_by_its_slope(angle: float) -> None:
    bend = 2 * CUP.radius * math.tan(angle)
    expected = max(0.0, 1 - bend / (0.2 * CUP.radius))
    assert seen(lambda x, y: math.tan(angle) * x) == pytest.approx(expected, abs=1e-9)


@given(st.floats(0, 2 * math.pi), st.floats(0, 0.0145), st.floats(0.003, 0.02))
def test_no_hole_wider_than_some_millimetres_is_sealed(
    angle: float, off: float, size: float
) -> None:
    x0, y0 = off * math.cos(angle), off * math.sin(angle)
    found = seen(lambda x, y: math.inf if math.hypot(x - x0, y - y0) < size else 0.0)
    assert found == 0.0


def pressures(cup: Cup, pressed: float, moment: NDArray[np.float64]) -> NDArray[np.float64]:
    """The forces of a ring of equal springs on a plate, which carries a load, newtons."""
    angle = np.arange(SPRINGS) * 2 * np.pi / SPRINGS
    x, y = cup.radius * np.cos(angle), cup.radius * np.sin(angle)
    shape = np.column_stack([np.ones(SPRINGS), x, y])  # a plate stays flat
    resists = np.stack([np.ones(SPRINGS), y, -x])  # force along z, moments about x and y
    found: NDArray[np.float64] = shape @ np.linalg.solve(resists @ shape, [pressed, *moment[:2]])
    return found


def rubs(
    cup: Cup, normal: NDArray[np.float64], force: NDArray[np.float64], about_z: float, mu: float
) -> bool:
    """Whether some friction at the springs, in cones of 16 sides, gives a force and a moment."""
    angle = np.arange(SPRINGS) * 2 * np.pi / SPRINGS
    x, y = cup.radius * np.cos(angle), cup.radius * np.sin(angle)
    zero, one = np.zeros(SPRINGS), np.ones(SPRINGS)
    equal = np.stack(
        [np.concatenate([one, zero]), np.concatenate([zero, one]), np.concatenate([-y, x])]
    )
    sides = np.arange(16) * np.pi / 8
    limits = np.concatenate(
        [np.hstack([np.cos(s) * np.eye(SPRINGS), np.sin(s) * np.eye(SPRINGS)]) for s in sides]
    )
    found = linprog(
        np.zeros(2 * SPRINGS),
        A_ub=limits,
        b_ub=np.tile(mu * normal, len(sides)),
        A_eq=equal,
        b_eq=[*force[:2], about_z],
        bounds=(None, None),
    )
    return bool(found.status == 0)


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
levers = st.tuples(*[st.floats(-0.1, 0.1)] * 3)


@given(directions, levers, st.floats(0.2, 1.0))
def test_up_to_the_heaviest_weight_springs_are_pressed_and_friction_suffices(
    down: tuple[float, ...], lever: tuple[float, ...], friction: float
) -> None:
    towards = np.array(down) / np.linalg.norm(down)
    at = np.array(lever)
    most = float(heaviest(CUP, towards[None], at[None], friction)[0])
    if not most < 1e4:
        return
    weight = 0.999 * most * towards
    moment = np.cross(at, weight)
    normal = pressures(CUP, CUP.force - weight[2], moment)
    assert normal.min() > 0
    total = math.hypot(*weight[:2]) + abs(moment[2]) / CUP.radius
    assert total <= friction * normal.sum()
    assert strain(CUP, weight, moment, friction) == pytest.approx(0.999, abs=2e-2)
    assert strain(CUP, weight * 1.01, moment * 1.01, friction) > 1


def test_beyond_the_heaviest_weight_springs_lift_off_or_friction_does_not_suffice() -> None:
    hung, aside = np.array([[0.0, 0, 1]]), np.array([[0.03, 0, 0.02]])
    most = float(heaviest(CUP, hung, aside, 0.5)[0])
    assert most == pytest.approx(60 / (1 + 2 * 0.03 / 0.015))  # V / (1 + 2 lever / r)
    for share, holds in ((0.999, True), (1.001, False)):
        weight = np.array([0, 0, share * most])
        normal = pressures(CUP, CUP.force - weight[2], np.cross(aside[0], weight))
        assert (normal.min() > 0) == holds
    level = np.array([[1.0, 0, 0]])
    most = float(heaviest(CUP, level, np.zeros((1, 3)), 0.5)[0])
    assert most == pytest.approx(30)  # friction x V
    normal = np.full(SPRINGS, 60 / SPRINGS)
    assert rubs(CUP, normal, np.array([0.98 * most, 0]), 0.0, 0.5)
    assert not rubs(CUP, normal, np.array([1.03 * most, 0]), 0.0, 0.5)


def test_a_force_aside_and_a_moment_about_the_approach_share_the_friction() -> None:
    normal = np.full(SPRINGS, 60 / SPRINGS)
    for share in (0.25, 0.5, 0.75):  # the sum is within what the springs resist
        assert rubs(CUP, normal, np.array([share * 29.5, 0]), (1 - share) * 29.5 * 0.015, 0.5)


def test_a_cup_whose_force_nobody_states_has_the_usual_pressure() -> None:
    assert Cup.of(0.015).force == pytest.approx(60e3 * math.pi * 0.015**2)
    assert Cup.of(0.015, 5).force == 5


@pytest.mark.parametrize(
    "numbers", [(0, 60), (-1, 60), (math.nan, 60), (0.01, 0), (0.01, math.inf)]
)
def test_numbers_that_are_no_cup_are_refused(numbers: tuple[float, float]) -> None:
    with pytest.raises(ManipulationError, match=r"of the suction cup is .*: give .* above 0"):
        Cup(*numbers)


def test_a_load_that_pulls_the_lip_off_is_too_much() -> None:
    assert strain(CUP, np.array([0, 0, 61.0]), np.zeros(3), 0.5) == math.inf
    assert strain(CUP, np.array([0, 0, 59.0]), np.zeros(3), 0.5) == 0
