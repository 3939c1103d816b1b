"""The small house in one grid: objects, rooms and people, compared with the relations of SQL."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from sqlalchemy import Engine, text

from semmap.fields.queries import QueryError
from semmap.fields.regions.region_map import BODIES
from semmap.fields.store.voxel_mirror import VoxelMirror
from tests.command_line import semmap

PREFIX = "PREFIX : <urn:semmap:ontology#> "


def url_of(house: Engine) -> str:
    return house.url.render_as_string(hide_password=False)


def run(house: Engine, *words: object) -> Any:
    done = semmap(url_of(house), "fields", *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def refused(house: Engine, query: str) -> str:
    with pytest.raises(QueryError) as error:
        semmap(url_of(house), "fields", "query", PREFIX + query)
    return str(error.value)


def rows(house: Engine, query: str) -> set[tuple[str, ...]]:
    return {tuple(row) for row in run(house, "query", PREFIX + query)["rows"]}


def test_a_voxel_has_the_object_and_the_room(house: Engine) -> None:
    with house.connect() as connection:
        x, y, z = connection.execute(
            text(
                "SELECT ST_X(c), ST_Y(c), (ST_ZMin(w.box) + ST_ZMax(w.box)) / 2 FROM world w "
                "JOIN entity e ON e.id = w.entity_id, ST_Centroid(w.footprint) c "
                "WHERE e.name = 'Ball_01_003'"
            )
        ).one()
    found = {(row["name"], row["kind"]) for row in run(house, "at", f"{x},{y},{z}")}
    assert found == {("Ball_01_003", "object"), ("bedroom", "room")}


def test_the_rooms_of_objects_are_those_of_sql(house: Engine) -> None:
    """Fields say of each object and room what `is_in` says, also in openings and walls."""
    with house.connect() as connection:
        pairs = connection.execute(
            text(
                "SELECT o.name, r.name, is_in(o.id, r.id) FROM entity o "
                "JOIN world wo ON wo.entity_id = o.id, entity r "
                "JOIN world wr ON wr.entity_id = r.id WHERE o.kind = 'object' AND r.kind = 'room'"
            )
        ).all()
    got = rows(house, "SELECT ?o ?r { ?o :in ?r . ?r a :Room }")
    assert ("Refrigerator_01_001", "kitchen") in got
    assert {(o, r) for o, r, inside in pairs if inside != ((o, r) in got)} == set()
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


def test_free_voxels_of_all_rooms_are_counted_without_reading_them(
    house: Engine, hotel: Engine
) -> None:
    """The counts are those of a look at each voxel; 39 million of the hotel are not listed."""
    count = "SELECT ?r (COUNT(?v) AS ?n) { ?v :freeIn ?r } GROUP BY ?r"
    found = dict(run(house, "query", PREFIX + count)["rows"])
    mirror = VoxelMirror(house, "house")
    mirror.catch_up()
    bodies = {n for n, role in mirror.roles.items() if role in BODIES}
    for number, name in mirror.names.items():
        if mirror.roles[number] == "room":
            centres = (mirror.regions.voxels(number) + 0.5) * 0.05
            there, counts = np.unique(mirror.regions.set_numbers_at(centres), return_counts=True)
            sets = mirror.regions.sets(there)
            free = [bodies.isdisjoint(sets[each]) for each in there.tolist()]
            assert found.pop(name) == counts[free].sum()
    assert found == {}
    one = PREFIX + "SELECT (COUNT(*) AS ?n) { ?v :%s :%s }"
    for what, name in (("freeIn", "kitchen"), ("inRoom", "kitchen"), ("occupiedBy", "Ball_01_001")):
        quick, slow = (
            run(house, "query", one % (what, name + each)) for each in (" ", " FILTER(1 = 1) ")
        )
        assert quick == slow
    assert "has 39,260,750 solutions, the voxels of 48" in refused(hotel, "ASK { ?v :freeIn ?r }")
    rooms = run(hotel, "query", PREFIX + count)["rows"]
    assert len(rooms) == 48
    assert sum(n for _, n in rooms) < 39_260_750


def test_entities_without_voxels_are_stated_as_unknown(house: Engine) -> None:
    done = semmap(url_of(house), "fields", "query", PREFIX + "SELECT ?o { ?o :in :kitchen }")
    assert "unknown, as they have no voxels: 5 entities: balcony-opening, " in done.output
    done = semmap(url_of(house), "fields", "query", PREFIX + "ASK { :Ball_01_003 :in :bedroom }")
    assert "unknown, as" not in done.output


def test_updates_are_kept_and_make_entities(house: Engine) -> None:
    """A region that SPARQL inserts is one for SQL, for other processes, and until it is deleted."""
    where = (7.15, 1.0, 1.2)
    text_ = 'INSERT DATA { _:new :occupies "SPHERE(7.15 1.0 1.2 0.15)"^^:region }'
    made = run(house, "update", PREFIX + text_)
    name = made["new"]["new"]
    assert made["changed"] == [name]
    point = ",".join(map(str, where))
    assert (name, "region") in {(r["name"], r["kind"]) for r in run(house, "at", point)}
    assert (name, "kitchen") in rows(house, "SELECT ?z ?r { ?z a :Region ; :in ?r . ?r a :Room }")
    with house.connect() as connection:
        box, kitchen = connection.execute(
            text(
                "SELECT ST_Area(w.footprint), is_in(e.id, entity_id('kitchen')) FROM entity e "
                "JOIN world w ON w.entity_id = e.id WHERE e.name = :name AND e.kind = 'region'"
            ),
            {"name": name},
        ).one()
    assert kitchen
    assert box == pytest.approx(3.14159 * 0.15**2, rel=0.25)
    fresh = VoxelMirror(house, "house", 0.05)
    fresh.catch_up()
    (number,) = [n for n, known in fresh.names.items() if known == name]
    centres = (fresh.regions.voxels(number) + 0.5) * 0.05
    assert (((centres - where) ** 2).sum(axis=1) <= 0.15**2 + 1e-9).all(), "not its outline"
    around = np.indices((10, 10, 10)).reshape(3, -1).T * 0.05 - 0.225
    assert len(centres) == ((around**2).sum(axis=1) <= 0.15**2 + 1e-9).sum()

    before = run(house, "ls")
    wrong = f"DELETE WHERE {{ :{name} :occupies ?v }} ; INSERT DATA {{ :x :occupies 'X'^^:region }}"
    with pytest.raises(QueryError):
        semmap(url_of(house), "fields", "update", PREFIX + wrong)
    assert run(house, "ls") == before, "all of it or nothing"
    run(house, "update", PREFIX + f"DELETE WHERE {{ :{name} :occupies ?v }}")
    assert name not in {r["name"] for r in run(house, "at", point)}
    with house.connect() as connection:
        left = connection.execute(text(f"SELECT count(*) FROM entity WHERE name = '{name}'"))
        assert left.scalar_one() == 0

    def count() -> int:
        return int({r["name"]: r["voxels"] for r in run(house, "ls")}["Ball_01_003"])

    whole = count()
    ball = "{ :Ball_01_003 :occupies ?v"
    half = f"DELETE {ball} }} WHERE {ball} FILTER(:z(?v) > 0.3) }}"
    run(house, "update", PREFIX + half)
    assert 0 < count() < 0.7 * whole
    kept = count()
    with house.begin() as connection:
        connection.execute(text("SELECT move_to(entity_id('Ball_01_003'), -6.0, -4.0, 0.319)"))
    assert count() == pytest.approx(kept, rel=0.3), "what was deleted moves with the entity"


def test_the_past_of_the_map(house: Engine) -> None:
    with house.connect() as connection:
        then = connection.execute(text("SELECT clock_timestamp()")).scalar_one()
    with house.begin() as connection:
        connection.execute(text("SELECT move_to(entity_id('Ball_01_001'), 7.0, -3.0, 0.319)"))
    ball = "SELECT ?r { :Ball_01_001 :in ?r }"
    time = f'"{then.isoformat()}"^^<http://www.w3.org/2001/XMLSchema#dateTime>'
    now = f'"{datetime.now(UTC).isoformat()}"^^<http://www.w3.org/2001/XMLSchema#dateTime>'
    assert rows(house, ball) == {("kitchen",)}
    assert rows(house, f"{ball} AT {time}") == {("balcony",)}
    assert rows(house, f"{ball} DURING {time} {now}") == {("balcony",), ("kitchen",)}
    there = "ASK {{ ?v :occupiedBy :Ball_01_001 ; :inRoom :{} }} {} {}"
    for room, clause, wanted in (
        ("balcony", f"AT {time}", True),
        ("kitchen", f"AT {time}", False),
        ("kitchen", f"DURING {time} {now}", True),
        ("bedroom", f"DURING {time} {now}", False),
    ):
        query = there.format(room, clause, "")
        assert run(house, "query", PREFIX + query) is wanted, (room, clause)
    assert "the map begins at" in refused(
        house, f"{ball} AT {time.replace(str(then.year), '2001', 1)}"
    )


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
