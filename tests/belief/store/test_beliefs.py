"""Beliefs of the database against the formula of the thesis, written out; and what is refused."""

from __future__ import annotations

import math
import random
import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import select

from semmap import Map
from semmap.belief.error import BeliefError
from semmap.belief.inference import infer
from semmap.belief.observation_columns import Observations
from semmap.belief.store.beliefs import ELSEWHERE, add_observations, read_belief, where
from semmap.database.maps import driver_of, see_map
from semmap.model import Belief, Entity
from semmap.query.change_feed import ChangeFeed
from tests.belief.conftest import THESIS, WEIGHTS
from tests.forged import forge
from tests.seen import seen_by

NOW = datetime.now(UTC)
PLACES = {"table", "counter", "bench", "fridge", "kitchen", "hall", "piano"}


def ago(seconds: float) -> datetime:
    return NOW - timedelta(seconds=seconds)


def observe(flat: Map, *rows: dict[str, Any]) -> list[int]:
    return add_observations(flat.connection, rows)


def belief(flat: Map, name: str, at: datetime | None = None) -> dict[str, float]:
    return read_belief(seen_by(flat.connection), name, at)


def expected(
    prior: dict[str, float], rows: list[dict[str, Any]], moment: datetime, mobility: float
) -> dict[str, float]:
    """Each place's prior times the probability of every observation, in plain products."""
    weights = dict(prior)
    for row in rows:
        d = 0.1 * math.exp(-(moment - row["at"]).total_seconds() * mobility / 10)
        there, not_there = row.get("hit", 0.6 + d), row.get("false_alarm", 0.3 - d)
        share = row.get("visible", 1.0)
        for place in weights:
            seen = share * (there if place == row["place"] else not_there)
            weights[place] *= seen if row["seen"] else 1 - seen
    total = math.fsum(weights.values())
    return {place: weight / total for place, weight in weights.items()}


def test_places_are_where_the_object_has_room(flat: Map) -> None:
    assert set(belief(flat, "mug")) == PLACES | {ELSEWHERE}
    flat["coke"].properties = {"base_area": 0.45, "volume": 0.2}  # 0.67 m wide: not on the bench
    assert set(belief(flat, "coke")) == {"kitchen", "hall", "table", ELSEWHERE}
    for name in ("bench", "piano", "robot"):  # furniture and agents are in rooms
        assert set(belief(flat, name)) == {"kitchen", "hall", ELSEWHERE}


def test_without_evidence_typical_places_and_the_placement_of_the_map_count(
    flat: Map,
) -> None:
    coke = belief(flat, "coke")
    assert coke.pop(ELSEWHERE) == pytest.approx(0.1)
    total = sum(WEIGHTS.values())
    assert coke == pytest.approx({place: 0.9 * w / total for place, w in WEIGHTS.items()})
    flat["coke"].type = "can"  # the T-Box has cans in kitchens and refrigerators
    can = belief(flat, "coke")
    for place in ("fridge", "table", "kitchen"):
        likelier = can[place] / can["bench"] / (coke[place] / coke["bench"])
        assert likelier == pytest.approx(4)
    mug = belief(flat, "mug")
    assert max(mug, key=mug.__getitem__) == "bench"
    assert mug["bench"] > 0.45


