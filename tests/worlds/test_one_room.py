"""All ways to ask for the room of an entity of a real world agree, also for parts of a building."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine

import semmap
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.store.voxel_mirror import VoxelMirror
from tests.buildings.rooms import disagreements, said_rooms
from tests.conftest import Import
from tests.effort import effort
from tests.worlds.conftest import CLINIC, HOTEL, HOUSE, ROOMS

FILES: dict[str, list[str | Path]] = {
    "duplex": ["ifc/Duplex_A_20110907.ifc"],
    "house": [HOUSE, ROOMS],
    "hotel": [HOTEL],
    "clinic": [CLINIC],
}


@pytest.fixture(scope="module", params=effort(["duplex", "house", "hotel"], [*FILES]))
def world(
    request: pytest.FixtureRequest, imported: Import, worlds: Path
) -> Iterator[tuple[Engine, semmap.Map]]:
    name = request.param
    files = ((worlds / file, name) for file in FILES[name])
    with (
        imported(*files) as engine,
        semmap.connect(engine.url.render_as_string(hide_password=False)) as db,
    ):
        yield engine, db.map(name)


@pytest.mark.explore
def test_all_ways_say_one_room(world: tuple[Engine, semmap.Map]) -> None:
    said = said_rooms(world[1])
    assert disagreements(said) == []
    assert sum(bool(rooms["SPARQL"]) for rooms in said.values()) > 30


def test_no_part_of_a_building_is_in_a_room_by_voxels(world: tuple[Engine, semmap.Map]) -> None:
    engine, place = world
    if place.name not in ("duplex", "house"):
        return  # of the others, no part has a mesh
    mirror = VoxelMirror(engine, place.name, voxel_size=0.1)
    mirror.catch_up()
    tracker = RelationTracker.of(mirror)
    rooms = {room.name for room in place.rooms}
    parts = {
        name
        for (name,) in place.sql(
            "SELECT name FROM entity WHERE map_id = current_map() AND is_building_part(type)"
        )
    }
    found = {
        event.subject
        for event in tracker.update(mirror.regions.entities())
        if event.relation == "in" and event.object in rooms
    }
    assert len(found) > 30
    assert not found & parts
