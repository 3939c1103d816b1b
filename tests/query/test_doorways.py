"""Lines through the openings of doors: Shapely says which of them random solids meet."""

import random

import numpy as np
import pytest
import shapely
import trimesh

from semmap.geometry.pose import Pose
from semmap.query.map_check.building import LINTEL, WALL
from semmap.query.map_check.doorways import LINES, LOWEST, clear_height, closing, taken_lines


def solid(draw: random.Random) -> tuple[shapely.Polygon, trimesh.Trimesh]:
    """A turned prism of random outline, or a ring of walls, and its ground."""
    if draw.random() < 0.3:
        half = draw.uniform(0.3, 3)
        ground = shapely.box(-half, -half, half, half).difference(
            shapely.box(*(v * (half - 0.2) for v in (-1, -1, 1, 1)))
        )
    else:
        spots = [(draw.uniform(-1, 1), draw.uniform(-1, 1)) for _ in range(6)]
        ground = shapely.MultiPoint(spots).convex_hull
    ground = shapely.affinity.scale(ground, draw.uniform(0.2, 2), draw.uniform(0.05, 2))
    ground = shapely.affinity.rotate(ground, draw.uniform(0, 360))
    ground = shapely.affinity.translate(ground, draw.uniform(-1.5, 1.5), draw.uniform(-1.5, 1.5))
    low = draw.choice([-0.5, 0.0, 0.3, draw.uniform(0, 1.4), 1.6])
    mesh = trimesh.creation.extrude_polygon(ground, draw.choice([0.05, draw.uniform(0.2, 2.5)]))
    mesh.apply_translation((0, 0, low))
    return ground, mesh


@pytest.mark.parametrize("seed", range(60))
def test_lines_are_those_that_shapely_finds(seed: int) -> None:
    draw = random.Random(seed)
    ground, mesh = solid(draw)
    width = draw.uniform(0.5, 2)
    door = Pose.planar(draw.uniform(-9, 9), draw.uniform(-9, 9), draw.uniform(-4, 4), 3.0)
    low, high = mesh.bounds[:, 2]
    faces = door.apply(mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    found = taken_lines(door, width, faces)
    across = (np.arange(round(width / LINES)) + 0.5) * LINES - width / 2
    lines = shapely.linestrings([[(-WALL, y), (WALL, y)] for y in across])
    reaches = high > LOWEST and low < LINTEL
    near, surely = (
        shapely.intersects(ground.buffer(margin), lines) & reaches for margin in (LINES, -LINES)
    )
    if min(high, LINTEL) - max(low, LOWEST) > 0.02:
        assert (found >= surely).all()
    assert (found <= near).all()


def test_what_is_left_is_wide_enough_or_not() -> None:
    every = (np.arange(90) + 0.5) * LINES
    for left, passes in ((0.65, True), (0.55, False), (0.0, False)):
        assert closing(0.9, {"wall": every > left}) == ([] if passes else ["wall"])
        half = {"low": every < (0.89 - left) / 2, "high": every > (0.9 + left) / 2}
        assert bool(closing(0.9, half)) != passes
    assert closing(0.5, {"frame": every[:50] > 0.42}) == []  # nearly all of it is left
    assert closing(0.9, {"post": every < 0.05, "wall": every > 0.3}) == ["wall"]
    assert closing(0.9, {}) == []


@pytest.mark.parametrize("seed", range(20))
def test_a_robot_may_be_as_high_as_the_lowest_beam(seed: int) -> None:
    """Beams over an opening of 1.2 m, or over one half of it: a robot passes beneath the other."""
    draw = random.Random(seed)
    door = Pose.planar(draw.uniform(-9, 9), draw.uniform(-9, 9), draw.uniform(-4, 4), 3.0)
    beams, lowest = [], {"left": 9.0, "right": 9.0}
    for half in draw.sample(["left", "right", "both"], draw.randint(1, 3)):
        low = draw.uniform(0.2, 1.3)
        wide, y = {"left": (0.6, -0.3), "right": (0.6, 0.3), "both": (1.4, 0.0)}[half]
        at = trimesh.transformations.translation_matrix((0, y, low + 0.02))
        beams.append(trimesh.creation.box((0.1, wide, 0.04), transform=at).triangles)
        for side in lowest.keys() & {half} or lowest:
            lowest[side] = min(lowest[side], low)
    faces = door.apply(np.concatenate(beams).reshape(-1, 3)).reshape(-1, 3, 3)
    taken = {"beams": taken_lines(door, 1.2, faces)}
    assert bool(closing(1.2, taken)) == (max(lowest.values()) < LINTEL)
    if closing(1.2, taken):
        expected = max(lowest.values())
        assert clear_height(door, 1.2, [faces]) == pytest.approx(expected, abs=0.011)
