"""Link sets in the database, and the command, on a map and on files."""

from __future__ import annotations

import json

import psycopg
import pytest
from sqlalchemy import Engine
from typer.testing import CliRunner

from semmap.api.database import connect
from semmap.cli import app
from semmap.interlinking.reader import read_map_objects, read_object_models
from semmap.interlinking.records import InterlinkingError
from semmap.interlinking.store import link_sets, merged_records, store_links, undo_links
from tests.interlinking.data_sets import Case, interlink, person1, person2
from tests.seen import seen_by

SIZE = ("width", "length", "height")
TABLES = ("data_set", "data_record", "link_set", "record_link")


@pytest.fixture(scope="module")
def case() -> Case:
    return person2(originals=60, right=60, extra=20)


@pytest.fixture(scope="module")
def found(case):
    return interlink(case.left, case.right, {}, lambda a, b: (a, b) in case.links, 12)


@pytest.fixture
def connection(module_engine: Engine):
    with module_engine.connect() as connection:
        transaction = connection.begin()
        yield connection
        transaction.rollback()


@pytest.fixture
def session(connection) -> psycopg.Connection:
    return connection.connection.driver_connection


def rows(session) -> dict[str, list]:
    return {
        t: session.execute(f"SELECT * FROM semmap.{t} ORDER BY 1, 2").fetchall() for t in TABLES
    }


def test_undo_restores_what_was_there(session, case, found) -> None:
    first = store_links(session, found)
    before = rows(session)
    other = person1(n=20)
    second = store_links(
        session,
        interlink(other.left, other.right, {}, lambda a, b: (a, b) in other.links, 6),
    )
    third = store_links(session, found)  # the same data sets
    assert [row["id"] for row in link_sets(session)] == [third, second, first]
    assert len(session.execute("SELECT FROM semmap.data_set").fetchall()) == 4
    assert undo_links(session, second) > 0
    assert undo_links(session, third) == len(found.pairs)
    assert rows(session) == before
    undo_links(session, first)
    assert all(not left for left in rows(session).values())
    with pytest.raises(LookupError, match=f"no link set {first}: semmap interlink ls"):
        undo_links(session, first)


def test_links_and_records_are_stored_as_found(connection, session, case, found) -> None:
    number = store_links(session, found)
    stored = session.execute(
        "SELECT left_key, right_key, confidence FROM record_link WHERE link_set_id = %s", (number,)
    ).fetchall()
    assert {(left, right): confidence for left, right, confidence in stored} == found.links()
    assert all(confidence > 0 for _, _, confidence in stored)
    labels, left_id = session.execute(
        "SELECT labels, left_id FROM link_set WHERE id = %s", (number,)
    ).fetchone()
    assert labels == len(found.labels)
    records = dict(
        session.execute(
            "SELECT key, properties FROM data_record WHERE data_set_id = %s", (left_id,)
        ).fetchall()
    )
    assert sorted(records) == sorted(case.left.keys)
    one = records[case.left.keys[3]]
    assert {name: tuple(values) for name, values in one.items()} == case.left.record(3)


def test_the_merged_view_has_each_record_once(session, case, found) -> None:
    merged = merged_records(session, store_links(session, found))
    for side, records in (("left_keys", case.left), ("right_keys", case.right)):
        assert sorted(k for row in merged for k in row[side]) == sorted(records.keys)
    where = {key: number for number, row in enumerate(merged) for key in row["left_keys"]}
    there = {key: number for number, row in enumerate(merged) for key in row["right_keys"]}
    assert all(where[a] == there[b] for a, b in found.links())
    # as a union of links in plain Python
    groups = {frozenset(row["left_keys"] + row["right_keys"]) for row in merged}
    expected = {key: {key} for key in [*case.left.keys, *case.right.keys]}
    for a, b in found.links():
        joined = expected[a] | expected[b]
        expected.update(dict.fromkeys(joined, joined))
    assert groups == {frozenset(group) for group in expected.values()}
    new = {c.right: c.left for c in found.correspondences}
    for row in merged:
        values: dict[str, set[str]] = {}
        for records, keys in ((case.left, row["left_keys"]), (case.right, row["right_keys"])):
            for key in keys:
                for name, of in records.record(records.number[key]).items():
                    values.setdefault(name if records is case.left else new[name], set()).update(of)
        assert {name: set(of) for name, of in row["properties"].items()} == values
        assert (row["confidence"] is None) == (row["resource"] is None)


def test_a_robot_adds_links_and_does_not_take_them_back(session, found) -> None:
    session.execute("SET LOCAL ROLE semmap_robot")
    number = store_links(session, found)
    with pytest.raises(InterlinkingError, match="may not delete it: ask an admin"):
        undo_links(session, number)
    assert len(merged_records(session, number)) > 0
    session.execute("RESET ROLE")


