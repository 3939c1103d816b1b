"""The measured height of a floor, on meshes built by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.floor_level import floor_level
from semmap.geometry.mesh import box_mesh

CUP = box_mesh((1, 1, 0.034), (1.1, 1.1, 0.134)).triangles


def slab(low: float, high: float, width: float = 6.0) -> np.ndarray:
    return box_mesh((0, 0, low), (width, 4, high)).triangles


@settings(max_examples=50)
@given(st.floats(-5, 5), st.floats(0.01, 1.0))
def test_the_top_of_a_slab_is_the_floor(z: float, thickness: float) -> None:
    assert floor_level([slab(z - thickness, z)]) == pytest.approx(z)


def test_a_thin_ceiling_below_a_slab_is_not_the_floor() -> None:
    ceiling = slab(-0.3, -0.285)  # both of its sides are one surface, and no wider for that
    assert floor_level([], [ceiling, slab(-0.1, 0.0)]) == pytest.approx(0.0)
    assert floor_level([ceiling, slab(-0.1, 0.0)]) == pytest.approx(0.0)
    wall = box_mesh((0, 0, -3.0), (6, 0.6, -0.3)).triangles  # its top is as high as the ceiling
    near = (-0.5, 0.5)
    assert floor_level([], [wall, ceiling, slab(-0.1, 0.0)], near=near) == pytest.approx(0.0)


@pytest.mark.parametrize("turn", [0.0, 0.5, np.pi / 4])
def test_the_floor_of_a_turned_storey_is_as_wide(turn: float) -> None:
    wall = box_mesh((0, 0, 0.0), (6, 0.6, 2.5)).triangles
    below = box_mesh((0, 0, -3.0), (6, 0.6, -0.3)).triangles
    cos, sin = np.cos(turn), np.sin(turn)
    bodies = [
        shape @ [[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]
        for shape in (slab(-0.3, -0.28), slab(-0.1, 0.0), wall, below)
    ]
    assert floor_level([], bodies, near=(-0.5, 0.5)) == pytest.approx(0.0)


def test_the_lowest_of_two_floors_is_taken_unless_a_range_excludes_it() -> None:
    floors = [slab(-0.2, 0.034), slab(2.8, 3.0)]
    assert floor_level(floors) == pytest.approx(0.034)
    assert floor_level(floors, near=(2.5, 3.5)) == pytest.approx(3.0)
    assert floor_level(floors, near=(7.5, 8.5)) is None


def test_a_ramp_beside_the_floor_does_not_count() -> None:
    ramp = np.array([[[0, 0, 1], [2, 0, 2], [2, 4, 2]], [[0, 0, 1], [2, 4, 2], [0, 4, 1]]], float)
    assert floor_level([slab(-0.2, 0.0), ramp]) == pytest.approx(0.0)


def test_a_wide_level_surface_of_other_objects_is_a_floor() -> None:
    assert floor_level([], [slab(-0.1, 0.034), CUP]) == pytest.approx(0.034)


def test_without_a_wide_surface_the_floor_is_where_most_objects_stand() -> None:
    legs = [box_mesh((x, 0, 0.5), (x + 0.1, 0.1, 1.2)).triangles for x in range(5)]
    lamp = box_mesh((9, 3, 2.0), (9.1, 3.1, 2.1)).triangles
    assert floor_level([], [*legs, lamp]) == pytest.approx(0.5)


def test_the_top_of_a_crate_or_a_table_is_not_a_floor() -> None:
    crate = box_mesh((0, 0, 0), (1, 1, 1)).triangles
    assert floor_level([], [crate]) == 0.0
    top = box_mesh((0, 0, 0.7), (1, 1, 0.75)).triangles
    legs = [box_mesh((x, 0, 0), (x + 0.05, 0.05, 0.7)).triangles for x in (0.0, 0.95)]
    cup = box_mesh((0.5, 0.5, 0.75), (0.6, 0.6, 0.85)).triangles
    assert floor_level([], [np.concatenate([top, *legs]), cup]) == 0.0


def test_without_triangles_there_is_no_floor() -> None:
    assert floor_level([]) is None
    assert floor_level([], [np.empty((0, 3, 3))]) is None
