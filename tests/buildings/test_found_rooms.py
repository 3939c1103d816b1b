"""Rooms and doorways that a map finds in walls are those that random buildings were made of."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import semmap
from tests.buildings.building import random_building
from tests.buildings.found_rooms import Scores, bare, judge, without_rooms
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


def test_doorways_are_as_wide_as_built(make_database: MakeDatabase, tmp_path: Path) -> None:
    """Exact to 2 mm, nine of ten, where cells of 5 cm alone are wrong by 3 cm or more."""
    off = []
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        for seed in range(40, 46):
            building = random_building(seed, plain=True)
            with bare(building, database, tmp_path) as house:
                found = [way for storey in house.find_rooms() for way in storey.doorways]
            built = np.array([door.ends for door in building.doors if not door.climbs])[..., :2]
            for way in found:
                line = np.asarray(way.line.coords)
                nearest = np.hypot(*(built.mean(axis=1) - line.mean(axis=0)).T).argmin()
                ends = built[nearest]
                if math.dist(ends.mean(axis=0), line.mean(axis=0)) < 0.3:
                    off.append(abs(math.dist(*ends) - way.line.length))
    assert len(off) > 60
    assert np.quantile(off, 0.9) < 0.002


def test_walls_in_the_wrong_unit_are_too_large(database: str) -> None:
    with semmap.connect(database) as db:
        field = db.create_map("field")
        field.add_storey("ground")
        for x in (0, 900):
            field.add_object(f"wall{x}", type="wall", size=(1, 900, 3), pose=(x, 0, 0))
        with pytest.raises(ValueError, match=r"901 m by 900 m: too large .* wrong unit"):
            field.find_rooms()
