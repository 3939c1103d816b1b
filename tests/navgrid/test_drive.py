"""Ways of a shape against SciPy and shapely: each motion is sampled finely, pose by pose."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navgrid.costmap import Costmap
from navgrid.grid import Grid
from navgrid.headings import HEADINGS, MOVES, DriveSpace, drive, drive_space, drive_way, hits
from semmap.robot import Part
from tests.navgrid.scenes import part, room, scene, solid, square
from tests.oracles.drive import scipy_prices

SIZE = (14, 16)
RES = 0.1
corners = st.lists(st.tuples(st.floats(-0.5, 0.7), st.floats(-0.4, 0.4)), min_size=3, max_size=6)


def placed(footprint: NDArray[np.float64], x: float, y: float, yaw: float) -> shapely.Polygon:
    turned = shapely.affinity.rotate(shapely.Polygon(footprint), yaw, (0, 0), use_radians=True)
    return shapely.affinity.translate(turned, x, y)


def middle(row: float, column: float) -> tuple[float, float]:
    return (column + 0.5) * RES, (row + 0.5) * RES


def obstacles(occupied: NDArray[np.bool_]) -> shapely.Geometry:
    r, c = np.nonzero(occupied)
    return shapely.union_all(shapely.box(c * RES, r * RES, (c + 1) * RES, (r + 1) * RES))


def space_of(occupied: NDArray[np.bool_], footprint: NDArray[np.float64]) -> DriveSpace:
    return DriveSpace(
        *(~hits(occupied, footprint, RES, motion) for motion in ("stand", "step", "turn"))
    )


def draw(points: list[tuple[float, float]], seed: int, share: float):
    hull = shapely.MultiPoint(points).convex_hull
    assume(hull.area > 0.01)
    footprint = np.array(shapely.geometry.polygon.orient(hull).exterior.coords)[:-1]
    return footprint, np.random.default_rng(seed).random(SIZE) < share


@settings(max_examples=15)
@given(corners, st.integers(0, 2**32 - 1), st.floats(0.005, 0.05))
def test_motions_hit_what_shapely_meets(
    points: list[tuple[float, float]], seed: int, share: float
) -> None:
    """A standing footprint exactly; a step and a turn at least all poses on their way."""
    footprint, occupied = draw(points, seed, share)
    blocks = obstacles(occupied)
    found = space_of(occupied, footprint)
    rng = np.random.default_rng(seed)
    for row, column, h in zip(*(rng.integers(0, n, 120) for n in (*SIZE, 16)), strict=True):
        x, y = middle(row, column)
        here = placed(footprint, x, y, HEADINGS[h])
        fits = bool(found.fits[row, column] >> h & 1)
        if here.intersection(blocks).area > 1e-9:
            assert not fits
        if here.distance(blocks) > 1e-9:
            assert fits
        rows, columns = MOVES[h]
        after = HEADINGS[(h + 1) % 16] + 2 * math.pi * (h == 15)
        for share_ in np.linspace(0, 1, 7):
            ahead = placed(
                footprint, x + share_ * columns * RES, y + share_ * rows * RES, HEADINGS[h]
            )
            turned = placed(footprint, x, y, HEADINGS[h] + share_ * (after - HEADINGS[h]))
            if ahead.intersection(blocks).area > 1e-9:
                assert not found.steps[row, column] >> h & 1
            if turned.intersection(blocks).area > 1e-9:
                assert not found.turns[row, column] >> h & 1


@settings(max_examples=12)
@given(corners, st.integers(0, 2**32 - 1), st.floats(0.005, 0.04), st.floats(0, 3))
def test_ways_are_the_cheapest_and_can_be_driven(
    points: list[tuple[float, float]], seed: int, share: float, slow: float
) -> None:
    footprint, occupied = draw(points, seed, share)
    space = space_of(occupied, footprint)
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 255, SIZE).astype(np.uint8)
    costs[rng.random(SIZE) < 0.03] = 255
    starts = np.stack([rng.integers(0, n, 2) for n in SIZE], 1)
    targets = np.stack([rng.integers(0, n, 9) for n in SIZE], 1)
    prices, metres = drive(costs, space, RES, starts, targets, slow=slow)
    many, _ = drive(costs, space, RES, starts, targets, slow=slow, threads=3)
    np.testing.assert_array_equal(prices, many)
    back, _ = drive(costs, space, RES, targets, starts, slow=slow)
    np.testing.assert_allclose(back.T, prices)
    blocks = obstacles(occupied)
    for i, start in enumerate(starts):
        wanted = scipy_prices(costs, space, RES, slow, (int(start[0]), int(start[1])))
        np.testing.assert_allclose(prices[i], wanted[tuple(targets.T)], atol=1e-9)
        for j, target in enumerate(targets):
            way = drive_way(costs, space, RES, start, target, slow=slow)
            assert (way is None) == math.isinf(prices[i, j])
            if way is None:
                continue
            np.testing.assert_array_equal(way[[0, -1], :2], [start, target])
            lengths = np.hypot(*np.diff(way[:, :2], axis=0).T)
            assert lengths.sum() * RES == pytest.approx(metres[i, j])
            for before, after in pairwise(way):
                h = after[2]  # the heading of the step; before it, the robot turns
                assert tuple(after[:2] - before[:2]) in (MOVES[h], MOVES[(h + 8) % 16])
                for share_ in (0.0, 0.5, 1.0):
                    at = middle(*(before[:2] + share_ * (after[:2] - before[:2])))
                    body = placed(footprint, *at, HEADINGS[h])
                    assert body.intersection(blocks).area < 1e-9


def corridor(width: float) -> list:
    walls = [((0, 0, 0), (6, 1, 1)), ((0, 1 + width, 0), (6, 2 + width, 1))]
    return [solid(n, *ends, "wall", "building_element") for n, ends in enumerate(walls)]


def ends_of(made: Costmap) -> tuple[tuple[int, int], tuple[int, int]]:
    y = made.grid.resolution * made.grid.shape[0] / 2
    return made.grid.cell(1.5, y), made.grid.cell(4.5, y)


@pytest.mark.parametrize(("width", "passes"), [(0.6, True), (0.35, False)])
def test_an_arm_ahead_closes_no_corridor_that_it_fits_through(width: float, passes: bool) -> None:
    """A base of 0.4 m with an arm that reaches 0.86 m ahead: as a disc it would need 1.72 m."""
    base = part("base", 0.0, 0.3, square(0.2))
    arm = part("arm", 0.3, 0.9, [[0.18, -0.025], [0.86, -0.025], [0.86, 0.025], [0.18, 0.025]])
    floor = room("hall", 0, 0, 6, 2 + width)
    grid = Grid((0.0, 0.0), 0.02, (round((2 + width) / 0.02), 300))
    made = Costmap(scene(*corridor(width), floors=(floor,)), [base, arm], grid)
    window = (slice(0, grid.shape[0]), slice(0, grid.shape[1]))
    start, goal = ends_of(made)
    way = drive_way(made.master, drive_space(made, window), 0.02, start, goal)
    assert (way is not None) == passes
    if way is not None:  # lengthways: it has no space to turn
        assert {int(h) for h in way[:, 2]} <= {0, 8}


def arm_ahead(x: float) -> Part:
    return part(
        "arm",
        0.3,
        0.9,
        [[x - 0.34, -0.025], [x + 0.34, -0.025], [x + 0.34, 0.025], [x - 0.34, 0.025]],
    )


def test_blocked_cells_change_little_as_a_part_moves_off_the_axis() -> None:
    """A disc of the circumscribed radius would block 5 times the cells from one centimetre on."""
    rng = np.random.default_rng(3)
    crates = [
        solid(n, (x, y, 0), (x + 0.3, y + 0.3, 1), "crate")
        for n, (x, y) in enumerate(rng.uniform(0.5, 5.5, (14, 2)))
    ]
    hall = scene(*crates, floors=(room("hall", 0, 0, 6, 6),))
    grid = Grid((0.0, 0.0), 0.05, (120, 120))
    blocked = [
        Costmap(hall, [arm_ahead(x)], grid).master >= 253 for x in np.arange(0.28, 0.53, 0.02)
    ]
    for before, after in pairwise(blocked):
        assert after.sum() < 1.1 * before.sum()
        for one, other in ((before, after), (after, before)):
            inwards = np.asarray(distance_transform_edt(one))
            assert inwards[one & ~other].max(initial=0) < 2.5, "at the border alone"
