"""Lines of doorways, moved to the posts of walls that were built with known faces."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import NDArray
from shapely import LineString

from navgrid.posts import between_posts
from tests.navgrid.test_lintels import block, together

SLACK = 0.1


def wall(
    width: float, thick: float, floor: float, *, sill: bool = False, passing: bool = False
) -> trimesh.Trimesh:
    """A wall along x with a doorway at the origin; `passing`: its right post is a wall along y."""
    left = block((-3, -thick / 2, floor), (-width / 2, thick / 2, floor + 2.6))
    right = block((width / 2, -thick / 2, floor), (3, thick / 2, floor + 2.6))
    if passing:
        right = block((width / 2, -3, floor), (width / 2 + thick, 3, floor + 2.6))
    over = block((-width / 2, -thick / 2, floor + 2.1), (width / 2, thick / 2, floor + 2.6))
    low = block((-width / 2, -thick / 2, floor), (-width / 2 + 0.05, thick / 2, floor + 0.3))
    return together([left, right, over, *([low] if sill else [])])


def turned(mesh: trimesh.Trimesh, turn: float) -> NDArray[np.float64]:
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 0, 1)))
    return np.asarray(mesh.triangles)


def ends(line: LineString, turn: float) -> NDArray[np.float64]:
    """The ends of a line, turned back."""
    cos, sin = math.cos(turn), math.sin(turn)
    return shapely.get_coordinates(line) @ [[cos, -sin], [sin, cos]]


@pytest.mark.parametrize("seed", range(12))
def test_ends_are_at_the_posts(seed: int) -> None:
    random = np.random.default_rng(seed)
    width, thick = random.uniform(0.7, 1.6), random.uniform(0.06, 0.4)
    turn, floor = random.uniform(0, 2 * math.pi), random.uniform(-3, 6)
    passing = seed % 3 == 2
    triangles = turned(wall(width, thick, floor, sill=seed % 2 == 1, passing=passing), turn)
    off = random.uniform(-0.024, 0.024, 3)
    rough = np.array([[-width / 2 + off[0], off[1]], [width / 2 + off[2], off[1]]])
    cos, sin = math.cos(turn), math.sin(turn)
    line = LineString(rough @ [[cos, sin], [-sin, cos]])
    (found,) = between_posts([line], triangles, floor, SLACK)
    np.testing.assert_allclose(ends(found, turn), [[-width / 2, 0], [width / 2, 0]], atol=1e-6)


def test_an_end_without_a_post_stays() -> None:
    left = np.asarray(block((-3, -0.1, 0), (-0.5, 0.1, 2.6)).triangles)
    line = LineString([(-0.52, 0.01), (0.52, 0.01)])
    (found,) = between_posts([line], left, 0.0, SLACK)
    np.testing.assert_allclose(found.coords, [(-0.5, 0), (0.52, 0)], atol=1e-9)
    rib = together(
        [block((-3, -0.1, 0), (-0.5, 0.1, 2.6)), block((-0.5, 0.03, 0), (-0.47, 0.05, 2))]
    )
    (found,) = between_posts([line], np.asarray(rib.triangles), 0.0, SLACK)
    assert found.coords[0][0] == pytest.approx(-0.47), "the clear width"
    far = LineString([(-0.7, 0.01), (0.5, 0.01)])
    assert between_posts([far], left, 0.0, SLACK)[0].equals(far), "a post is farther than the slack"
    assert between_posts([line], np.empty((0, 3, 3)), 0.0, SLACK)[0].equals(line)
    assert between_posts([], left, 0.0, SLACK) == []
