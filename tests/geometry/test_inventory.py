"""Holders of hand-made and random scenes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.inventory import Holding, RoomSpace, SurfacePatch, Thing, derive_holders

ROOM = RoomSpace(100, shapely.box(0, 0, 5, 4), 0.0, 2.5)
OTHER = RoomSpace(101, shapely.box(5.1, 0, 9, 4), 0.0, 2.5)
UPPER = RoomSpace(102, shapely.box(0, 0, 5, 4), 3.0, 5.5)


def box(id_: int, x: float, y: float, z: float, w: float, d: float, h: float) -> Thing:
    return Thing(id_, np.array([[x, y, z], [x + w, y + d, z + h]]), shapely.box(x, y, x + w, y + d))


def top(thing: Thing) -> SurfacePatch:
    low, high = (float(z) for z in thing.box[:, 2])
    return SurfacePatch(thing.id, low, high, thing.footprint)  # type: ignore[arg-type]


TABLE = box(1, 1, 1, 0, 1.2, 0.6, 0.75)
TRAY = box(2, 1.1, 1.1, 0.75, 0.4, 0.3, 0.04)


@pytest.mark.parametrize(
    ("thing", "expected"),
    [
        (box(3, 1.2, 1.2, 0.75, 0.1, 0.1, 0.1), Holding(1, 1.0, "on")),
        (box(3, 1.2, 1.2, 0.79, 0.05, 0.05, 0.1), Holding(2, 1.0, "on")),
        (box(3, 1.2, 1.2, 0.0, 0.1, 0.1, 0.1), Holding(100, 1.0, "in")),
        (box(3, 1.2, 1.2, 3.0, 0.1, 0.1, 0.1), Holding(102, 1.0, "in")),
        (box(3, 1.2, 1.2, 1.5, 0.1, 0.1, 0.1), Holding(100, 1.0, "in")),
        (box(3, 20, 20, 0.0, 0.1, 0.1, 0.1), Holding(None, 1.0, "in")),
        (box(3, -0.3, 1.0, 0.0, 0.5, 0.5, 0.1), Holding(None, 1.0, "in")),
    ],
    ids=["on-table", "on-tray", "under-table", "upstairs", "hanging", "outside", "mostly-outside"],
)
def test_holder(thing: Thing, expected: Holding) -> None:
    things = [TABLE, TRAY, thing]
    surfaces = [top(TABLE), top(TRAY)]
    assert derive_holders(things, surfaces, [ROOM, OTHER, UPPER])[3] == expected


def test_confidence_falls_where_it_is_close() -> None:
    edge = box(3, 2.14, 1.2, 0.75, 0.1, 0.1, 0.1)  # 60 % on the table
    hovering = box(4, 1.2, 1.2, 0.77, 0.1, 0.1, 0.1)
    sill = box(5, 4.7, 2, 0, 0.5, 0.5, 0.5)  # 60 % in the room
    held = derive_holders([TABLE, edge, hovering, sill], [top(TABLE)], [ROOM, OTHER])
    assert (held[3].holder, held[3].relation) == (1, "on")
    assert held[3].confidence == pytest.approx(0.6)
    assert (held[4].holder, held[4].confidence) == (1, pytest.approx(2 / 3))
    assert (held[5].holder, held[5].confidence) == (100, pytest.approx(0.6))


def test_a_tall_shelf_does_not_hold_the_table_it_overlaps() -> None:
    shelf = box(6, 2.19, 1, 0, 0.4, 0.6, 2.0)
    assert derive_holders([TABLE, shelf], [top(TABLE), top(shelf)], [ROOM])[1].holder == 100


def test_things_at_one_place_do_not_hold_each_other() -> None:
    ledge = box(8, 1, 1, 0.5, 1, 0.1, 0.02)
    twin = box(9, 1, 1, 0.5, 1, 0.1, 0.02)
    held = derive_holders([ledge, twin], [top(ledge), top(twin)], [ROOM])
    assert (held[8].holder, held[9].holder) == (100, 100)


def test_a_flat_tray_holds_what_lies_on_it() -> None:
    tray = box(2, 1.1, 1.1, 0.75, 0.4, 0.3, 0.01)
    cup = box(3, 1.2, 1.2, 0.76, 0.1, 0.1, 0.1)
    held = derive_holders([TABLE, tray, cup], [top(TABLE), top(tray)], [ROOM])
    assert (held[2].holder, held[3].holder) == (1, 2)


def test_carpets_hold_nobody() -> None:
    carpet = box(7, 0.5, 0.5, 0, 3, 3, 0.01)
    held = derive_holders([TABLE, carpet], [top(TABLE), top(carpet)], [ROOM])
    assert held[1].holder == 100


@settings(max_examples=60, deadline=None)
@given(
    boxes=st.lists(
        st.tuples(st.integers(0, 6), st.integers(0, 6), st.integers(0, 4), st.integers(1, 5),
                  st.integers(1, 4)),
        min_size=1, max_size=8,
    )
)  # fmt: skip
def test_random_piles_against_brute_force(boxes: list[tuple[int, int, int, int, int]]) -> None:
    """On a lattice of decimetres the share of a footprint is counted cell by cell."""
    things = [
        box(i, x / 10, y / 10, z / 10, w / 10, w / 10, h / 10)
        for i, (x, y, z, w, h) in enumerate(boxes)
    ]
    held = derive_holders(things, [top(t) for t in things], [])

    def cells(i: int) -> set[tuple[int, int]]:
        x, y, _, w, _ = boxes[i]
        return {(x + a, y + b) for a in range(w) for b in range(w)}

    for i, (_, _, z, w, _) in enumerate(boxes):
        shares = {
            j: len(cells(i) & cells(j)) / w**2
            for j in range(len(boxes))
            if j != i and boxes[j][2] + boxes[j][4] == z
        }
        best = max(shares.values(), default=0.0)
        if best >= 0.5:
            assert held[i].holder in {j for j, s in shares.items() if s > best - 1e-6}
            assert held[i].relation == "on"
        else:
            assert held[i].holder is None
