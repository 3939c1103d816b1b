"""A misspelt name or type is refused with the names that it may stand for, wherever it is given."""

from __future__ import annotations

import difflib

import pytest


@pytest.mark.parametrize(
    ("statement", "meant"),
    [
        ("UPDATE entity SET type = 'mugg' WHERE name = 'Mug_01'", "mug"),
        ("INSERT INTO entity (map_id, kind, name, type) SELECT id, 'object', 'x', 'tabel' FROM map",
         "table"),
        ("UPDATE gis_object SET type = 'mugg' WHERE name = 'Mug_01'", "mug"),
        ("SELECT entity_id('Tabel_01')", "Table_01"),
        ("SELECT entities_named('mugg')", "mug"),
        ("SELECT entities_named('Mug_1')", "Mug_01"),
        ("SELECT drop_map('lounges')", "lounge"),
        ("SELECT copy_map('loung', 'twin')", "lounge"),
        ("SELECT map_named('loung')", "lounge"),
    ],
)  # fmt: skip
def test_sql_says_what_may_be_meant(room, statement: str, meant: str) -> None:
    with pytest.raises((LookupError, ValueError)) as refused:
        room.execute(statement)
    assert meant in str(refused.value).partition("Did you mean ")[2]
    assert [each.name for each in room.find("mug")] == ["Mug_01"]


@pytest.mark.parametrize(
    ("ask", "meant"),
    [
        (lambda room: room.where("mugg"), "mug"),
        (lambda room: room.where("Mug_1"), "Mug_01"),
        (lambda room: room.find("tabel"), "table"),
        (lambda room: room["Tabel_01"], "Table_01"),
        (lambda room: room.observe("Mug_01", "Tabel_01"), "Table_01"),
        (lambda room: room.search("mugg", start="hall"), "mug"),
        (lambda room: room.plan("on(mugg, Table_01)", start="hall"), "mug"),
        (lambda room: room.plan("on(mug, Table_01)", start="hal"), "hall"),
        (lambda room: room.route("hal", "Table_01"), "hall"),
        (lambda room: room.add_object("x", type="tabel"), "table"),
        (lambda room: room.database.map("loung"), "lounge"),
    ],
)
def test_python_says_what_may_be_meant(room, ask, meant: str) -> None:
    with pytest.raises((LookupError, ValueError)) as refused:
        ask(room)
    assert meant in str(refused.value).partition(";")[2]


def test_a_hint_has_the_name_that_difflib_finds_nearest(room) -> None:
    """Of types with one letter left out, doubled or exchanged."""
    types = [row[0] for row in room.execute("SELECT name FROM semantic_type ORDER BY name")]
    types = [each for each in types if len(each) > 5][::7][:100]
    missed = []
    for number, each in enumerate(types):
        k = 1 + number % (len(each) - 2)
        letter = ("", 2 * each[k], "x")[number % 3]
        wrong = each[:k] + letter + each[k + 1 :]
        ((hint,),) = room.execute("SELECT type_hint(%s)", wrong)
        if each not in hint and each in difflib.get_close_matches(wrong, types, 1):
            missed.append((wrong, each, hint))
    assert len(missed) <= len(types) // 20, missed
