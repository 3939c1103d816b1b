"""SQL through a map: what it reads, with which login, in which transaction, and what it refuses."""

from __future__ import annotations

import re
from typing import Any

import psycopg
import pytest

import semmap

COUNT = "SELECT count(*) FROM entity WHERE map_id = current_map()"


@pytest.fixture
def flat(db: semmap.Database) -> semmap.Map:
    made = db.create_map("flat")
    made.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.6)
    made.add_object("table1", type="table", size=(1, 1, 0.7), in_="kitchen")
    return made


def test_rows_have_columns_and_values(flat: semmap.Map, database: str) -> None:
    found = flat.sql("SELECT name, kind, id AS name FROM entity WHERE kind <> %s", "storey")
    assert found.columns == ("name", "kind", "name")
    assert len(found) == 2
    with psycopg.connect(database.replace("+psycopg", "")) as other:
        asked = "SELECT name, kind, id FROM semmap.entity WHERE kind <> 'storey'"
        assert sorted(found) == sorted(other.execute(asked))
    assert found[0] in found
    assert "<th>kind</th>" in found._repr_html_()
    assert flat.sql("SELECT '100%' AS a, '%s' AS b").rows == (("100%", "%s"),)
    assert flat.sql("SELECT %s::text", "<b>")._repr_html_().count("&lt;b&gt;") == 1


def test_reads_are_those_of_a_login_that_only_reads(flat: semmap.Map) -> None:
    who = "SELECT current_user, session_user"
    assert flat.sql(who)[0] == ("semmap_read", "semmap_read")
    assert flat.sql(who).notes == ()
    assert flat.database.sql(who)[0] == ("semmap_read", "semmap_read")
    assert flat.sql(who, write=True)[0] == ("semmap", "semmap")


def test_a_transaction_reads_what_it_has_changed(flat: semmap.Map) -> None:
    with flat.transaction() as transaction:
        flat.sql("DELETE FROM entity WHERE name = %s", "table1", write=True)
        inside = flat.sql(f"{COUNT} AND name = 'table1'")
        assert inside[0] == (0,)
        assert "superuser" in inside.notes[0]
        assert flat.sql("SELECT current_user")[0] == ("semmap_reader",)
        with pytest.raises(ValueError, match="read-only"):
            flat.sql("WITH x AS (DELETE FROM entity RETURNING id) SELECT id FROM x")
        assert flat.sql("SELECT current_user", write=True)[0] == ("semmap",)
        raise psycopg.Rollback(transaction)
    assert flat.sql(f"{COUNT} AND name = 'table1'")[0] == (1,)


def test_each_map_sees_itself(db: semmap.Database, flat: semmap.Map) -> None:
    other = db.create_map("other")
    for _ in range(2):
        assert flat.sql(COUNT)[0] == (2,)
        assert other.sql(COUNT)[0] == (0,)
    flat.close()
    assert flat.sql(COUNT)[0] == (2,)


def test_a_database_without_maps_is_asked(db: semmap.Database) -> None:
    assert db.sql("SELECT count(*) FROM map")[0] == (0,)
    assert db.sql("INSERT INTO map (name) VALUES (%s)", "new", write=True)[0] == (1,)
    assert db.maps == ["new"]


REFUSED: list[tuple[str, dict[str, Any], str]] = [
    (" ;", {}, "no statement"),
    ("DELETE FROM entity", {}, "permission denied for DELETE: .*Add write=True"),
    (
        "WITH x AS (DELETE FROM entity RETURNING id) SELECT id FROM x",
        {},
        "read-only.*write=True",
    ),
    ("SELECT nothing", {}, 'column "nothing" does not exist'),
    ("SELECT 1; SELECT 2", {}, "cannot insert multiple commands"),
    ("SELECT 1/0", {}, "division by zero"),
    ("SELECT entity_id('nowhere')", {"write": True}, "no entity named nowhere"),
    ("COPY entity TO STDOUT", {"write": True}, "copies nothing to and fro"),
    ("COPY map (name) FROM STDIN", {"write": True}, "copies nothing to and fro"),
]


@pytest.mark.parametrize(("statement", "how", "says"), REFUSED, ids=[each[0] for each in REFUSED])
def test_refusals_are_plain_and_leave_the_map_usable(
    flat: semmap.Map, statement: str, how: dict[str, Any], says: str
) -> None:
    for _ in range(2):
        with pytest.raises(ValueError, match=says):
            flat.sql(statement, **how)
    assert flat.sql(COUNT)[0] == flat.sql(COUNT, write=True)[0] == (2,)


def test_the_views_that_have_one_map_are_those_that_sql_names(flat: semmap.Map) -> None:
    other = flat.database.create_map("other")
    other.add_room("hall", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.6)
    other.add_object("stool1", type="stool", size=(0.4, 0.4, 0.4), in_="hall")
    views = flat.sql(
        "SELECT viewname, definition ~ 'current_map' FROM pg_views WHERE schemaname = 'semmap'"
    )
    of_one = {name for name, states_it in views if states_it}
    said = semmap.Map.sql.__doc__ or ""
    (named,) = re.findall(r"The views (.*?) have this map alone", said, re.DOTALL)
    assert {*re.findall(r"``(\w+)``", named)} == of_one
    assert {"entry", "object"} < of_one < {name for name, _ in views}
    for name in ("entry", "object"):
        own, others = (
            {row[0] for row in each.sql(f"SELECT id FROM {name}")} for each in (flat, other)
        )
        assert len(own) > 0
        assert own.isdisjoint(others)
    everything = "SELECT name FROM entity"
    assert {*flat.sql(everything)} == {*other.sql(everything)}
    assert flat.sql(f"{everything} WHERE map_id = current_map() AND kind = 'room'")[0] == (
        "kitchen",
    )
