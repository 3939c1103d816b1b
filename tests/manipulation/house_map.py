"""A table with things of the small house, in a database that has no gripper."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest

import semmap as package
from semmap import Map
from semmap.ingest.meshes.mesh_file import read_mesh
from tests.conftest import MakeDatabase

HOUSE = {"Vase_01": (1.0, 1.0, 0.75), "SeasoningBox_01": (1.4, 1.0, 0.75), "Ball_01": (3.0, 2.0, 0)}
"""Meshes of small_house and where the test puts them, metres."""


@pytest.fixture(scope="module")
def house_map(make_database: MakeDatabase, worlds: Path) -> Iterator[Map]:
    """A table with things of small_house, in a database that has no gripper."""
    url = make_database().render_as_string(hide_password=False)
    with package.connect(url) as db:
        house = db.create_map("house")
        house.add_room("room", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7)
        house.add_object("table", type="table", size=(1.6, 0.8, 0.75), pose=(1.2, 1.0, 0))
        for name, place in HOUSE.items():
            folder = worlds / "small_house" / "models" / f"aws_robomaker_residential_{name}"
            mesh = read_mesh(next(folder.glob("meshes/*visual.DAE")), dae_up_axis=False)
            type_ = {"Vase_01": "vase", "Ball_01": "ball"}.get(name, "seasoning_box")
            house.add_object(name, type=type_, mesh=mesh, pose=place)
        yield house


@pytest.fixture
def house(house_map: Map) -> Iterator[Map]:
    """The house, for one test: what the test changes is undone."""
    with house_map.transaction() as transaction:
        yield house_map
        raise psycopg.Rollback(transaction)
