"""Which room: all ways to ask agree with each other and with Shapely, in buildings of any name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import semmap
from planner.readers.entity_lookup import find_entities
from tests.buildings.building import Building, random_building, room_of
from tests.conftest import MakeDatabase

SEEDS = range(8)


@pytest.fixture(scope="module", params=SEEDS)
def known(
    request: pytest.FixtureRequest,
    make_database: MakeDatabase,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[Building, semmap.Map]]:
    """A random building, and the map that holds it."""
    building = random_building(request.param)
    url = make_database().render_as_string(hide_password=False)
    with stored(building, url, tmp_path_factory.mktemp("building")) as place:
        yield building, place


@contextmanager
def stored(building: Building, url: str, folder: Path) -> Iterator[semmap.Map]:
    """The map of a building, imported from its files."""
    with semmap.connect(url) as database:
        for path in building.write(folder):
            database.import_file(path, map="b")
        yield database.map("b")


def test_all_ways_to_ask_for_the_room_agree(known: tuple[Building, semmap.Map]) -> None:
    building, place = known
    things = [item for item in building.items if item.what == "thing"]
    rooms = [room.name for room in building.rooms]
    found = {name: {e.name for e in place.find(in_=name)} for name in rooms}
    pairs = place.sql(
        "SELECT o.name, r.name FROM entity o JOIN entity r ON r.kind = 'room' "
        "WHERE o.kind = 'object' AND is_in(o.id, r.id)"
    )
    inside: dict[str, set[str]] = {}
    for thing, room in pairs:
        inside.setdefault(thing, set()).add(room)
    asked = place.sparql("SELECT ?o ?r { ?o :in ?r . ?r a :Room }")
    triples: dict[str, set[str]] = {}
    for row in asked:
        triples.setdefault(str(row["o"]), set()).add(str(row["r"]))
    for item in things:
        entity = place[item.name]
        assert entity.room is not None, item
        room = entity.room.name
        assert room in room_of(building, item), item
        assert [name for name in rooms if item.name in found[name]] == [room], item
        assert inside[item.name] == {room}, item
        with place.snapshot() as seen:
            (located,) = find_entities(seen.connection, item.name)
        assert located.place == room, item


def test_holders_are_what_bears_a_thing(known: tuple[Building, semmap.Map]) -> None:
    building, place = known
    for item in building.items:
        if item.what == "thing":
            holder = place[item.name].holder
            assert holder is not None
            assert holder.name == item.on or (
                item.on is None and holder.name in room_of(building, item)
            ), item


def test_parts_of_the_building_are_recognised(known: tuple[Building, semmap.Map]) -> None:
    building, place = known
    types = dict(place.sql("SELECT name, type FROM entity WHERE kind = 'object'"))
    for item in building.items:
        if item.what in ("floor", "wall", "ceiling"):
            assert types[item.name] == item.what, item
        elif item.what == "thing":
            assert types[item.name] not in ("floor", "wall", "ceiling", "building_shell"), item
