"""Support surfaces of furniture by hand and of random stacks, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import support_surfaces

LEGS = [box_mesh((x, y, 0), (x + 0.05, y + 0.05, 0.72)) for x in (0, 1.15) for y in (0, 0.55)]
TABLE = join([*LEGS, box_mesh((0, 0, 0.72), (1.2, 0.6, 0.75))])
SHELF = join(
    [
        box_mesh((0, 0, 0), (0.02, 0.3, 1.0)),
        box_mesh((0.98, 0, 0), (1.0, 0.3, 1.0)),
        *[box_mesh((0.02, 0, z - 0.02), (0.98, 0.3, z)) for z in (0.1, 0.4, 0.7, 1.0)],
    ]
)


def heights(mesh: Mesh) -> list[float]:
    return [round(s.height, 4) for s in support_surfaces(mesh)]


def test_a_table_has_one_surface() -> None:
    (top,) = support_surfaces(TABLE)
    assert top.height == pytest.approx(0.75)
    assert top.area == pytest.approx(0.72, rel=0.02)
    assert top.outline.hausdorff_distance(shapely.box(0, 0, 1.2, 0.6)) < 0.01
    corners = TABLE.triangles[top.faces]
    assert np.allclose(corners[:, :, 2], 0.75)


def test_a_shelf_has_one_a_board() -> None:
    assert heights(SHELF) == [1.0, 0.7, 0.4, 0.1]


def test_parted_vertices_and_turned_normals_do_not_part_a_surface() -> None:
    soup = TABLE.triangles.reshape(-1, 3)
    soup = soup + np.random.default_rng(4).uniform(-5e-4, 5e-4, soup.shape)
    parted = Mesh(soup, np.arange(len(soup), dtype=np.int32).reshape(-1, 3))
    inside_out = Mesh(TABLE.vertices, np.ascontiguousarray(TABLE.faces[:, ::-1]))
    for mesh in (parted, inside_out):
        (top,) = support_surfaces(mesh)
        assert top.height == pytest.approx(0.75, abs=1e-3)


@pytest.mark.parametrize(
    ("tilt", "level", "count"), [(0, 0.005, 1), (4, 0.05, 1), (6, 0.05, 0), (90, 0.005, 1)]
)
def test_a_board_supports_up_to_five_degrees(tilt: float, level: float, count: int) -> None:
    board = box_mesh((0, 0, 0), (0.6, 0.4, 0.02))
    turned = board.moved(Pose.from_rpy(0, 0, 1, np.radians(tilt), 0, 0.3))
    found = support_surfaces(turned, min_area=0.005, level=level)
    assert len(found) == count


def test_what_is_covered_bears_nothing() -> None:
    book = box_mesh((0.2, 0.2, 0.755), (0.6, 0.5, 0.78))
    both = join([TABLE, book])
    areas = {round(s.height, 3): s.area for s in support_surfaces(both)}
    assert areas[0.78] == pytest.approx(0.12, rel=0.05)
    assert areas[0.75] == pytest.approx(0.72 - 0.12, rel=0.05)


@settings(max_examples=25, deadline=None)
@given(
    boxes=st.lists(
        st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 6), st.integers(2, 9)),
        min_size=1,
        max_size=5,
        unique_by=lambda b: b[3],
    ),
    yaw=st.floats(-3, 3),
)
def test_tops_of_random_piles(boxes: list[tuple[int, int, int, int]], yaw: float) -> None:
    """Boxes on the ground, of whole decimetres: a top is free where no higher box stands."""
    mesh = join(
        [
            box_mesh((x / 10, y / 10, 0), ((x + w) / 10, (y + w) / 10, h / 10))
            for x, y, w, h in boxes
        ]
    )
    found = support_surfaces(mesh.moved(Pose.planar(1, 2, yaw)), min_area=0.005)
    for x, y, w, h in boxes:
        top = shapely.box(x / 10, y / 10, (x + w) / 10, (y + w) / 10)
        for x2, y2, w2, h2 in boxes:
            if h2 > h:
                higher = shapely.box(x2 / 10, y2 / 10, (x2 + w2) / 10, (y2 + w2) / 10)
                top = top.difference(higher)
        got = sum(s.area for s in found if abs(s.height - h / 10) < 1e-6)
        assert got == pytest.approx(top.area, abs=0.02)


def test_nothing_has_no_surface() -> None:
    assert support_surfaces(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))) == []
