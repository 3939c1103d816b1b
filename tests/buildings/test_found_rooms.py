"""Rooms and doorways that a map finds in walls are those that random buildings were made of."""

from __future__ import annotations

from pathlib import Path

import semmap
from tests.buildings.building import random_building
from tests.buildings.found_rooms import Score, judge
from tests.conftest import MakeDatabase

SEEDS = range(20, 26)


def test_most_rooms_and_doorways_are_found(make_database: MakeDatabase, tmp_path: Path) -> None:
    rooms, doors = Score(), Score()
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        for seed in SEEDS:
            more_rooms, more_doors = judge(random_building(seed), database, tmp_path)
            rooms, doors = rooms + more_rooms, doors + more_doors
    assert rooms.known > 50
    assert min(rooms.recall, rooms.precision, doors.recall, doors.precision) >= 0.9, (rooms, doors)
