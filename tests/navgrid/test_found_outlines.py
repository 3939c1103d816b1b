"""Outlines of found rooms: straight and right-angled as walls are, slanted and round as others."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import affinity

from navgrid.found_rooms import find_rooms
from navgrid.room_segments import wall_heading
from semmap.geometry.mesh import prism_mesh
from semmap.query.storey_scene import SceneEntity, StoreyScene

ROOMS = (shapely.box(0, 0, 4, 5), shapely.box(4.2, 0, 9, 5))
DOOR = shapely.box(4, 1.3, 4.2, 2.2)
CUT = shapely.Polygon([(0, 0), (6, 0), (6, 4), (3, 6), (0, 6)])
ROUND = shapely.Point(3, 3).buffer(2.5)


def scene(space: shapely.Geometry) -> StoreyScene:
    """Walls of 0.2 m around free space, 2.6 m high."""
    mesh = prism_mesh(space.buffer(0.2, join_style="mitre").difference(space), 0.0, 2.6)
    wall = SceneEntity(1, "walls", "object", ("wall",), mesh.vertices[mesh.faces])
    return StoreyScene("s", 0.0, (wall,))


@pytest.mark.parametrize("turn", [0.0, 0.11, 0.5, np.pi / 4, 1.3])
def test_rooms_between_turned_walls_are_rectangles(turn: float) -> None:
    *rooms, door = (affinity.rotate(s, turn, (0, 0), use_radians=True) for s in (*ROOMS, DOOR))
    space = affinity.rotate(shapely.union_all([*ROOMS, DOOR]), turn, (0, 0), use_radians=True)
    found = find_rooms(scene(space))
    assert len(found.rooms) == 2
    for room in rooms:
        best = max((r.outline for r in found.rooms), key=lambda o: o.intersection(room).area)
        assert len(best.exterior.coords) == 5
        assert shapely.hausdorff_distance(best, room) < 0.1
        assert best.minimum_rotated_rectangle.area == pytest.approx(best.area)
    (way,) = found.doorways
    assert way.line.centroid.distance(door.centroid) < 0.1


@pytest.mark.parametrize("room", [CUT, ROUND])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_slanted_and_round_walls_stay_so(room: shapely.Polygon, turn: float) -> None:
    room = affinity.rotate(room, turn, (0, 0), use_radians=True)
    (found,) = find_rooms(scene(room)).rooms
    assert shapely.hausdorff_distance(found.outline, room) < 0.15
    assert found.outline.intersection(room).area > 0.96 * found.outline.union(room).area


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.78, 0.78))
def test_the_heading_is_that_of_most_walls(turn: float) -> None:
    lines = [shapely.box(0, y, 12, y + 0.2) for y in (0, 4, 8)]
    lines += [shapely.box(x, 0, x + 0.2, 8.2) for x in (0, 5, 12)]
    lines.append(affinity.rotate(shapely.box(6, 5, 8, 5.2), 30))
    walls = affinity.rotate(shapely.union_all(lines), turn, (0, 0), use_radians=True)
    y, x = np.mgrid[-240:240, -240:360] * 0.05
    found = wall_heading(shapely.contains_xy(walls, x, y))
    away = (found - turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
    assert abs(away) < np.radians(0.25)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(5, 40),
    st.sampled_from([-1, 1]),
    st.floats(0.8, 1.2),
    st.floats(-3, 3),
    st.floats(4, 6),
)
def test_a_door_in_a_slanted_wall_divides_two_rooms(
    turn: float, side: int, width: float, at: float, x: float
) -> None:
    outer = shapely.box(0, 0, 10, 8)
    wall, door = (
        affinity.translate(affinity.rotate(shape, side * turn, (0, 0)), x, 4)
        for shape in (shapely.box(-0.1, -20, 0.1, 20), shapely.box(-0.11, at, 0.11, at + width))
    )
    assume(outer.contains(door.buffer(0.1)))
    rooms = shapely.get_parts(outer.difference(wall))
    found = find_rooms(scene(shapely.union_all([*rooms, door])))
    (way,) = found.doorways
    assert way.line.centroid.distance(door.centroid) < 0.15
    (x0, y0), (x1, y1) = way.line.coords
    across = np.arctan2(y1 - y0, x1 - x0) - np.radians(90 + side * turn)
    assert abs(np.sin(across)) < 0.12
    assert len(found.rooms) == 2
    for room in rooms:
        best = max((r.outline for r in found.rooms), key=lambda o: o.intersection(room).area)
        assert best.intersection(room).area > 0.95 * best.union(room).area


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize(
    ("panel", "types", "height", "ways"),
    [
        (None, (), 0.9, 2),
        (shapely.box(6, 5.05, 8, 5.15), (), 0.9, 1),  # a sill
        (shapely.box(6, 5.05, 8, 5.15), ("object",), 0.9, 1),
        (shapely.box(6, 5.05, 8, 5.15), (), 0.1, 2),  # a threshold
        (shapely.box(6, 5.05, 8, 5.15), ("bench", "furniture"), 0.9, 2),
        (shapely.box(6, 5.05, 7, 5.15), (), 0.9, 2),  # half of the gap
        (shapely.box(6, 4.6, 8, 5.15), (), 0.9, 2),  # a chest before it
    ],
)
def test_a_gap_that_a_parapet_fills_is_no_doorway(
    panel: shapely.Polygon | None, types: tuple[str, ...], height: float, ways: int, turn: float
) -> None:
    gap = shapely.box(6, 5, 8, 5.2)
    space = shapely.union_all([*ROOMS, DOOR, gap])
    walls = shapely.union_all(ROOMS).buffer(0.2, join_style="mitre").difference(space)
    parts: list[tuple[shapely.Geometry, tuple[str, ...], float]] = [(walls, ("wall",), 2.6)]
    parts += [] if panel is None else [(panel, types, height)]
    entities = []
    for number, (outline, kinds, high) in enumerate(parts):
        turned = affinity.rotate(outline, turn, (0, 0), use_radians=True)
        mesh = prism_mesh(turned, 0.0, high)
        triangles = mesh.vertices[mesh.faces]
        made = SceneEntity(number, f"o{number}", "object", kinds, triangles, footprint=turned)
        entities.append(made)
    found = find_rooms(StoreyScene("s", 0.0, tuple(entities)))
    assert len(found.rooms) == 2
    assert len(found.doorways) == ways
