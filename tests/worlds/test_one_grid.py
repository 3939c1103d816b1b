"""The small house in one grid: objects, rooms and people, compared with the relations of SQL."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, text

from semmap.fields.queries import QueryError
from semmap.ingest.importer import import_file
from tests.command_line import semmap

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"
PREFIX = "PREFIX : <urn:semmap:ontology#> "


@pytest.fixture(scope="module")
def house(module_engine: Engine, worlds: Path) -> Engine:
    """A database that holds the house and its rooms."""
    for path in (worlds / "small_house" / "worlds" / "small_house.world", ROOMS):
        import_file(module_engine, path, map_name="house")
    return module_engine


def run(house: Engine, *words: object) -> Any:
    url = house.url.render_as_string(hide_password=False)
    done = semmap(url, "fields", *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def refused(house: Engine, query: str) -> str:
    url = house.url.render_as_string(hide_password=False)
    with pytest.raises(QueryError) as error:
        semmap(url, "fields", "query", PREFIX + query)
    return str(error.value)


def rows(house: Engine, query: str) -> set[tuple[str, ...]]:
    return {tuple(row) for row in run(house, "query", PREFIX + query)["rows"]}


def test_a_voxel_has_the_object_and_the_room(house: Engine) -> None:
    with house.connect() as connection:
        x, y, z = connection.execute(
            text(
                "SELECT ST_X(c), ST_Y(c), (ST_ZMin(w.box) + ST_ZMax(w.box)) / 2 FROM world w "
                "JOIN entity e ON e.id = w.entity_id, ST_Centroid(w.footprint) c "
                "WHERE e.name = 'NightStand_01_001'"
            )
        ).one()
    found = {(row["name"], row["kind"]) for row in run(house, "at", f"{x},{y},{z}")}
    assert found == {("NightStand_01_001", "object"), ("bedroom", "room")}


def test_the_rooms_of_objects_are_those_of_sql(house: Engine) -> None:
    """Voxels and footprints may differ only where an object is half in its room."""
    with house.connect() as connection:
        pairs = connection.execute(
            text(
                "SELECT o.name, r.name, is_in(o.id, r.id), coalesce(ST_Area(ST_Intersection("
                "wo.footprint, wr.footprint)) / nullif(ST_Area(wo.footprint), 0), 0) "
                "FROM entity o JOIN world wo ON wo.entity_id = o.id, entity r "
                "JOIN world wr ON wr.entity_id = r.id WHERE o.kind = 'object' AND r.kind = 'room'"
            )
        ).all()
    got = rows(house, "SELECT ?o ?r { ?o :in ?r . ?r a :Room }")
    assert ("Refrigerator_01_001", "kitchen") in got
    sure = [(o, r, inside) for o, r, inside, share in pairs if not 0.3 < share < 0.7]
    assert len(sure) > 0.9 * len(pairs)
    different = {(o, r) for o, r, inside in sure if inside != ((o, r) in got)}
    assert different == set()
    assert run(house, "query", PREFIX + "ASK { :Refrigerator_01_001 :in :kitchen }") is True
    assert run(house, "query", PREFIX + "ASK { :Refrigerator_01_001 :in :bedroom }") is False


def test_what_nothing_states_is_an_error(house: Engine) -> None:
    free = (
        "SELECT (COUNT(?v) AS ?n) { ?v :freeIn :balcony "
        "FILTER NOT EXISTS { ?v :distanceToPerson ?d FILTER(?d <= 1.2) } }"
    )
    assert "no source provides :containsPerson" in refused(house, free)
    for query in (
        "ASK { ?v :inFieldOfView ?who }",
        "SELECT ?o { ?who :sees ?o }",
        "SELECT ?v { ?v :personalSpace ?p }",
        "SELECT ?v { ?v :containsObject 'mug' }",
    ):
        assert "no source provides :" in refused(house, query), query
    assert "no voxels" in refused(house, "ASK { :Refrigerator_01_001 :in <urn:x#kitchen-door> }")


def test_free_space_keeps_away_from_people_of_the_map(house: Engine) -> None:
    """A person without geometry occupies a typical body, and is known without any source."""
    at = (1.0, 4.9)
    with house.begin() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        connection.execute(
            text(
                "WITH e AS (INSERT INTO entity (map_id, kind, name, type) VALUES "
                "(current_map(), 'agent', 'anna', 'person') RETURNING id) "
                "INSERT INTO placement (entity_id, pose) "
                "SELECT id, ARRAY[:x, :y, 0, 0, 0, 0, 1]::double precision[] FROM e"
            ),
            {"x": at[0], "y": at[1]},
        )
    ((least,),) = rows(
        house, "SELECT (MIN(?d) AS ?least) { ?v :freeIn :balcony ; :distanceToPerson ?d }"
    )
    assert 0 < float(least) < 0.2
    for x, free in ((at[0], False), (at[0] + 1.0, False), (at[0] - 1.8, True)):
        query = (
            f"ASK {{ ?v :freeIn :balcony FILTER(ABS(:x(?v) - {x}) < 0.06 "
            f"&& ABS(:y(?v) - {at[1]}) < 0.06 && ABS(:z(?v) - 1) < 0.06) "
            "FILTER NOT EXISTS { ?v :distanceToPerson ?d FILTER(?d <= 1.2) } }"
        )
        assert run(house, "query", PREFIX + query) is free, x
    assert {("anna", "balcony")} <= rows(house, "SELECT ?a ?r { ?a a :Person ; :in ?r }")