@pytest.mark.parametrize("seed", range(8))
def test_beliefs_are_those_of_the_formula(flat: Map, seed: int) -> None:
    flat.execute(THESIS)
    source = random.Random(seed)
    mobility = source.choice([0.0, 0.5, 1.0, 3.0])
    flat["coke"].properties = {"mobility": mobility}
    prior = {row["place"]: row["prior"] for row in where(seen_by(flat.connection), "coke")}
    rows = []
    for _ in range(source.randint(1, 25)):
        row: dict[str, Any] = {
            "object": "coke",
            "place": source.choice(sorted(PLACES)),
            "seen": source.random() < 0.5,
            "at": ago(source.choice([0, 1, 11.5, 60, 1e5, 3e8]) + source.random()),
        }
        if source.random() < 0.5:
            row["visible"] = source.uniform(0.01, 1) if not row["seen"] else 1.0
        if source.random() < 0.3:
            row |= {"hit": source.uniform(0.5, 0.99), "false_alarm": source.uniform(0.01, 0.5)}
        rows.append(row)
    for row in rows:
        observe(flat, row)  # one by one: the table follows by increments
    moment = NOW + timedelta(seconds=source.choice([0, 5, 1e6]))
    found = belief(flat, "coke", moment)
    assert math.fsum(found.values()) == pytest.approx(1, abs=1e-12)
    assert found == pytest.approx(expected(prior, rows, moment, mobility), abs=1e-12)
    places = list(prior)
    columns = Observations(
        object=[0] * len(rows),
        place=[places.index(row["place"]) for row in rows],
        age=[(moment - row["at"]).total_seconds() for row in rows],
        seen=[row["seen"] for row in rows],
        share=[row.get("visible", 1.0) for row in rows],
        hit=[row.get("hit", math.nan) for row in rows],
        false_alarm=[row.get("false_alarm", math.nan) for row in rows],
    )
    (by_arrays,) = infer([list(prior.values())], columns, [mobility])
    assert [found[place] for place in places] == pytest.approx(list(by_arrays), abs=1e-12)
    stored = flat.execute(
        "SELECT coalesce(e.name, 'elsewhere'), b.probability, b.at FROM belief b "
        "LEFT JOIN entity e ON e.id = b.place_id WHERE b.entity_id = entity_id('coke')"
    )
    at = stored[0][2]
    assert {n: p for n, p, _ in stored} == pytest.approx(
        expected(prior, rows, at, mobility), abs=1e-12
    )


def test_a_word_for_a_room_counts_for_all_places_in_it(flat: Map) -> None:
    flat.execute(THESIS)
    prior = belief(flat, "coke")
    observe(flat, {"object": "coke", "place": "kitchen", "seen": True, "inside": True, "at": NOW})
    found = belief(flat, "coke", NOW)
    inside = {"kitchen", "table", "counter", "fridge"}
    ratio = {place: found[place] / prior[place] for place in prior}
    (low,) = {round(ratio[place], 9) for place in PLACES - inside | {ELSEWHERE}}
    assert {round(ratio[place] / low, 6) for place in inside} == {3.5}


def test_the_past_is_believed_as_it_was_known(flat: Map) -> None:
    before = belief(flat, "coke", ago(100))
    observe(flat, {"object": "coke", "place": "fridge", "seen": True, "at": ago(50)})
    assert belief(flat, "coke", ago(100)) == before
    assert (
        belief(flat, "coke", ago(50))["fridge"] > belief(flat, "coke")["fridge"] > before["fridge"]
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"at": NOW + timedelta(days=1)}, r"coke at table\): at is .* in the future"),
        ({"at": datetime(2026, 1, 1)}, "with its time zone"),
        ({"at": "yesterday"}, "ISO 8601"),
        ({"hit": 1.0}, "hit is 1.0: give a probability between 0 and 1"),
        ({"false_alarm": 0}, "false_alarm is 0"),
        ({"hit": math.nan}, "hit is nan"),
        ({"visible": 0.0}, "visible is 0.0"),
        ({"visible": True}, "visible is True"),
        ({"seen": 1}, "seen is 1: give true or false"),
        ({"place": "coke"}, "not its own place"),
        ({"position": [0, math.inf, 0]}, "position is"),
        ({"position": [5000, 0, 0.8]}, "coke at table: its position is 4999.2 m outside of table"),
        ({"position": [0, 0, 9]}, r"its position is 7\.25 m outside of table"),
        ({"hit": 0.1, "false_alarm": 0.2}, "coke at table: hit, 0.1, is not above false_alarm"),
        ({"false_alarm": 0.95}, "is not above false_alarm, 0.95"),
        ({"colour": "red"}, "colour is not one of object, place"),
        ({"place": "cereal"}, "coke cannot be on or in cereal: it has no room there"),
        ({"object": "piano"}, "piano cannot be on or in table"),
        ({"object": "kitchen"}, "kitchen is a room: it does not move"),
        ({"place": "bench"}, "coke cannot be at table and at bench at the same time"),
        ({"place": "hall", "inside": True}, "cannot be at table and at hall at the same time"),
        ({"place": "tabel"}, "no entity tabel; did you mean table"),
        ({"object": "cok"}, "no entity cok; did you mean coke"),
    ],
)
def test_bad_observations_are_refused_and_nothing_is_stored(
    flat: Map, change: dict[str, Any], message: str
) -> None:
    good = {"object": "coke", "place": "table", "seen": True}
    with pytest.raises((BeliefError, LookupError), match=message):
        observe(flat, good, good | change)
    assert flat.execute("SELECT count(*) FROM observation") == [(0,)]
    assert flat.execute("SELECT count(*) FROM belief") == [(0,)]


