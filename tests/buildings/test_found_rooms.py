"""Rooms and doorways that a map finds in walls are those that random buildings were made of."""

from __future__ import annotations

from pathlib import Path

import semmap
from tests.buildings.building import random_building
from tests.buildings.found_rooms import Scores, judge, without_rooms
from tests.conftest import MakeDatabase

SEEDS = range(20, 26)


def test_most_rooms_and_doorways_are_found(make_database: MakeDatabase, tmp_path: Path) -> None:
    scores = Scores()
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        for seed in SEEDS:
            judge(random_building(seed, plain=True), database, tmp_path, scores)
    rooms, doors, lifts = scores.rooms, scores.doors, scores.lifts
    assert rooms.known > 50
    assert min(rooms.recall, rooms.precision, doors.recall, doors.precision) >= 0.9, (rooms, doors)
    assert (lifts.precision, lifts.recall) >= (1, 0.5), lifts
    assert scores.other is not None
    assert 0.7 < scores.other.rooms.recall < rooms.recall


def test_a_robot_takes_a_lift_that_was_found(make_database: MakeDatabase, tmp_path: Path) -> None:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        for path in without_rooms(random_building(503, plain=True), tmp_path):
            database.import_file(path, map="bare")
        bare = database.map("bare")
        (lift,) = (lift for storey in bare.find_rooms(add=True) for lift in storey.lifts)
        assert {bare.rooms[name].type for name in lift.cabins} == {"elevator_cabin"}
        route = bare.route(lift.cabins[0], lift.cabins[-1])
        assert "use_elevator" in {step.behaviour for step in route.steps}
        assert not any(storey.lifts for storey in bare.find_rooms()), "it is there already"
