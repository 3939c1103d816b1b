"""Faces that one walks to, by hand; rows of plates by brute force are in tests/navgrid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from semmap.geometry.walk import walked_faces


def plate(x0: float, x1: float, z0: float, z1: float) -> NDArray[np.float64]:
    """Two triangles, 1 m deep, that rise from z0 to z1."""
    a, b, c, d = (x0, 0, z0), (x1, 0, z1), (x1, 1, z1), (x0, 1, z0)
    return np.array([(a, b, c), (a, c, d)])


def reached(*plates: NDArray[np.float64], step: float = 0.02, slope: float = 6.0) -> list[bool]:
    found = walked_faces(np.concatenate(plates), [0.0], step, math.radians(slope))
    return [bool(both.all()) for both in found.reshape(-1, 2)]


@pytest.mark.parametrize(
    ("plates", "wanted"),
    [
        ([(0, 1, 0, 0), (1, 2, 0.015, 0.015), (2, 3, 0.03, 0.03)], [True, True, True]),
        ([(0, 1, 0, 0), (1, 2, 0.1, 0.1)], [True, False]),
        ([(0, 1, 0, 0), (1, 3, 0, 0.2), (3, 4, 0.2, 0.2)], [True, True, True]),
        ([(0, 1, 0, 0), (1, 2, 0, 0.2), (2, 3, 0.2, 0.2)], [True, False, False]),
        ([(0, 2, 0, 0.2)], [True]),
        ([(0, 1, 0.5, 0.5)], [False]),
        ([(0, 1, 0, 0), (5, 6, 0.015, 0.015), (6, 7, 0.03, 0.03)], [True, True, True]),
        ([(0, 1, 0, 0), (1, 2, -0.015, -0.015), (2, 3, -0.03, -0.03)], [True, True, True]),
    ],
    ids=[
        "steps",
        "too high",
        "ramp",
        "too steep",
        "a ramp alone",
        "elsewhere",
        "two floors",
        "down",
    ],
)
def test_where_one_comes_to(
    plates: list[tuple[float, float, float, float]], wanted: list[bool]
) -> None:
    assert reached(*[plate(*p) for p in plates]) == wanted


def test_only_among_those_that_count() -> None:
    faces = np.concatenate([plate(0, 1, 0, 0), plate(1, 2, 0.01, 0.01), plate(2, 3, 0.03, 0.03)])
    among = np.array([True, True, False, False, True, True])
    assert walked_faces(faces, [0.0], 0.02, 0.1, among).tolist() == [True, True] + [False] * 4


def test_nothing_to_walk_on() -> None:
    assert walked_faces(np.empty((0, 3, 3)), [0.0], 0.02, 0.1).tolist() == []