def test_a_room_and_what_is_in_it_are_no_contradiction(flat: Map) -> None:
    seen = {"object": "coke", "seen": True, "at": NOW}
    observe(flat, seen | {"place": "table"}, seen | {"place": "kitchen", "inside": True})
    observe(flat, seen | {"place": "bench", "seen": False})
    with pytest.raises(BeliefError, match="cannot be at bench and at"), flat.transaction():
        observe(flat, seen | {"place": "bench"})
    assert flat.execute("SELECT count(*) FROM observation") == [(3,)]


@pytest.mark.parametrize(
    "statement",
    [
        "INSERT INTO observation (entity_id, place_id, seen, at) VALUES "
        "(entity_id('coke'), entity_id('table'), true, now() + interval '1 hour')",
        "INSERT INTO observation (entity_id, place_id, seen, hit) VALUES "
        "(entity_id('coke'), entity_id('table'), true, 1)",
        "INSERT INTO observation (entity_id, place_id, seen) VALUES "
        "(entity_id('coke'), entity_id('mug'), true)",
        "INSERT INTO belief_model (map_id, there) VALUES (current_map(), 1.05)",
        "INSERT INTO belief_model (map_id, seconds) VALUES (current_map(), 0)",
    ],
)
def test_bad_rows_are_refused_in_sql(flat: Map, statement: str) -> None:
    with pytest.raises(ValueError, match=r"future|hit is between|no room there|belief model"):
        flat.execute(statement)


def test_a_new_observation_is_announced(flat_map: Map) -> None:
    cursor = flat_map.execute("SELECT change_cursor()")[0][0]
    observe(flat_map, {"object": "mug", "place": "table", "seen": True})
    try:
        assert [(c.what, c.name) for c in flat_map.changes(cursor)] == [("belief", "mug")]
        with flat_map.session() as session:
            row = session.scalars(
                select(Belief)
                .join(Belief.entity)
                .where(Entity.name == "mug")
                .order_by(Belief.probability.desc())
                .limit(1)
            ).one()
            assert row.place is not None
            assert row.place.name == "table"
    finally:
        flat_map.execute("DELETE FROM observation")
        forge(flat_map.execute, "DELETE FROM belief")


def test_a_belief_does_not_concern_those_who_follow_the_geometry(flat_map: Map) -> None:
    feed = ChangeFeed(flat_map.database.engine, "flat")
    with feed.look() as look:
        feed.take_in(look)
    observe(flat_map, {"object": "mug", "place": "table", "seen": True})
    try:
        with feed.look() as look:
            assert look.changed == frozenset()
    finally:
        flat_map.execute("DELETE FROM observation")
        forge(flat_map.execute, "DELETE FROM belief")


def test_the_table_follows_moves_and_removals(flat: Map) -> None:
    observe(flat, {"object": "mug", "place": "table", "seen": False})

    def stored() -> dict[str, float]:
        return dict(
            flat.execute(
                "SELECT coalesce(e.name, 'elsewhere'), b.probability FROM belief b "
                "LEFT JOIN entity e ON e.id = b.place_id WHERE b.entity_id = entity_id('mug')"
            )
        )

    before = stored()
    flat["mug"].put_on("counter")
    after = stored()
    assert after["counter"] > before["counter"] + 0.2
    flat["counter"].delete()
    assert set(stored()) == set(before) - {"counter"}
    assert math.fsum(stored().values()) == pytest.approx(1, abs=1e-12)
    flat["mug"].delete()
    assert flat.execute("SELECT count(*) FROM belief") == [(0,)]


