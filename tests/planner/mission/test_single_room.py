"""Missions in a map of one room without a door, and the door that makes a goal impossible."""

from __future__ import annotations

import pytest
import shapely

import semmap
from planner.tasks import NoPlanError
from tests.conftest import MakeDatabase

OUTLINE = [(0, 0), (5, 0), (5, 2), (2, 2), (2, 4), (0, 4)]


@pytest.fixture
def house(make_database: MakeDatabase):
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        made = db.create_map("house")
        made.add_room("studio", OUTLINE, floor=0, ceiling=2.5)
        made.add_object("desk", type="table", size=(1.0, 0.6, 0.72), pose=(4.2, 1.6, 0, 0))
        made.add_object("board", type="table", size=(0.8, 0.6, 0.7), pose=(0.6, 3.6, 0, 0))
        made.add_object("mug", type="mug", size=(0.08, 0.08, 0.1), on="desk")
        yield made


def test_a_robot_starts_on_free_floor_of_a_room_without_a_door(house, tmp_path) -> None:
    """By Shapely, the pose at which it starts is in the room, off the tables."""
    assert house.plan("on(mug, board)", start="studio").actions
    for goal, on in (("on(mug, desk)", "desk"), ("on(mug, board)", "board")):  # first, it stays
        world = tmp_path / f"{on}.sqlite"
        ended = house.run(goal, start="studio", speed=500.0, world=world)
        assert ended.done, ended.reason
        after = house.database.map(ended.map)
        assert after["mug"].holder.name == on
        pose = after["robot"].pose
        at = shapely.Point(pose.x, pose.y)
        assert shapely.Polygon(OUTLINE).contains(at)
        for name in ("desk", "board"):
            assert house[name].footprint.distance(at) > 0.15


def test_a_goal_names_the_locked_door_in_the_way(house) -> None:
    """A table stands in both rooms: what is on it counts for one, and the other is locked."""
    house.add_room("store", [(5.1, 0), (9, 0), (9, 4), (5.1, 4)], floor=0, ceiling=2.5)
    house.add_door("hatch", "studio", "store", ((5.05, 0.1), (5.05, 1.1)))
    house.add_object("shelf", type="table", size=(0.8, 0.5, 0.7), pose=(8, 3.6, 0, 0))
    house.add_object("bar", type="table", size=(0.9, 0.4, 0.9), pose=(5.2, 1.6, 0, 0))
    house.add_object("glass", type="glass", size=(0.06, 0.06, 0.12), pose=(4.84, 1.6, 0.9, 0))
    assert house["bar"].room.name == "store"
    assert house["glass"].room.name == "studio"
    assert house.plan("in(glass, store)", start="studio").actions
    house.doors["hatch"].state = "locked"
    with pytest.raises(NoPlanError, match="hatch is locked"):
        house.plan("in(glass, store)", start="studio")
