"""A person whom the small house knows is seen by a source: one entity, in one room at a time."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import pytest
from sqlalchemy import Engine, text

from semmap.fields.store.voxel_mirror import VoxelMirror
from tests.command_line import semmap
from tests.worlds.field_server import Server, eventually, fields

PREFIX = "PREFIX : <urn:semmap:ontology#> "
ROOMS = "SELECT ?room { :anna :in ?room . ?room a :Room }"
BALCONY, BEDROOM, KITCHEN = (1.0, 4.9), (-6.0, 1.0), (6.5, -1.0)
BESIDE = (6.5, -2.0)  # also in the kitchen


@pytest.fixture(scope="module")
def url(house: Engine) -> str:
    """The URL of a database with the house and its rooms; Anna stands on the balcony."""
    with house.begin() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        connection.execute(
            text(
                "WITH e AS (INSERT INTO entity (map_id, kind, name, type) "
                "VALUES (current_map(), 'agent', 'anna', 'person') RETURNING id) "
                "INSERT INTO placement (entity_id, pose) SELECT id, "
                "ARRAY[:x, :y, 0, 0, 0, 0, 1]::double precision[] FROM e"
            ),
            {"x": BALCONY[0], "y": BALCONY[1]},
        )
    return house.url.set(drivername="postgresql").render_as_string(hide_password=False)


@pytest.fixture
def server(url: str) -> Iterator[Server]:
    started = Server(url, "--source", "bodies:standing_people=socket")
    yield started
    started.stop()


def rows(url: str, query: str) -> set[tuple[str, ...]]:
    return {tuple(row) for row in fields(url, "query", PREFIX + query)["rows"]}


def rooms(url: str) -> set[str]:
    return {room for (room,) in rows(url, ROOMS)}


def see(url: str, **people: tuple[float, float]) -> None:
    given = {name: {"x": x, "y": y} for name, (x, y) in people.items()}
    sent = semmap(url, "fields", "send", "bodies", json.dumps({"people": given}))
    assert sent.exit_code == 0


def at(url: str, place: tuple[float, float]) -> set[str]:
    return {row["name"] for row in fields(url, "at", f"{place[0]},{place[1]},1.0")}


def walk(house: Engine, place: tuple[float, float]) -> None:
    with house.begin() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        connection.execute(
            text("SELECT move_to(entity_id('anna'), :x, :y, 0)"), {"x": place[0], "y": place[1]}
        )


def test_who_is_in_a_room_has_one_answer(house: Engine, url: str, server: Server) -> None:
    assert rooms(url) == {"balcony"}
    before = datetime.now(UTC).isoformat()
    see(url, anna=KITCHEN, stranger=BESIDE)
    eventually(lambda: rooms(url), {"kitchen"})
    who = "SELECT ?who { ?who :in :kitchen . ?who a :Agent }"
    assert {"anna", "stranger"} == {name for (name,) in rows(url, who)}
    assert at(url, KITCHEN) == {"anna", "kitchen"}
    assert at(url, BALCONY) == {"balcony"}
    listed = [row["kind"] for row in fields(url, "ls") if row["name"] == "anna"]
    assert listed == ["agent"]
    far = f"ASK {{ ?v :freeIn :balcony ; :distanceToPerson ?d FILTER(:x(?v) < {BALCONY[0]}) }}"
    assert fields(url, "query", PREFIX + far) is False, "nobody is on the balcony"
    with pytest.raises(ValueError, match="source sees"):
        semmap(
            url,
            "fields",
            "update",
            PREFIX + 'INSERT DATA { :anna :occupies "SPHERE(1 1 1 0.1)"^^:region }',
        )

    walk(house, BEDROOM)
    see(url, anna=KITCHEN)
    eventually(lambda: at(url, KITCHEN), {"anna", "kitchen"})
    assert rooms(url) == {"kitchen"}, "she is where she is seen"
    then = f'"{before}"^^<http://www.w3.org/2001/XMLSchema#dateTime>'
    now = f'"{datetime.now(UTC).isoformat()}"^^<http://www.w3.org/2001/XMLSchema#dateTime>'
    assert rows(url, f"{ROOMS} AT {then}") == {("balcony",)}
    assert rows(url, f"{ROOMS} AT {now}") == {("kitchen",)}
    assert rows(url, f"{ROOMS} DURING {then} {now}") == {("balcony",), ("kitchen",)}
    seen = "ASK {{ ?v :occupiedBy :anna ; :inRoom :{} }} {}"
    for room, time, wanted in (
        ("balcony", f"AT {then}", True),
        ("kitchen", f"AT {then}", False),
        ("balcony", f"AT {now}", False),
        ("kitchen", f"AT {now}", True),
        ("balcony", f"DURING {then} {now}", True),
        ("kitchen", f"DURING {then} {now}", True),
        ("bedroom", f"DURING {then} {now}", False),
    ):
        asked = PREFIX + seen.format(room, time)
        assert fields(url, "query", asked) is wanted, (room, time)

    assert semmap(url, "fields", "source", "stop", "bodies").exit_code == 0
    eventually(lambda: rooms(url), {"bedroom"})
    assert at(url, KITCHEN) == {"kitchen"}


def test_the_state_of_the_map_has_the_own_bodies(house: Engine, url: str, server: Server) -> None:
    """A service ends while Anna is seen: the next one begins with where the map has her."""
    walk(house, BEDROOM)
    see(url, anna=KITCHEN)
    eventually(lambda: rooms(url), {"kitchen"})
    server.stop()
    resumed, fresh = (made(house, "house", 0.05) for made in (VoxelMirror.resume, VoxelMirror))
    assert resumed.agents().keys() == {"anna"}, "the service has kept its state"
    for mirror in (resumed, fresh):
        mirror.catch_up()
    anna = fresh.agents()["anna"]
    np.testing.assert_array_equal(
        np.unique(resumed.regions.voxels(anna), axis=0),
        np.unique(fresh.regions.voxels(anna), axis=0),
    )
    assert rooms(url) == {"kitchen"}, "without a service: as it was seen last"
