"""Pillars in halls divide nothing; pieces of wall between two doors do."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from navgrid.found_rooms import FoundRooms, find_rooms
from semmap.geometry.mesh import prism_mesh
from semmap.query.storey_scene import SceneEntity, StoreyScene

HEIGHT = 2.6


def entity(number: int, outline: shapely.Geometry, low: float, *types: str) -> SceneEntity:
    mesh = prism_mesh(outline, low, HEIGHT)
    triangles = mesh.vertices[mesh.faces]
    return SceneEntity(number, f"o{number}", "object", types, triangles)


def found_in(
    rooms: shapely.Geometry,
    doors: shapely.Geometry,
    pillars: Sequence[shapely.Polygon] = (),
    turn: float = 0.0,
    lintels: shapely.Geometry | None = None,
) -> FoundRooms:
    """What is found between walls of 0.2 m around rooms, and things without a type in them."""
    walls = rooms.buffer(0.2, join_style="mitre").difference(rooms).difference(doors)
    parts = [(walls, 0.0, "wall"), *((pillar, 0.0) for pillar in pillars)]
    if lintels is not None:
        parts.append((lintels, 2.1, "wall"))
    entities = [
        entity(i, affinity.rotate(outline, turn, (0, 0)), *rest)
        for i, (outline, *rest) in enumerate(parts)
    ]
    return find_rooms(StoreyScene("s", 0.0, tuple(entities)))


def pillar(x: float, y: float, size: float, is_round: bool) -> shapely.Polygon:
    middle = shapely.Point(x, y).buffer(size / 2)
    return middle if is_round else shapely.envelope(middle)


DOOR = shapely.box(-0.3, 0.8, 0, 1.8)


@settings(max_examples=20, deadline=None)
@given(
    st.integers(1, 3),
    st.integers(1, 3),
    st.floats(1.5, 5),
    st.floats(1.5, 5),
    st.floats(0.4, 3),
    st.floats(0.25, 0.48),
    st.booleans(),
    st.sampled_from([0.0, 20.0]),
)
def test_a_hall_of_pillars_is_one_room(
    columns: int,
    rows: int,
    across: float,
    along: float,
    margin: float,
    size: float,
    is_round: bool,
    turn: float,
) -> None:
    width, depth = ((n - 1) * d + 2 * margin + 1 for n, d in ((columns, across), (rows, along)))
    pillars = [
        pillar(margin + 0.5 + i * across, margin + 0.5 + j * along, size, is_round)
        for i in range(columns)
        for j in range(rows)
    ]

    found = found_in(shapely.box(0, 0, width, depth), DOOR, pillars, turn)

    (room,) = found.rooms
    assert shapely.Polygon(room.outline.exterior).area == pytest.approx(width * depth, rel=0.05)
    (door,) = found.doorways
    assert door.joins == (room.name, "outside")
    assert door.line.length == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("is_round", [False, True])
@pytest.mark.parametrize("beams", [False, True])
def test_six_pillars_and_the_beams_on_them_divide_nothing(is_round: bool, beams: bool) -> None:
    pillars = [pillar(x, y, 0.4, is_round) for x in (3, 6, 9) for y in (3, 6)]
    lines = shapely.MultiLineString([[(0, 3), (12, 3)], [(0, 6), (12, 6)]]).buffer(0.15)

    found = found_in(shapely.box(0, 0, 12, 9), DOOR, pillars, lintels=lines if beams else None)

    assert (len(found.rooms), len(found.doorways)) == (1, 1)


def test_a_pillar_near_a_corner_cuts_no_corner_off() -> None:
    found = found_in(shapely.box(0, 0, 5, 3.8), DOOR, [pillar(3.2, 2.0, 0.4, False)])

    assert (len(found.rooms), len(found.doorways)) == (1, 1)


@settings(max_examples=10, deadline=None)
@given(
    st.floats(0.25, 0.6),
    st.lists(st.floats(0.8, 1.8), min_size=2, max_size=3),
    st.floats(0.5, 1.5),
    st.booleans(),
)
def test_pieces_of_wall_between_doors_divide(
    piece: float, widths: list[float], start: float, lintels: bool
) -> None:
    depth = start + sum(widths) + piece * (len(widths) - 1) + 1.0
    doors, y = [], start
    for width in widths:
        doors.append(shapely.box(4, y, 4.2, y + width))
        y += width + piece
    openings = shapely.union_all(doors)
    rooms = shapely.box(0, 0, 4, depth), shapely.box(4.2, 0, 8.5, depth)

    found = found_in(
        shapely.union_all(rooms),
        openings,
        lintels=openings if lintels else None,
    )

    assert len(found.rooms) == 2
    lengths = sorted(doorway.line.length for doorway in found.doorways)
    assert lengths == pytest.approx(sorted(widths), abs=0.15)
