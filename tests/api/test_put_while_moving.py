"""An object is put on a table that another program moves at the same time."""

from __future__ import annotations

import threading

import pytest

import semmap
from tests.conftest import MakeDatabase


@pytest.mark.parametrize("on", ["table", "tray"])
def test_it_ends_on_the_new_place_of_the_table(make_database: MakeDatabase, on: str) -> None:
    """The move begins before the put and ends after it has begun."""
    address = make_database().render_as_string(hide_password=False)
    with semmap.connect(address) as db, semmap.connect(address) as other:
        made = db.create_map("shed")
        made.add_room("floor", [(0, 0), (9, 0), (9, 6), (0, 6)], floor=0, ceiling=3)
        made.add_object("table", type="table", size=(1.4, 1, 0.75), pose=(2, 2, 0, 0))
        made.add_object("tray", type="tray", size=(0.6, 0.4, 0.03), on="table")
        made.add_object("cup", type="cup", size=(0.08, 0.08, 0.1), pose=(5, 1, 0, 0))
        putting = threading.Thread(target=lambda: other.map("shed")["cup"].put_on(on))
        with made.transaction():
            made["table"].move_to(7, 4, 0, yaw=0.4)
            putting.start()
            putting.join(1.0)
        putting.join(20.0)
        assert not putting.is_alive()
        cup, below = made["cup"], made[on]
        assert cup.holder == below
        assert cup.box[2] == pytest.approx(below.box[5], abs=1e-6)
        assert below.footprint.contains(cup.footprint.centroid)
        assert made["table"].pose.x == pytest.approx(7)
