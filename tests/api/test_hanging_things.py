"""What hangs below a thing does not bear it; what is fixed to a wall bears what is smaller."""

from __future__ import annotations

import itertools

import pytest
import shapely

import semmap

ON_WALL = 0.125
"""The middle, in y, of what is 0.25 m deep and at the wall."""

UPPER = {  # name: type, size, middle in x, bottom
    "cupboard": ("cabinet", (0.8, 0.25, 0.7), 1.0, 1.5),
    "rack": ("shelf", (0.8, 0.25, 0.03), 3.0, 1.3),
    "screen": ("tv", (1.2, 0.06, 0.7), 5.0, 1.2),
}
LOWER = {
    "strip": ("lamp", (0.5, 0.06, 0.03), 1.0, 1.47),
    "cup": ("mug", (0.08, 0.08, 0.1), 3.0, 1.2),
    "speaker": ("box", (0.8, 0.06, 0.06), 5.0, 1.14),
}


@pytest.fixture
def kitchen(db: semmap.Database) -> semmap.Map:
    made = db.create_map("kitchen")
    made.add_room("kitchen", shapely.box(0, 0, 6, 4), floor=0, ceiling=2.8)
    made.add_object("slab", type="floor", size=(6.4, 4.4, 0.2), pose=(3, 2, -0.2, 0))
    made.add_object("back", type="wall", size=(6, 0.1, 2.8), pose=(3, -0.05, 0, 0))
    return made


@pytest.mark.parametrize("upper_first", [True, False])
def test_what_hangs_below_does_not_carry(kitchen: semmap.Map, upper_first: bool) -> None:
    order = [UPPER, LOWER] if upper_first else [LOWER, UPPER]
    for name, (kind, size, x, z) in itertools.chain(*(each.items() for each in order)):
        kitchen.add_object(name, type=kind, size=size, pose=(x, ON_WALL, z, 0))
    kitchen.add_object("dish", type="plate", size=(0.2, 0.2, 0.02), pose=(2.8, ON_WALL, 1.33, 0))
    room = kitchen["kitchen"]
    assert {name: kitchen[name].holder for name in UPPER} == dict.fromkeys(UPPER, room)
    assert kitchen["dish"].holder == kitchen["rack"]
    before = {name: kitchen[name].pose for name in (*UPPER, "dish")}
    for name in LOWER:
        kitchen[name].move_to(1, 3, 0)
    assert {name: kitchen[name].pose for name in before} == before


def test_a_gallery_is_not_on_the_lamp_below_it(db: semmap.Database) -> None:
    hall = db.create_map("hall")
    hall.add_room("hall", shapely.box(0, 0, 12, 8), floor=0, ceiling=6)
    hall.add_object("deck", type="slab", size=(4, 3, 0.2), pose=(10, 6.5, 2.6, 0), define=True)
    hall.add_object("lamp", type="lamp", size=(0.3, 0.3, 0.3), pose=(10, 6.5, 2.3, 0))
    hall.add_object("chair", type="chair", size=(0.5, 0.5, 0.9), pose=(10, 6.5, 2.8, 0))
    assert hall["deck"].holder == hall["hall"]
    assert hall["chair"].holder == hall["deck"]


def test_what_stands_or_is_larger_bears(kitchen: semmap.Map) -> None:
    """A tray on a mug on a table, a board on two trestles, and a book on a shelf at the wall."""
    kitchen.add_object("desk", type="table", size=(1, 0.8, 0.75), pose=(5, 3, 0, 0))
    kitchen.add_object("jug", type="mug", size=(0.08, 0.08, 0.1), pose=(5, 3, 0.75, 0))
    kitchen.add_object("tray", type="tray", size=(0.4, 0.3, 0.02), pose=(5, 3, 0.85, 0))
    for name, x in (("left", 1.2), ("right", 2.4)):
        kitchen.add_object(
            name, type="trestle", size=(0.1, 0.6, 0.7), pose=(x, 3, 0, 0), define=True
        )
    kitchen.add_object("board", type="box", size=(1.8, 0.6, 0.04), pose=(1.8, 3, 0.7, 0))
    kitchen.add_object("ledge", type="shelf", size=(0.8, 0.25, 0.03), pose=(3, ON_WALL, 1.3, 0))
    kitchen.add_object("novel", type="book", size=(0.2, 0.15, 0.04), pose=(3, ON_WALL, 1.33, 0))
    holders = {name: kitchen[name].holder for name in ("jug", "tray", "novel")}
    expected = {"jug": "desk", "tray": "jug", "novel": "ledge"}
    assert holders == {name: kitchen[of] for name, of in expected.items()}
    assert kitchen["board"].holder in (kitchen["left"], kitchen["right"])
