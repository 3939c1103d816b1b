"""Heights of doorways: as built, in walls that are turned, with and without a ceiling."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from shapely import LineString, affinity, box

from navgrid.found_rooms import FoundDoorway, FoundRoom, FoundRooms
from navgrid.lintels import lintel_heights

CEILING, WALL = 2.9, 0.2


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    size = np.subtract(high, low)
    return trimesh.creation.box(size).apply_translation(np.add(low, size / 2))


def together(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    made = trimesh.util.concatenate(parts)
    assert isinstance(made, trimesh.Trimesh)
    return made


def row(lintels: list[float | None], floor: float, ceiling: bool) -> list[trimesh.Trimesh]:
    """A wall along x with a doorway of 0.9 m every 2 m; None: open up to the ceiling."""
    parts = []
    for number, lintel in enumerate(lintels):
        x = 2.0 * number
        parts.append(block((x, 0, floor), (x + 1.1, WALL, floor + CEILING)))
        if lintel is not None:
            over = block((x + 1.1, 0, floor + lintel), (x + 2, WALL, floor + CEILING))
            parts.append(over)
    if ceiling:
        top = floor + CEILING
        parts.append(block((-1, -3, top), (2 * len(lintels), 3, top + 0.2)))
    return parts


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("ceiling", [False, True])
def test_heights_are_those_of_the_lintels(seed: int, ceiling: bool) -> None:
    random = np.random.default_rng(seed)
    lintels = [None if random.random() < 0.3 else random.uniform(1.85, 2.6) for _ in range(8)]
    floor, turn = random.uniform(-3, 6), random.uniform(0, 2 * math.pi)
    mesh = together(row(lintels, floor, ceiling))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 0, 1)))
    lines = [
        affinity.rotate(
            LineString([(2 * i + 1.1, WALL / 2), (2 * i + 2, WALL / 2)]), turn, (0, 0), True
        )
        for i in range(len(lintels))
    ]
    found = lintel_heights(lines, np.asarray(mesh.triangles), floor)
    for got, built in zip(found, lintels, strict=True):
        assert got == (None if built is None else pytest.approx(built, abs=1e-3))


def test_a_lintel_is_lower_than_one_of_the_ceilings() -> None:
    """From a low corridor into a high hall; the wall begins at the ceiling of the corridor."""
    low = block((-1, -3, 2.2), (3, 0, 2.4))
    wall = block((-1, 0, 2.2), (3, WALL, 4))
    line = LineString([(0.5, WALL / 2), (1.4, WALL / 2)])
    both = together([low, wall])
    assert lintel_heights([line], np.asarray(both.triangles), 0) == [pytest.approx(2.2)]
    assert lintel_heights([line], np.asarray(low.triangles), 0) == [None]
    assert lintel_heights([line], np.empty((0, 3, 3)), 0) == [None]


def test_the_table_of_found_rooms_has_heights_above_the_floor() -> None:
    line = LineString([(1, 0), (2, 0)])
    found = FoundRooms(
        "Etage",
        3.0,
        rooms=(FoundRoom("a", box(0, 0, 4, 4), 5.8, 0.9), FoundRoom("b", box(0, 5, 4, 9), None, 1)),
        doorways=(
            FoundDoorway("d", ("a", "b"), line, 1, 2.04),
            FoundDoorway("e", ("a", None), line, 1),
        ),
    )
    assert [row["high"] for row in found.table()] == [2.8, None, 2.04, None]
