"""The view `statement` and its table `triple`, beside a set of tuples."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import semmap
from semmap.database import open_engine
from semmap.database.migrate import downgrade, upgrade
from tests.conftest import MakeDatabase

XSD = "http://www.w3.org/2001/XMLSchema#"
COLUMNS = "graph, subject_id, subject, predicate, object_id, object, tag"
IRIS = st.sampled_from(["urn:a", "urn:b", "urn:semmap:map:loft#lamp", "http://e/" + "long" * 900])
LITERALS = st.tuples(
    st.sampled_from(["", "1", "urn:a", "x" * 5000, "é\u1e9e"]),
    st.sampled_from([f"{XSD}string", f"{XSD}integer", "@en", "I"]),
).filter(lambda term: term != ("", "I"))
ENDS = st.integers(0, 1)  # numbers of entities
STATEMENTS = st.tuples(
    st.sampled_from(["", "urn:g", "urn:a"]), st.one_of(ENDS, IRIS), IRIS, st.one_of(ENDS, LITERALS)
)


def columns_of(statement: tuple[Any, ...], ids: list[int]) -> tuple[Any, ...]:
    """Return the columns of a statement."""
    graph, subject, verb, object_ = statement
    left = (ids[subject], None) if isinstance(subject, int) else (None, subject)
    right = (ids[object_], None, None) if isinstance(object_, int) else (None, *object_)
    return (graph, *left, verb, *right)


@pytest.fixture
def stating(make_database: MakeDatabase) -> Any:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        loft = db.create_map("loft")
        loft.add_object("mug", size=(0.1, 0.1, 0.1), pose=(1, 1, 0))
        loft.add_object("cup", size=(0.1, 0.1, 0.1), pose=(2, 1, 0))
        yield loft


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(STATEMENTS, unique=True, max_size=8), st.lists(STATEMENTS, unique=True, max_size=3))
def test_rows_are_written_changed_and_removed(
    stating: semmap.Map, first: list[Any], later: list[Any]
) -> None:
    session = stating.connection
    ids = [stating["mug"].id, stating["cup"].id]
    insert = f"INSERT INTO statement (map_id, {COLUMNS}) VALUES (current_map(), {_SEVEN})"
    with session.transaction(force_rollback=True):
        for each in first:
            session.execute(insert.encode(), columns_of(each, ids))
        known = {columns_of(each, ids) for each in first}
        read = f"SELECT {COLUMNS} FROM statement WHERE map_id = current_map()".encode()
        assert sorted(map(str, session.execute(read))) == sorted(map(str, known))
        for former, new in zip(first, later, strict=False):
            if columns_of(new, ids) in known:
                continue
            session.execute(
                f"UPDATE statement SET ({COLUMNS}) = ROW({_SEVEN}) WHERE {_IS}".encode(),
                [*columns_of(new, ids), *columns_of(former, ids)],
            )
            known = known - {columns_of(former, ids)} | {columns_of(new, ids)}
        assert {*session.execute(read)} == known
        for gone in first[::2]:
            session.execute(f"DELETE FROM statement WHERE {_IS}".encode(), columns_of(gone, ids))
            known -= {columns_of(gone, ids)}
        assert {*session.execute(read)} == known
        session.execute("SELECT prune_terms()")
        assert {*session.execute(read)} == known
        used = {(t, "I") for k in known for t in (k[0], k[2], k[3]) if t}
        used |= {(k[5], k[6]) for k in known if k[6]}
        assert {*session.execute("SELECT text, tag FROM term")} == used


_SEVEN = ", ".join(["%s"] * 7)
_IS = " AND ".join(f"{name} IS NOT DISTINCT FROM %s" for name in COLUMNS.split(", "))


@pytest.mark.parametrize(
    "columns",
    [
        {"subject": "urn:a", "subject_id": 1, "object": "b", "tag": "I"},
        {"object": "b", "tag": "I"},
        {"subject": "urn:a"},
        {"subject": "urn:a", "object": "b"},
        {"subject": "urn:a", "object": "b", "tag": ""},
        {"subject": "", "object": "b", "tag": "I"},
    ],
)
def test_a_row_has_one_subject_and_one_object(stating: semmap.Map, columns: dict[str, Any]) -> None:
    names, values = ", ".join(columns), ", ".join(["%s"] * len(columns))
    sql = f"INSERT INTO statement (map_id, predicate, {names}) SELECT 1, 'urn:p', {values}"
    with pytest.raises(psycopg.errors.CheckViolation, match="one subject and one object"):
        stating.connection.execute(sql.encode(), [*columns.values()])


def test_terms_that_others_add_at_the_same_time(make_database: MakeDatabase) -> None:
    url = make_database().render_as_string(hide_password=False)
    ask = "SELECT term_ids(ARRAY['urn:new', 'urn:old'], ARRAY['I', 'I'])"
    with semmap.connect(url) as mine, semmap.connect(url) as other:
        one, two = mine.create_map("loft").connection, other.map("loft").connection
        first = one.execute(ask).fetchone()
        with two.transaction():
            assert two.execute(ask).fetchone() == first
            assert one.execute("SELECT prune_terms()").fetchone() == (0,)
        assert one.execute("SELECT prune_terms()").fetchone() == (2,)


def test_statements_of_earlier_versions(make_database: MakeDatabase) -> None:
    """Revision 0006 keeps each row with its id, times and author, up and down."""
    url = make_database()
    rows = f"SELECT id, map_id, {COLUMNS}, since, until, stated_by::text FROM statement ORDER BY id"
    with semmap.connect(url.render_as_string(hide_password=False)) as db:
        loft = db.create_map("loft")
        loft.add_object("mug", size=(0.1, 0.1, 0.1), pose=(1, 1, 0))
        db.create_map("attic")
        loft.update(
            "PREFIX ex: <http://e/> INSERT DATA { :mug ex:of ex:bob, 'bob'@en, 5 . "
            "ex:bob ex:has :mug ; ex:says 'I' GRAPH ex:g { ex:bob ex:has :mug } }"
        )
        loft.execute("UPDATE statement SET until = now() + interval '1 h' WHERE tag = '@en'")
        known = loft.connection.execute(rows.encode()).fetchall()
    assert len(known) == 6
    engine = open_engine(url)
    downgrade(engine, "0005")
    with engine.connect() as connection:
        former = connection.exec_driver_sql(rows.replace("FROM s", "FROM semmap.s")).all()
        assert [*map(tuple, former)] == known
    engine.dispose()
    upgrade(engine)
    engine.dispose()
    with semmap.connect(url.render_as_string(hide_password=False)) as db:
        assert db.map("loft").connection.execute(rows.encode()).fetchall() == known
        assert db.map("loft").sparql("ASK { ?x <http://e/of> 5 }").truth
        update = "INSERT DATA { :mug <http://e/of> 6 }"
        assert db.map("loft").update(update).added == 1


@pytest.mark.parametrize("isolation", ["READ COMMITTED", "REPEATABLE READ"])
def test_terms_that_others_add_meanwhile_are_found(stating: semmap.Map, isolation: str) -> None:
    ask = b"SELECT semmap.term_ids(ARRAY['urn:1', 'urn:2', 'urn:3'], ARRAY['I', 'I', 'I'])"
    url = stating.database.address.replace("+psycopg", "")
    with psycopg.connect(url) as one, psycopg.connect(url) as two, ThreadPoolExecutor() as pool:
        two.execute(f"SET TRANSACTION ISOLATION LEVEL {isolation}".encode())
        two.execute("SELECT 1 FROM pg_class")  # it has a snapshot
        first = one.execute("SELECT semmap.term_ids(ARRAY['urn:2'], ARRAY['I'])").fetchone()
        waiting = pool.submit(lambda: two.execute(ask).fetchone())
        while waiting.running() and not one.execute(_WAITING).fetchone():
            pass
        one.commit()
        if isolation == "REPEATABLE READ":
            with pytest.raises(psycopg.errors.SerializationFailure):
                waiting.result()
            return
        row = waiting.result()
        assert first is not None
        assert row is not None
        assert row[0][1] == first[0][0]
        assert len(set(row[0])) == 3


_WAITING = "SELECT 1 FROM pg_locks WHERE NOT granted"
