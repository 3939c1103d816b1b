"""Teachings that are taken back, beside the map as it was before them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import permutations
from typing import Any

import psycopg
import pytest

import semmap
from semmap.belief.error import BeliefError
from tests import command_line
from tests.conftest import MakeDatabase

TABLES = {
    "semantic_type": "to_jsonb(t)",
    "type_parent": "to_jsonb(t)",
    "type_closure": "to_jsonb(t)",
    "entity": "to_jsonb(t) - 'since' - 'id'",
    "link": "to_jsonb(t)",
    "placement": "to_jsonb(t) - 'since' - 'confidence'",
    "taught_relation": "to_jsonb(t)",
    "taught_action": "to_jsonb(t)",
    "belief_model": "to_jsonb(t)",
    "observation": "to_jsonb(t)",
    "teaching": "to_jsonb(t)",
    "taught_fact": "to_jsonb(t)",
}

BREAKFAST: dict[str, Any] = {
    "knowledge": [{"name": "sodacan", "properties": {"mobility": 2}}, {"name": "coke_held"}],
    "relations": [
        {"subject": "sodacan", "relation": "isA", "object": "drinkware"},
        {"subject": "sodacan", "relation": "found_in", "object": "kitchen"},
        {"subject": "mug1", "relation": "belongs to", "object": "robot"},
    ],
    "actions": [{"action": "grasp", "cause": "sodacan", "effect": "coke_held"}],
    "objects": [
        {"name": "coke", "class": "sodacan", "base_area": 0.0035, "volume": 0.0004},
        {"name": "mug1", "mobility": 3, "properties": {"colour": "red"}},
    ],
    "observations": [{"object": "mug1", "place": "table2", "position": [0.1, 0.1, 0.75]}],
    "model": {"moves": 3600, "elsewhere": 0.3, "there": 0.6, "change": 0.1},
}
SUPPER: dict[str, Any] = {
    "knowledge": [{"name": "sodacan", "properties": {"mobility": 1, "cold": True}}],
    "relations": [{"subject": "sodacan", "relation": "found_in", "object": "kitchen"}],
    "objects": [
        {"name": "coke", "class": "sodacan", "base_area": 0.0036},
        {"name": "mug1", "mobility": 4},
    ],
    "model": {"there": 0.7},
}
LUNCH: dict[str, Any] = {
    "sentences": ["the mug 1 is on the table 1", "a mug is a drinkware"],
    "knowledge": [{"name": "mug1", "properties": {"colour": "blue"}}],
    "model": {"moves": 60},
}


@pytest.fixture(scope="module")
def db(make_database: MakeDatabase) -> Iterator[semmap.Database]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        for name in ("flat", "other"):
            flat = db.create_map(name)
            outline = [(0, 0), (6, 0), (6, 4), (0, 4)]
            flat.add_room("kitchen", outline, ceiling=2.7, type="kitchen")
            flat.add_object("table1", type="table", size=(1.2, 0.8, 0.75), pose=(1.5, 1.5, 0))
            flat.add_object("table2", type="table", size=(1.2, 0.8, 0.75), pose=(4.5, 1.5, 0))
            flat.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1), on="table1")
            flat.add_agent("robot", type="robot", size=(0.5, 0.5, 1.2), pose=(0.5, 0.5, 0))
        yield db


@pytest.fixture
def flat(db: semmap.Database) -> Iterator[semmap.Map]:
    flat = db.map("flat")
    with flat.transaction() as transaction:
        yield flat
        raise psycopg.Rollback(transaction)


def state(flat: semmap.Map) -> dict[str, list[str]]:
    """All rows that a teaching may change, of both maps."""
    found = {}
    for table, row in TABLES.items():
        rows = flat.execute(f"SELECT {row} FROM {table} t")
        found[table] = sorted(json.dumps(each, sort_keys=True) for (each,) in rows)
    return found


def knowledge(flat: semmap.Map) -> dict[str, list[str]]:
    """The rows of tables that have no number, on which a second teaching would count."""
    tables = ("semantic_type", "type_parent", "entity", "taught_relation", "belief_model")
    return {table: rows for table, rows in state(flat).items() if table in tables}


@pytest.mark.parametrize("taught", [BREAKFAST, SUPPER, LUNCH], ids=["breakfast", "supper", "lunch"])
def test_all_is_as_it_was_before(flat: semmap.Map, taught: dict[str, Any]) -> None:
    before = state(flat)
    flat.teach(taught)
    assert state(flat) != before
    (found,) = flat.list_teachings()
    assert flat.undo_teaching(found["id"]) == []
    assert state(flat) == before


@pytest.mark.parametrize("order", [*permutations(range(3))])
def test_teachings_are_taken_back_in_any_order(flat: semmap.Map, order: tuple[int, ...]) -> None:
    """What is left of several is what the others alone would have taught."""
    lessons = [BREAKFAST, SUPPER, {k: v for k, v in LUNCH.items() if k != "sentences"}]
    before = state(flat)
    for taught in lessons:
        flat.teach(taught)
    ids = [row["id"] for row in reversed(flat.list_teachings())]
    for number, gone in enumerate(order, 1):
        assert flat.undo_teaching(ids[gone]) == []
        left = knowledge(flat)
        with flat.transaction() as only:
            for row in flat.list_teachings():
                flat.undo_teaching(row["id"])
            assert state(flat) == before
            for other in sorted({*range(3)} - {*order[:number]}):
                flat.teach(lessons[other])
            for table, rows in knowledge(flat).items():
                assert rows == left[table], table
            raise psycopg.Rollback(only)


def test_what_others_use_or_changed_is_kept_and_named(flat: semmap.Map) -> None:
    flat.teach(BREAKFAST)
    (found,) = flat.list_teachings()
    flat.add_object("coke2", type="sodacan")
    flat.observe("coke", "table2")
    flat["mug1"].properties = {"colour": "green"}
    kept = flat.undo_teaching(found["id"])
    assert sorted(kept) == [
        "entity coke",
        "entity mug1 properties.colour",
        "entity mug1 properties.mobility",
        "semantic_type sodacan",
    ]
    assert flat["coke2"].type == "sodacan"
    assert flat["coke"].type is None
    assert flat["mug1"].properties["colour"] == "green"
    assert flat.list_teachings() == []


def test_another_map_has_nothing_of_it(db: semmap.Database) -> None:
    flat, other = db.map("flat"), db.map("other")
    tables = ("entity", "taught_relation", "taught_action", "belief_model", "teaching")
    rows = "SELECT to_jsonb(t) FROM {} t WHERE map_id = current_map() ORDER BY 1"
    before = [other.execute(rows.format(table)) for table in tables]
    everything = state(flat)
    flat.teach(BREAKFAST)
    (found,) = flat.list_teachings()
    assert [other.execute(rows.format(table)) for table in tables] == before
    assert "coke" not in other
    with pytest.raises(BeliefError, match="not a sentence"):
        other.ask("grasp")
    assert other.list_teachings() == []
    with pytest.raises(LookupError, match=r"has no teaching \d+: `semmap belief taught` lists"):
        other.undo_teaching(found["id"])
    flat.undo_teaching(found["id"])
    assert state(flat) == everything


def test_a_robot_teaches_and_takes_nothing_back(flat: semmap.Map) -> None:
    flat.execute("SET LOCAL ROLE semmap_robot")
    flat.teach("the mug 1 is on the table 2")
    (found,) = flat.list_teachings()
    assert (found["name"], found["by"]) == ("the mug 1 is on the table 2", "semmap_robot")
    with pytest.raises(BeliefError, match="may not take it back: ask an admin"):
        flat.undo_teaching(found["id"])


def test_a_refused_teaching_leaves_no_trace(flat: semmap.Map) -> None:
    before = state(flat)
    with pytest.raises(BeliefError):
        flat.teach({"relations": [{"subject": "mug1", "relation": "isA", "object": "kitchen"}]})
    assert state(flat) == before


def test_the_commands(db: semmap.Database) -> None:
    url, chosen = db.address, ("--map", "flat")
    command_line.semmap(url, "teach", "a mug is a container", *chosen)
    command_line.semmap(url, "teach", "the mug 1 is on the table 2", *chosen)
    rows = json.loads(command_line.semmap(url, "belief", "taught", "--json", *chosen).stdout)
    names = ["the mug 1 is on the table 2", "a mug is a container"]
    assert [row["name"] for row in rows] == names
    for row in rows:
        done = command_line.semmap(url, "belief", "undo", row["id"], *chosen)
        assert done.stdout == "taken back\n"
    assert command_line.semmap(url, "belief", "taught", "--json", *chosen).stdout == "[]\n"