def test_a_sqlalchemy_connection_reads_and_writes_too(flat_map: Map) -> None:
    with flat_map.database.engine.connect() as connection:
        see_map(connection, "flat")
        rows = [{"object": "coke", "place": "fridge", "seen": True}] * 5
        assert len(add_observations(driver_of(connection), rows)) == 5
        found = read_belief(seen_by(connection), "coke")
        assert next(iter(found)) == "fridge"
        connection.rollback()
    assert flat_map.execute("SELECT count(*) FROM observation") == [(0,)]


def test_two_who_observe_one_object_at_once_both_count(flat_map: Map) -> None:
    engine = flat_map.database.engine
    row = {"object": "coke", "place": "fridge", "seen": True, "at": ago(1e6)}
    flat_map.execute(THESIS)
    observe(flat_map, row)

    def second() -> None:
        with engine.begin() as connection:
            see_map(connection, "flat")
            add_observations(driver_of(connection), [row])

    try:
        with engine.begin() as connection:
            see_map(connection, "flat")
            add_observations(driver_of(connection), [row])
            other = threading.Thread(target=second)
            other.start()
            other.join(0.5)
            assert other.is_alive()  # it waits for this transaction
        other.join()
        prior = {r["place"]: r["prior"] for r in where(seen_by(flat_map.connection), "coke")}
        (stored,) = flat_map.execute(
            "SELECT probability FROM belief WHERE entity_id = entity_id('coke') "
            "AND place_id = entity_id('fridge')"
        )
        assert stored[0] == pytest.approx(expected(prior, [row] * 3, NOW, 1)["fridge"], abs=1e-9)
    finally:
        flat_map.execute("DELETE FROM observation")
        forge(flat_map.execute, "DELETE FROM belief")
        flat_map.execute("DELETE FROM belief_model")


def test_copies_and_their_end(flat_map: Map) -> None:
    observe(flat_map, *[{"object": "coke", "place": "fridge", "seen": True, "at": ago(5)}] * 3)
    try:
        moment = datetime.now(UTC)
        original = belief(flat_map, "coke", moment)
        flat_map.execute("SELECT copy_map('flat', 'copy')")
        copy = flat_map.database.map("copy")
        copy.execute("SELECT 1")
        assert belief(copy, "coke", moment) == pytest.approx(original, abs=1e-12)
    finally:
        flat_map.execute("SELECT 1")
        flat_map.database.drop_map("copy")
        flat_map.execute("DELETE FROM observation")
        forge(flat_map.execute, "DELETE FROM belief")
    assert flat_map.execute("SELECT count(*) FROM belief") == [(0,)]


def test_repeated_looks_of_an_agent_count_once_and_old_ones_go(flat: Map) -> None:
    flat.execute(THESIS)
    second = datetime(2026, 5, 1, tzinfo=UTC)
    frames = [second + timedelta(milliseconds=200 * k) for k in range(10)]  # two seconds at 5 Hz
    of = {"object": "coke", "place": "table", "seen": True}
    flat.execute("UPDATE retention SET keep_every = '1 second' WHERE kind = 'observation'")
    observe(flat, *[of | {"at": at, "observer": "robot"} for at in frames])
    observe(flat, *[of | {"at": at} for at in frames[:3]])  # a person says so three times
    kept = flat.execute("SELECT observer_id IS NULL, at FROM observation ORDER BY 1, 2")
    assert kept == [(False, frames[4]), (False, frames[9]), *((True, at) for at in frames[:3])]
    prior = {r["place"]: r["prior"] for r in where(seen_by(flat.connection), "coke", at=NOW)}
    rows = [of | {"at": at} for _, at in kept]
    (table,) = flat.execute(
        "SELECT probability FROM belief WHERE entity_id = entity_id('coke') "
        "AND place_id = entity_id('table')"
    )
    assert table[0] == pytest.approx(expected(prior, rows, NOW, 1)["table"], abs=1e-9)
    flat.execute(
        "UPDATE retention SET keep_for = now() - '2026-05-01 00:00:01'::timestamptz "
        "WHERE kind = 'observation'"
    )
    flat.execute("SELECT apply_retention()")
    assert flat.execute("SELECT at FROM observation WHERE observer_id IS NOT NULL") == [
        (frames[9],)
    ]
    assert flat.execute("SELECT count(*) FROM observation") == [(4,)]