def test_nothing_is_stored_where_a_link_is_refused(session, found) -> None:
    before = rows(session)
    found.confidence[0], kept = 2.0, found.confidence[0]
    try:
        with pytest.raises(psycopg.errors.CheckViolation):
            store_links(session, found)
    finally:
        found.confidence[0] = kept
    assert rows(session) == before


def test_object_models_of_the_household_kind(session) -> None:
    for statement in (
        "INSERT INTO semmap.device (id, name, kind) VALUES (5, 'pr2', 'gripper')",
        "INSERT INTO semmap.gripper (device_id, form, opening, depth) "
        "VALUES (5, 'parallel', .09, 0)",
        "INSERT INTO semmap.object_model (id, key, name, functions) "
        "VALUES (7, 'k', 'cup', '{drinking}')",
        "INSERT INTO semmap.action (kind, object_id, gripper_id, pose, approach) "
        "VALUES ('grasp', 7, 5, '{0,0.01,0.1,0,0,0,1}', 'side')",
    ):
        session.execute(statement)
    read = read_object_models(session)
    assert read.keys == ["k"]
    assert read.record(0) == {
        "name": ("cup",),
        "function": ("drinking",),
        "gripper": ("pr2",),
        "approach": ("side",),
        "grasps": ("1",),
        "grasp_points": ("0.000 0.010 0.100",),
    }


def test_the_command_links_a_map_with_a_file(database, tmp_path) -> None:
    names = ["red cup", "blue bowl", "steel pan", "oak tray", "glass jar", "tea pot", "salt mill"]
    with connect(database) as db:
        kitchen = db.create_map("kitchen")
        for number, name in enumerate(names):
            kitchen.add_object(
                name,
                pose=(number, 0, 0),
                size=(0.1 + number / 20, 0.2, 0.3),
                properties={"maker": f"m{number % 3}"},
            )
        read = read_map_objects(seen_by(kitchen.connection))
    size = {key: float(v) for key, (v,) in read.record(0).items() if key in SIZE}
    assert size == pytest.approx({"width": 0.15, "length": 0.2, "height": 0.3})
    shop = tmp_path / "shop.csv"
    lines = [
        f"{9 - i},{name.replace('e', 'ee', 1)},{0.1 + i / 20:.2f},0.2,0.31,m{i % 3}"
        for i, name in enumerate(names)
    ]
    shop.write_text("\n".join(["id,title,w,l,h,brand", *lines, "99,garden hose,9,1.5,1,m8"]))
    true = tmp_path / "true.csv"
    true.write_text("\n".join(f"{name},{9 - i},yes" for i, name in enumerate(names)))
    labels = tmp_path / "labels.csv"
    run = ["--db", database, "interlink", "map", str(shop)]
    links = tmp_path / "links.ttl"
    options = [
        "--labels",
        str(labels),
        "--ask",
        "--reference",
        str(true),
        "--turtle",
        str(links),
        "--json",
    ]
    bare = CliRunner().invoke(app, [*run, "--dry-run", "--reference", str(true), "--json"])
    assert json.loads(bare.stdout)["quality"]["f"] > 0.8
    assert json.loads(bare.stdout)["labels"] == 0
    done = CliRunner().invoke(app, [*run, *options], input="y\nperhaps\ny\ny\nq\n")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["quality"]["precision"] == 1
    assert said["quality"]["recall"] > 0.8
    assert said["labels"] == 3
    assert labels.read_text().count("yes") == 3
    assert links.read_text().count("owl:sameAs") == said["links"]
    shown = CliRunner().invoke(
        app, ["--db", database, "interlink", "show", str(said["link_set"]), "--json"]
    )
    assert {row["left_keys"][0] for row in json.loads(shown.stdout)} <= {*names}
    listed = CliRunner().invoke(app, ["--db", database, "interlink", "ls", "--json"])
    assert json.loads(listed.stdout)[0]["left"] == "map kitchen"
    undone = CliRunner().invoke(app, ["--db", database, "interlink", "undo", str(said["link_set"])])
    assert undone.stdout == f"{said['links']} links taken back\n"
    true.write_text(true.read_text() + "\ngreen cup,77,yes\n")
    labels.write_text("red cup,unknown,yes\nred cup,9,yes\noak tray,9,no\n")
    shown = CliRunner().invoke(
        app, [*run, "--labels", str(labels), "--reference", str(true), "--dry-run"]
    )
    assert "1 labels left out: the data sets do not have their records" in shown.stdout
    assert "1 reference links left out: the data sets do not" in shown.stdout
    labels.write_text("red cup,unknown,yes\n")
    wrong = CliRunner().invoke(app, [*run, "--labels", str(labels)])
    assert isinstance(wrong.exception, InterlinkingError)
    engine = connect(database)
    with engine as db:
        session = db.map("kitchen").connection
        assert session.execute("SELECT count(*) FROM semmap.data_set").fetchone() == (0,)
