"""The ground that a mesh covers, against the union of its projected triangles by Shapely."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from semmap.geometry.cell_outline import cell_outline
from semmap.geometry.ground_outline import (
    CELL,
    CELLS,
    FEW,
    FULL,
    LEAST,
    ground_outline,
    leaning_outline,
)
from semmap.geometry.mesh import Mesh, box_mesh, join, prism_mesh
from semmap.geometry.outline import hull_points
from semmap.geometry.pose import Pose

shapes = st.sampled_from(["L", "U", "T", "ring", "two", "box", "disc"])


def plan_of(shape: str, wide: float, deep: float, arm: float) -> shapely.Geometry:
    """A shape of furniture seen from above; its arms are `arm` of its sides."""
    whole, w, d = shapely.box(0, 0, wide, deep), arm * wide, arm * deep
    cut = {
        "L": shapely.box(w, d, wide, deep),
        "U": shapely.box(w, d, wide - w, deep),
        "T": shapely.box(0, 0, (wide - w) / 2, deep - d)
        | shapely.box((wide + w) / 2, 0, wide, deep - d),
        "ring": shapely.box(w, d, wide - w, deep - d),
        "two": shapely.box(w, 0, wide - w, deep),
        "box": shapely.Polygon(),
        "disc": shapely.Polygon(),
    }[shape]
    if shape == "disc":
        return shapely.affinity.scale(shapely.Point(0, 0).buffer(0.5), wide, deep)
    return whole - cut


def outline_of(mesh: Mesh) -> shapely.MultiPolygon | None:
    """The outline of a mesh on the ground."""
    return ground_outline(mesh, hull_points(mesh))


def split(mesh: Mesh, times: int) -> Mesh:
    """The same surface of four times as many triangles, so often."""
    corners = mesh.triangles
    for _ in range(times):
        a, b, c = (corners[:, k] for k in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate(
            [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return Mesh.of_triangles(corners)


def projection(mesh: Mesh) -> shapely.Geometry:
    """The union of the projected triangles, upright ones as lines."""
    flat = shapely.polygons(mesh.triangles[:, :, :2])
    wide = shapely.area(flat) > 1e-12
    return shapely.union_all([*flat[wide], *shapely.boundary(flat[~wide])])


def tolerance(mesh: Mesh) -> float:
    """Metres that an outline may reach further than the projection."""
    longest = float(np.ptp(mesh.used[:, :2], axis=0).max())
    return 2e-3 if len(mesh.faces) <= FEW else 5 * max(CELL, longest / CELLS)


def judge(mesh: Mesh) -> shapely.Geometry:
    """The outline of a mesh, or its hull; it contains the projection and reaches little further."""
    wanted, hull = projection(mesh), shapely.MultiPoint(mesh.used[:, :2]).convex_hull
    near = tolerance(mesh)
    found = outline_of(mesh)
    if found is None:
        grown = wanted.buffer(near, join_style="mitre") & hull
        assert grown.area >= min(FULL * hull.area, hull.area - LEAST) - 1e-9
        return hull
    assert found.is_valid
    assert found.area < FULL * hull.area
    assert found.area < hull.area - LEAST
    assert wanted.difference(found.buffer(2e-6)).is_empty
    beyond = found - wanted.buffer(near)
    assert all(part.area < LEAST for part in shapely.get_parts(beyond)), "more than closed holes"
    assert found.difference(hull.buffer(1e-9)).area < 1e-9
    return found


@settings(max_examples=40)
@given(
    shapes,
    st.floats(0.3, 8),
    st.floats(0.3, 4),
    st.floats(0.1, 0.45),
    st.floats(-math.pi, math.pi),
    st.integers(0, 4),
)
def test_random_furniture_covers_what_its_triangles_do(
    shape: str, wide: float, deep: float, arm: float, turn: float, times: int
) -> None:
    plan = plan_of(shape, wide, deep, arm)
    mesh = split(prism_mesh(plan, 0.0, 0.8), times).moved(Pose.planar(3.0, -2.0, turn))
    found = judge(mesh)
    if len(mesh.faces) <= FEW and plan.area < FULL * plan.convex_hull.area - LEAST:
        wanted = shapely.affinity.rotate(plan, turn, origin=(0, 0), use_radians=True)
        wanted = shapely.affinity.translate(wanted, 3.0, -2.0)
        assert found.symmetric_difference(wanted).area < 1e-5 + LEAST * (shape == "ring")


@settings(max_examples=30)
@given(st.integers(1, 400), st.integers(0, 2**32 - 1), st.floats(0.01, 1))
def test_random_triangles_are_covered(count: int, seed: int, size: float) -> None:
    chance = np.random.default_rng(seed)
    middles = chance.uniform(-1, 1, (count, 1, 3))
    judge(Mesh.of_triangles(middles + size * chance.uniform(-1, 1, (count, 3, 3))))


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 9), st.floats(0, 1))
def test_the_outline_of_cells_is_their_union(
    seed: int, rows: int, columns: int, share: float
) -> None:
    cells = np.pad(np.random.default_rng(seed).random((rows, columns)) < share, 1)
    r, c = np.nonzero(cells)
    wanted = shapely.union_all(shapely.box(c, r, c + 1, r + 1))
    assert cell_outline(cells).symmetric_difference(wanted).area == 0


def test_sheets_without_thickness_are_covered() -> None:
    def sheet(a: tuple[float, float], b: tuple[float, float]) -> Mesh:
        corners = np.array([(*a, 0), (*b, 0), (*b, 1), (*a, 1)], float)
        return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))

    screen = join([sheet((0, 0), (2, 0)), sheet((2, 0), (2, 2)), sheet((0, 0), (0, 2))])
    for mesh in (screen, split(screen, 4)):
        found = judge(mesh)
        assert not found.contains(shapely.Point(1, 1))
        assert found.contains(shapely.Point(1, 0).buffer(1e-4) & shapely.box(0, 0, 2, 2))


def test_a_hole_that_matters_is_kept() -> None:
    def ring(hole: float) -> Mesh:
        return prism_mesh(shapely.box(0, 0, 1, 1) - shapely.box(0.3, 0.3, 0.3 + hole, 0.7), 0, 1)

    for times in (0, 3):
        found = outline_of(split(ring(0.4), times))
        assert found is not None
        assert not found.covers(shapely.Point(0.5, 0.5))
        assert outline_of(split(ring(0.02), times)) is None


@pytest.mark.parametrize("size", [1e-300, 1e-9, 1e-3, 1e4, 1e9])
@pytest.mark.parametrize("count", [30, 3000])
def test_any_size_gives_an_outline_or_none(size: float, count: int) -> None:
    chance: NDArray[np.float64] = np.random.default_rng(4).uniform(-0.5, 0.5, (count, 3))
    chance[: count // 2, 0] = 0.4  # an L, where it has one
    found = outline_of(Mesh(chance * size, np.arange(count, dtype=np.int32).reshape(-1, 3)))
    assert found is None or found.is_valid


def test_a_line_or_point_has_none() -> None:
    for scale in ((1, 0, 1), (0, 0, 1), (0, 0, 0)):
        vertices = np.random.default_rng(3).uniform(-1, 1, (30, 3)) * scale
        assert outline_of(Mesh(vertices, np.arange(30, dtype=np.int32).reshape(-1, 3))) is None


def test_the_time_follows_from_cells_not_from_triangles() -> None:
    mesh = split(prism_mesh(plan_of("L", 3, 2, 0.3), 0, 1), 7)
    assert len(mesh.faces) > 2.5e5
    corners = hull_points(mesh)
    start = time.process_time()
    found = ground_outline(mesh, corners)
    assert time.process_time() - start < 2
    assert found is not None
    assert found.area == pytest.approx(plan_of("L", 3, 2, 0.3).area, rel=0.03)


@settings(max_examples=60)
@given(shapes, st.floats(0, 0.45), st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_what_leans_is_above_its_ground(
    shape: str, lean: float, towards: float, turn: float
) -> None:
    plan = plan_of(shape, 2, 1.5, 0.3)
    mesh = prism_mesh(plan, 0.3, 1.5)
    pose = Pose.from_rpy(1, 2, 3, lean * math.cos(towards), lean * math.sin(towards), turn)
    ground = leaning_outline(plan, hull_points(mesh), pose)
    assert ground is not None
    wanted = projection(mesh.moved(pose))
    assert wanted.difference(ground.buffer(1e-9)).area < 1e-9
    furthest = 1.2 * math.sin(min(2 * lean, 1.5)) + 1e-3
    assert ground.difference(wanted.buffer(furthest)).area < 1e-9
    assert leaning_outline(plan, hull_points(mesh), Pose.from_rpy(0, 0, 0, 0.6, 0, 0)) is None
    assert leaning_outline(plan, hull_points(mesh), Pose.from_rpy(0, 0, 0, 3.1, 0, 0)) is None


def test_a_box_is_its_hull() -> None:
    assert outline_of(box_mesh((0, 0, 0), (2, 1, 1)).moved(Pose.planar(3, 4, 0.5))) is None
