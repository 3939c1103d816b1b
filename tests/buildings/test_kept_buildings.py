"""Random buildings of which a map was wrong once agree with independent judges."""

from __future__ import annotations

from pathlib import Path

import pytest

from planner.route import NoRouteError
from tests.buildings.building import random_building
from tests.buildings.clouds import scanned
from tests.buildings.judges import judge_routes, judge_steps, stored
from tests.buildings.missions import judge_missions
from tests.conftest import MakeDatabase
from tests.effort import effort

WITHOUT_WALLS = effort([98705], [98705, 98709, 98713])
WITH_CABINS = [112, 8168]
"""Seeds of buildings with things in cabins, and before their doors."""

MISSIONS = [99533, 99566, 99676]
"""Seeds of buildings in whose missions the arm touched furniture, or its grasp fitted no place at
the base, or which began in the wrong part of a room."""


@pytest.mark.parametrize("seed", WITH_CABINS)
def test_a_ride_does_not_need_the_way_through_the_door(
    seed: int, make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = random_building(seed)
    assert any(room.elevator for room in building.rooms)
    url = make_database().render_as_string(hide_password=False)
    with stored(building, url, tmp_path) as place:
        for judge in (judge_routes, judge_steps):
            asked, wrong = judge(building, place)
            assert wrong == []
            assert asked > 1


def test_a_thing_that_leaves_a_cabin_no_longer_closes_its_door(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = random_building(WITH_CABINS[0])
    room, cabin = next(d.rooms for d in building.doors if d.type == "elevator_door")
    (thing,) = (item for item in building.items if building.room(cabin).outline.covers(item.ground))
    url = make_database().render_as_string(hide_password=False)
    with stored(building, url, tmp_path) as place:
        (x, y), z = thing.centre, place[thing.name].pose.z
        for _ in range(2):
            with pytest.raises(NoRouteError, match=f"{thing.name} leaves robot no way through"):
                place.route(room, cabin)
            place[thing.name].move_to(x + 100, y, z)
            assert place.route(room, cabin).places == [room, cabin]
            place[thing.name].move_to(x, y, z)


@pytest.mark.parametrize("seed", MISSIONS)
def test_a_mission_does_what_its_plan_promises(
    seed: int, make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = scanned(random_building(seed))
    url = make_database().render_as_string(hide_password=False)
    with stored(building, url, tmp_path) as place:
        asked, wrong = judge_missions(building, place)
    assert wrong == []
    assert asked > 0


@pytest.mark.explore
@pytest.mark.parametrize("seed", WITHOUT_WALLS)
def test_rooms_without_walls_end_at_their_outlines(
    seed: int, make_database: MakeDatabase, tmp_path: Path
) -> None:
    """Where the judges know walls, the map has none: its outlines are the faces of these."""
    building = random_building(seed, plain=True)
    url = make_database().render_as_string(hide_password=False)
    with stored(building, url, tmp_path) as place:
        for item in building.items:
            if item.what == "wall" and not any(
                room.outline.buffer(-1e-3).intersects(item.ground) for room in building.rooms
            ):
                place[item.name].delete()
        for judge in (judge_routes, judge_steps):
            asked, wrong = judge(building, place)
            assert wrong == []
            assert asked > 1
