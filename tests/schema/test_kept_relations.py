"""Kept relations beside a decision of each pair, and beside Shapely, while a building changes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from shapely import affinity
from sqlalchemy import Engine

from semmap.database import as_reader
from semmap.database.maps import driver_of
from semmap.geometry.pose import Pose
from semmap.ingest.world import Entry, StoreyDetail
from semmap.knowledge.queries import query
from tests.query.office_scene import block, bodies, drawn, room, store, thing

MAPS = itertools.count()
DECIDE = {
    "on": "is_on(a.id, b.id)",
    "in": "is_in(a.id, b.id)",
    "above": "is_above(a.id, b.id)",
    "touching": "is_touching(a.id, b.id)",
    "near": "is_near(a.id, b.id, 1)",
}
SIDES = {"left": "left_of", "right": "right_of", "front": "in_front_of", "behind": "behind"}
Pairs = set[tuple[int, int]]


@dataclass
class House:
    """A map of two storeys with rooms of blocks, its sessions, and a source of chance."""

    session: psycopg.Connection[Any]
    other: psycopg.Connection[Any]
    number: int
    name: str
    random: np.random.Generator

    def ids(self, kind: str) -> list[int]:
        rows = self.session.execute(
            "SELECT id FROM entity WHERE map_id = %s AND kind = %s ORDER BY id", (self.number, kind)
        )
        return [row[0] for row in rows]

    def one(self, kind: str = "object") -> int:
        return int(self.random.choice(self.ids(kind)))

    def read(self, relation: str, session: psycopg.Connection[Any] | None = None) -> Pairs:
        rows = (session or self.session).execute(
            f"SELECT a, b FROM pairs_{relation}(%s)".encode(), (self.number,)
        )
        found = rows.fetchall()
        assert len(found) == len(set(found)), "a pair is listed twice"
        return set(found)

    def decided(self, relation: str) -> Pairs:
        """The same by the decision of each pair of entities."""
        return set(
            self.session.execute(
                f"SELECT a.id, b.id FROM entity a JOIN entity b ON b.map_id = a.map_id "
                f"AND a.id <> b.id WHERE a.map_id = %s AND {DECIDE[relation]}".encode(),
                (self.number,),
            ).fetchall()
        )

    def keep(self, relation: str, session: psycopg.Connection[Any] | None = None) -> None:
        (session or self.session).execute("SELECT keep_relation(%s, %s)", (self.number, relation))

    def changed(self, relation: str) -> set[int] | None:
        row = self.session.execute(
            "SELECT changed_for_relation(%s, %s)", (self.number, relation)
        ).fetchone()
        assert row is not None
        return None if row[0] is None else set(row[0])

    def check(self) -> None:
        for relation in DECIDE:
            assert self.read(relation) == self.decided(relation), relation

    def cursor_reads_kept_pairs(self) -> bool:
        return all(self.changed(relation) is not None for relation in DECIDE)


def furnished(random: np.random.Generator, more: int) -> list[Entry]:
    """Two storeys of two rooms, and more, with tables, small blocks on them, and on the floor."""
    entries = [
        Entry("first", "storey", detail=StoreyDetail(0, 2.9)),
        Entry("second", "storey", pose=Pose(0, 0, 3), detail=StoreyDetail(1, 2.9)),
    ]
    places = [("first", 0, 0), ("first", 0, 5), ("second", 3, 0), ("second", 3, 5)]
    places += [("first", 0, 10 + 5 * i) for i in range(more)]
    for i, (storey, level, x) in enumerate(places):
        outline = drawn(x, 0, x + 4.9, 4, 0, 2.6)
        entries.append(room(f"room{i}", outline, storey, floor=0, ceiling=2.6))
        for j in range(3):
            u, v = x + 1.1 + 1.3 * j, random.uniform(0.9, 3.1)
            yaw = random.uniform(-0.1, 0.1) + random.choice([-1, 1]) * math.pi / 2
            z = level if storey == "first" else 0
            entries.append(thing(f"table{i}{j}", block(1, 0.6, 0.7), u, v, z, yaw, storey))
            entries.append(
                thing(f"cup{i}{j}", block(0.1, 0.1, 0.1), u, v, z + 0.7, yaw / 2, storey)
            )
            p, q = x + random.uniform(0.3, 4.6), random.uniform(0.3, 3.7)
            entries.append(thing(f"box{i}{j}", block(0.3, 0.2, 0.4), p, q, z, yaw, storey))
    return entries


def built(engine: Engine, seed: int, more: int = 0) -> Iterator[House]:
    random = np.random.default_rng(seed)
    name = f"house{next(MAPS)}"
    world = bodies(name, [])
    world.entries = furnished(random, more)
    store(engine, name, world)
    with engine.connect() as one, engine.connect() as two:
        sessions = [driver_of(connection) for connection in (one, two)]
        for session in sessions:
            session.autocommit = True
            session.execute(
                "INSERT INTO semantic_type (name) VALUES ('wall'), ('cup'), ('slab') "
                "ON CONFLICT DO NOTHING"
            )
            session.execute("SELECT set_config('semmap.map', %s, false)", (name,))
        row = sessions[0].execute("SELECT id FROM map WHERE name = %s", (name,)).fetchone()
        assert row is not None
        yield House(sessions[0], sessions[1], row[0], name, random)
        for session in sessions:
            session.rollback()
            session.autocommit = False


@pytest.fixture(params=range(2))
def house(request: pytest.FixtureRequest, module_engine: Engine) -> Iterator[House]:
    yield from built(module_engine, request.param)


@pytest.fixture
def small_house(module_engine: Engine) -> Iterator[House]:
    yield from built(module_engine, 7)


@pytest.fixture
def large_house(engine: Engine) -> Iterator[House]:
    yield from built(engine, 8, 30)  # alone in its database, so that statistics are of it


# What changes a map: each is one transaction.


def move(house: House) -> None:
    x, y = house.random.uniform((0, 0), (10, 4))
    z = house.random.choice([0, 0.7, 3, 3.7])
    yaw = house.random.uniform(-3, 3)
    house.session.execute("SELECT move_to(%s, %s, %s, %s, %s)", (house.one(), x, y, z, yaw))


def move_many(house: House) -> None:
    ids = [int(i) for i in house.random.choice(house.ids("object"), 7, replace=False)]
    house.session.execute(
        "UPDATE placement SET pose = pose_compose(pose, ARRAY[0.3, 0.1, 0, 0, 0, 0, 1]) "
        "WHERE entity_id = ANY (%s)",
        (ids,),
    )


def delete(house: House) -> None:
    house.session.execute("DELETE FROM entity WHERE id = %s", (house.one(),))


def delete_room(house: House) -> None:
    house.session.execute("DELETE FROM entity WHERE id = %s", (house.one("room"),))


def add(house: House) -> None:
    x, y = house.random.uniform((0, 0), (10, 4))
    with house.session.transaction():
        row = house.session.execute(
            "INSERT INTO entity (map_id, kind, name) VALUES (%s, 'object', %s) RETURNING id",
            (house.number, f"new{next(MAPS)}"),
        ).fetchone()
        assert row is not None
        house.session.execute(
            "INSERT INTO entity_model (entity_id, model_id) SELECT %s, model_id FROM entity_model "
            "WHERE entity_id = %s",
            (row[0], house.one()),
        )
        house.session.execute(
            "INSERT INTO placement (entity_id, pose) VALUES (%s, planar_pose(%s, %s))",
            (row[0], x, y),
        )


def put(house: House) -> None:
    one = house.one()
    house.session.execute(
        "SELECT put(entity_id, storey_id) FROM world WHERE entity_id = %s", (one,)
    )


def lift_storey(house: House) -> None:
    house.session.execute(
        "UPDATE placement SET pose[3] = pose[3] + 0.05 WHERE entity_id = %s", (house.one("storey"),)
    )


def lower_ceiling(house: House) -> None:
    house.session.execute(
        "UPDATE room SET ceiling = %s WHERE entity_id = %s",
        (house.random.uniform(0.2, 3), house.one("room")),
    )


def move_room(house: House) -> None:
    house.session.execute(
        "UPDATE placement SET pose[1] = pose[1] + 1 WHERE entity_id = %s", (house.one("room"),)
    )


def reshape(house: House) -> None:
    house.session.execute(
        "UPDATE entity_model m SET model_id = o.model_id FROM entity_model o "
        "WHERE o.entity_id = %s AND m.entity_id = %s",
        (house.one(), house.one()),
    )


def edit_model(house: House) -> None:
    row = house.session.execute(
        "SELECT model_id FROM entity_model WHERE entity_id = %s", (house.one(),)
    ).fetchone()
    with house.session.transaction():
        for column, table in (("hull", "model WHERE id"), ("geom", "chunk WHERE model_id")):
            where = table.replace("WHERE", f"SET {column} = ST_Scale({column}, 1.3, 1.2, 1) WHERE")
            house.session.execute(f"UPDATE {where} = %s".encode(), row)


def retype(house: House) -> None:
    house.session.execute(
        "UPDATE entity SET type = %s WHERE id = %s",
        (str(house.random.choice(["wall", "cup"])), house.one()),
    )


CHANGES = (move, move_many, delete, add, put, retype, reshape, edit_model, lower_ceiling, move_room,
           lift_storey, delete_room)  # fmt: skip


def test_pairs_are_those_that_a_decision_of_each_pair_finds(house: House) -> None:
    house.check()  # nothing is kept
    for relation in DECIDE:
        house.keep(relation)
    house.check()
    assert all(house.changed(relation) == set() for relation in DECIDE)
    for number, change in enumerate((*CHANGES[:8], move, move, *CHANGES[8:], move, add)):
        change(house)
        house.check()
        if number % 3 == 2:
            for relation in DECIDE:
                house.keep(relation)
            house.check()


def test_what_does_not_decide_a_relation_leaves_its_pairs_kept(small_house: House) -> None:
    house = small_house
    house.keep("near")
    one = house.one()
    house.session.execute("UPDATE entity SET label = 'x', name = 'other' WHERE id = %s", (one,))
    house.session.execute("UPDATE entity SET label = 'x' WHERE kind = 'room'")
    assert house.changed("near") == set()
    house.session.execute("SELECT move_to(%s, 1, 1, 0)", (one,))
    assert house.changed("near") >= {one}
    assert len(house.changed("near") or ()) < 6
    lower_ceiling(house)
    assert house.changed("near") is None


def test_a_room_that_gets_or_loses_its_heights_decides_all_again(small_house: House) -> None:
    house = small_house
    of_room = house.one("room")
    for statement in (
        "DELETE FROM room WHERE entity_id = %s",
        "INSERT INTO room (entity_id, floor, ceiling) VALUES (%s, 0, 2)",
    ):
        for relation in DECIDE:
            house.keep(relation)
        house.session.execute(statement.encode(), (of_room,))
        assert house.changed("near") is None
        house.check()


@pytest.mark.parametrize("relation", DECIDE)
def test_a_transaction_that_commits_after_relations_were_kept(
    small_house: House, relation: str
) -> None:
    house = small_house
    with house.other.transaction():
        house.other.execute("SELECT move_to(%s, 1, 1, 0)", (house.one(),))
        house.keep(relation)  # does not see the move
        seen = house.read(relation, house.other)
    assert house.read(relation) == house.decided(relation)
    assert house.read(relation) == seen


def test_a_rolled_back_move_is_not_kept(small_house: House) -> None:
    house = small_house
    before = house.decided("near")
    with house.session.transaction(force_rollback=True):
        house.session.execute("SELECT move_to(%s, 1, 1, 0)", (house.one(),))
        house.keep("near")
    assert house.read("near") == before
    with house.session.transaction():  # its own changes are after its cursor
        house.session.execute("SELECT move_to(%s, 1, 1, 0)", (house.one(),))
        house.keep("near")
        assert house.read("near") == house.decided("near")
    assert house.read("near") == house.decided("near")


def test_a_snapshot_reads_the_pairs_of_its_time(small_house: House) -> None:
    house = small_house
    house.keep("near")
    before = house.decided("near")
    house.other.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
    try:
        with house.other.transaction():
            house.other.execute("SELECT 1")
            move_many(house)
            house.keep("near")
            assert house.read("near", house.other) == before
            house.keep("near", house.other)  # does nothing: it would keep the past
            assert house.read("near", house.other) == before
    finally:
        house.other.isolation_level = None
    assert house.read("near") == house.decided("near") != before


def test_one_who_only_reads_gets_the_same(small_house: House) -> None:
    house = small_house
    house.other.read_only = True
    try:
        for again in (move_many, move, delete):
            with house.other.transaction():
                house.keep("on", house.other)  # does nothing
                assert house.read("on", house.other) == house.decided("on")
            house.keep("on")
            again(house)
    finally:
        house.other.read_only = None


def test_pruned_changes_and_other_functions_end_what_is_kept(small_house: House) -> None:
    house = small_house
    house.keep("near")
    assert house.changed("near") == set()
    with house.session.transaction(force_rollback=True):
        house.session.execute("INSERT INTO type_parent (type, parent) VALUES ('slab', 'wall')")
        assert house.changed("near") is None
    house.session.execute("UPDATE kept_relation SET basis = 'other functions'")
    assert house.changed("near") is None
    house.keep("near")
    assert house.changed("near") == set()
    with house.session.transaction(force_rollback=True):
        house.session.execute(
            "INSERT INTO change_pruned (xid) SELECT pg_current_xact_id()::text::bigint "
            "ON CONFLICT (id) DO UPDATE SET xid = excluded.xid"
        )
        assert house.changed("near") is None
        assert house.read("near") == house.decided("near")


def test_objects_beside_shapely(house: House) -> None:
    """The objects are upright blocks: their distance follows from ground and heights."""
    for relation in ("near", "touching"):
        house.keep(relation)
    for _ in range(4):
        move(house)
        move_many(house)
        rows = house.session.execute(
            "SELECT e.id, w.pose, m.hull FROM entity e JOIN world w ON w.entity_id = e.id "
            "JOIN entity_model em ON em.entity_id = e.id JOIN model m ON m.id = em.model_id "
            "WHERE e.map_id = %s AND e.kind = 'object'",
            (house.number,),
        ).fetchall()
        solids = {i: _prism(pose, hull) for i, pose, hull in rows}
        for relation, reach in (("near", 1.0), ("touching", 0.01)):
            expected = {
                (a, b)
                for a, b in itertools.permutations(solids, 2)
                if _gap(solids[a], solids[b]) <= reach
            }
            found = {(a, b) for a, b in house.read(relation) if {a, b} <= solids.keys()}
            assert found == expected
            assert expected


Prism = tuple[shapely.Polygon, float, float]  # the ground, the lowest and the highest height


def _gap(a: Prism, b: Prism) -> float:
    """Metres between the surfaces of two upright blocks, also where one is inside the other."""
    inside = [
        min(shapely.distance(small.boundary, large.boundary), low - floor, top - high)
        for (small, low, high), (large, floor, top) in ((a, b), (b, a))
        if large.contains(small)
    ]
    up = max(a[1] - b[2], b[1] - a[2], 0)
    return max(math.hypot(shapely.distance(a[0], b[0]), up), *inside, 0)


def _prism(pose: list[float], hull: Any) -> Prism:
    corners = shapely.get_coordinates(shapely.from_wkb(hull), include_z=True)
    yaw = 2 * math.atan2(pose[5], pose[6])
    ground = shapely.MultiPoint(corners[:, :2]).convex_hull
    turned = affinity.rotate(ground, yaw, origin=(0, 0), use_radians=True)
    placed = affinity.translate(turned, pose[0], pose[1])
    return placed, pose[2] + corners[:, 2].min(), pose[2] + corners[:, 2].max()


@pytest.mark.parametrize("side", SIDES)
def test_sides(house: House, side: str) -> None:
    move_many(house)
    found = house.session.execute(
        "SELECT a, b FROM pairs_to_side(%s, %s)", (house.number, side)
    ).fetchall()
    expected = house.session.execute(
        f"SELECT a.id, b.id FROM entity a JOIN entity b ON b.map_id = a.map_id AND a.id <> b.id "
        f"WHERE a.map_id = %s AND is_{SIDES[side]}(a.id, b.id, 'object')".encode(),
        (house.number,),
    ).fetchall()
    assert sorted(found) == sorted(expected)
    assert found


def answered(house: House, pattern: str) -> set[tuple[str, ...]]:
    answer = query(house.session, f"SELECT ?a ?b {{ {pattern} }}")
    assert len(answer.rows) == len(set(answer.rows))
    return {tuple(str(term).rsplit("#")[-1] for term in row) for row in answer.rows}


def test_a_question_keeps_a_relation_and_reads_it(small_house: House) -> None:
    house = small_house
    house.session.execute("ANALYZE")
    one = house.one()
    rows = house.session.execute(
        "SELECT id, name FROM entity WHERE map_id = %s", (house.number,)
    ).fetchall()
    names = dict(rows)
    for change in (None, move_many, move, delete, lower_ceiling):
        if change is not None:
            change(house)
        holders = set(house.session.execute("SELECT entity_id, holder_id FROM placement"))
        held = {a for a, holder in holders if holder is not None}
        for relation in ("on", "under", "near"):
            turned = {(b, a) for a, b in house.decided("above")}
            pairs = turned if relation == "under" else house.decided(relation)
            verb = f"semmap:{relation}"
            for pattern, expected in (
                (f"?a {verb} ?b", pairs),
                (f"?a semmap:heldBy ?h . ?a {verb} ?b", {p for p in pairs if p[0] in held}),
                (f"?a {verb} ?b . ?b semmap:heldBy ?h", {p for p in pairs if p[1] in held}),
                (f"?a {verb} ?b ; semmap:heldBy ?b", pairs & holders),
                (f"?a {verb} ?b . ?b {verb} ?a", pairs & {(b, a) for a, b in pairs}),
                (f"?a {verb} ?b . FILTER(?a = :{names[one]})", {p for p in pairs if p[0] == one}),
                (f"?a semmap:heldBy ?h OPTIONAL {{ ?a {verb} ?b }} FILTER(BOUND(?b))",
                 {p for p in pairs if p[0] in held}),
                (f"?a {verb} ?b FILTER NOT EXISTS {{ ?b {verb} ?a }}",
                 pairs - {(b, a) for a, b in pairs}),
            ):  # fmt: skip
                assert answered(house, pattern) == {(names[a], names[b]) for a, b in expected}
            if change is None:
                assert house.changed("above" if relation == "under" else relation) == set()


def test_a_question_about_few_keeps_nothing(large_house: House) -> None:
    house = large_house
    house.session.execute("ANALYZE")
    for few in (
        "SELECT ?a { ?a semmap:near :cup00 }",
        "SELECT ?b { :cup00 semmap:heldBy ?a . ?a semmap:near ?b }",
    ):
        query(house.session, few)
        assert house.changed("near") is None, few
    query(house.session, "SELECT ?a ?b { ?a semmap:near ?b }")
    assert house.changed("near") == set()


@pytest.fixture
def reader(small_house: House, module_engine: Engine) -> Iterator[psycopg.Connection[Any]]:
    """A session of the login that only reads, in the same map."""
    small_house.session.execute("ANALYZE")
    engine = as_reader(module_engine)
    assert engine is not None
    with engine.connect() as connection:
        session = driver_of(connection)
        session.execute("SELECT set_config('semmap.map', %s, false)", (small_house.name,))
        session.commit()
        yield session
        session.rollback()
    engine.dispose()


def test_the_login_that_only_reads_keeps_pairs_too(
    small_house: House, reader: psycopg.Connection[Any]
) -> None:
    house = small_house
    answer = query(reader, "SELECT ?a ?b { ?a semmap:near ?b }")
    assert len(answer.rows) == len(house.decided("near"))
    assert house.changed("near") == set()
    assert reader.execute("SHOW transaction_read_only").fetchone() == ("on",)
    reader.rollback()
    with pytest.raises(psycopg.Error, match=r"read-only|denied"):
        reader.execute("DELETE FROM kept_pair")


def test_a_question_is_answered_where_nothing_can_be_kept(
    small_house: House, reader: psycopg.Connection[Any]
) -> None:
    """As on a standby: what fails while relations are kept is not a failure of the question."""
    house, keep = small_house, "FUNCTION keep_relation(integer, text)"
    house.session.execute(f"REVOKE EXECUTE ON {keep} FROM semmap_reader")
    try:
        answer = query(reader, "SELECT ?a ?b { ?a semmap:near ?b }")
        assert len(answer.rows) == len(house.decided("near"))
        assert house.changed("near") is None
    finally:
        house.session.execute(f"GRANT EXECUTE ON {keep} TO semmap_reader")


@pytest.mark.parametrize(("pruned", "reaches"), [(99, True), (100, False), (110, False)])
def test_a_cursor_does_not_reach_over_a_pruned_change_of_an_open_transaction(
    small_house: House, pruned: int, reaches: bool
) -> None:
    """Transaction 100 was open at the cursor 100:120:100; 110 was seen, and pruned after it."""
    session = small_house.session
    with session.transaction(force_rollback=True):
        session.execute(
            "INSERT INTO change_pruned (xid) VALUES (%s) "
            "ON CONFLICT (id) DO UPDATE SET xid = excluded.xid",
            (pruned,),
        )
        found = session.execute("SELECT reaches_back('100:120:100')").fetchone()
        assert found == (reaches,)
