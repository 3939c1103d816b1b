"""What stands on a smaller thing is on it: it moves along, and is taken off first."""

from __future__ import annotations

import pytest
import trimesh

import semmap


@pytest.fixture
def stack(db: semmap.Database) -> semmap.Map:
    """A tray on a mug, and a crate on the tray, on a counter; the mug is a hollow cylinder."""
    made = db.create_map("canteen")
    made.add_storey("ground", height=3)
    made.add_room("galley", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0, ceiling=2.7)
    for number, x in enumerate((2.0, 4.0), 1):
        made.add_object(f"counter{number}", type="table", size=(1.0, 0.7, 0.8), pose=(x, 4, 0))
    mug = trimesh.creation.annulus(0.03, 0.036, 0.1)
    mug.apply_translation((0, 0, 0.05))
    made.add_object("goblet", type="mug", mesh=mug, pose=(2, 4, 0.8))
    made.add_object("salver", type="tray", size=(0.4, 0.3, 0.02), pose=(2.02, 4.01, 0.9))
    made.add_object("parcel", type="box", size=(0.06, 0.06, 0.1), pose=(2.02, 4.01, 0.92))
    return made


def test_each_is_on_the_one_below(stack: semmap.Map) -> None:
    chain = [stack[name].holder.name for name in ("parcel", "salver", "goblet")]
    assert chain == ["salver", "goblet", "counter1"]
    assert [e.name for e in stack.find("tray", on="goblet")] == ["salver"]


def test_a_move_of_the_lowest_moves_all(stack: semmap.Map) -> None:
    stack["goblet"].move_to(4, 4, 0.8)
    assert stack["parcel"].pose[:3] == pytest.approx((4.02, 4.01, 0.92))
    assert stack["goblet"].holder == stack["counter2"]
    test = [stack[name].holder.name for name in ("parcel", "salver")]
    assert test == ["salver", "goblet"]


def test_a_plan_takes_off_what_stands_on_a_thing(stack: semmap.Map) -> None:
    plan = stack.plan("on(goblet, counter2)", start="galley")
    names = [action.names[0] for action in plan.actions if action.name == "pickup"]
    assert names.index("salver") < names.index("goblet")
    assert "parcel" not in names[names.index("goblet") :]
