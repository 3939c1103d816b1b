"""Maps on which the methods of the API are tried: a flat of two rooms, and those of other tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import shapely
import trimesh

import semmap
from tests.belief.conftest import flat_map
from tests.conftest import Import
from tests.manipulation.cup_map import cup_map, cups
from tests.manipulation.house_map import house, house_map
from tests.worlds.conftest import HOUSE, ROOMS

__all__ = ["cup_map", "cups", "flat_map", "house", "house_map"]


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as opened:
        yield opened


@pytest.fixture
def flat(db: semmap.Database) -> semmap.Map:
    made = db.create_map("flat")
    made.add_storey("ground", height=3)
    made.add_room("kitchen", shapely.box(0, 0, 4, 3), floor=0, ceiling=2.7, label="kitchen")
    made.add_room("hall", [(4.1, 0), (8, 0), (8, 3), (4.1, 3)], ceiling=2.7)
    made.add_door("door1", "kitchen", "hall", ((4.05, 1), (4.05, 2)))
    made.add_object("desk4", type="table", size=(1.6, 0.8, 0.75), in_="kitchen")
    cylinder = trimesh.creation.cylinder(0.04, 0.1)
    made.add_object("mug7", type="mug", mesh=cylinder, on="desk4", properties={"colour": "red"})
    return made


@pytest.fixture(scope="module")
def small_house(imported: Import, worlds: Path) -> Iterator[semmap.Map]:
    """The small house with its rooms; the tests of a module share it."""
    with imported((worlds / HOUSE, "house"), (ROOMS, "house")) as engine:
        url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
        with semmap.connect(url) as opened:
            yield opened.map("house")
