"""Teachings by methods of a map, and the example of the documentation."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

import semmap

PAGE = Path(__file__).parents[2] / "docs/belief.md"


@pytest.fixture
def kitchen(database: str) -> Any:
    with semmap.connect(database) as db:
        kitchen = db.create_map("flat")
        kitchen.add_room("kitchen", [(0, 0), (6, 0), (6, 4), (0, 4)], ceiling=2.7, type="kitchen")
        kitchen.add_object("table1", type="table", size=(1.2, 0.8, 0.75), pose=(1.5, 1.5, 0))
        kitchen.add_object("table2", type="table", size=(1.2, 0.8, 0.75), pose=(4.5, 1.5, 0))
        yield kitchen


def test_the_example_of_the_page_is_taught(kitchen: semmap.Map, tmp_path: Path) -> None:
    (example,) = re.findall(r"```json\n(.*?)```", PAGE.read_text(), re.DOTALL)
    file = tmp_path / "breakfast.json"
    file.write_text(example)
    counts = kitchen.teach(file)
    taught = json.loads(example)
    assert counts == {"types": 3, "relations": 2, "actions": 1, "objects": 1, "observations": 2}
    assert kitchen["coke"].is_a("sodacan")
    chain = [(a.name, a.cause, a.effect) for a in kitchen.how_to("object_held")]
    assert chain == [tuple(taught["actions"][0].values())]
    assert kitchen.how_to("object_held", ["object_held"]) == []
    assert "coke" in kitchen.grammar("jsgf")


def test_a_state_that_nobody_taught_is_named(kitchen: semmap.Map) -> None:
    fill = {"action": "fill", "cause": "cup_held", "effect": "cup_full"}
    known = [{"name": "cup_held"}]
    message = r"action fill: .* has cup_full, its effect: teach it as knowledge, \{\"name\": \"cup_"
    with pytest.raises(LookupError, match=message):
        kitchen.teach({"knowledge": known, "actions": [fill]})
    known.append({"name": "cup_full"})
    assert kitchen.teach({"knowledge": known, "actions": [fill]})["actions"] == 1
    with pytest.raises(LookupError, match="did you mean cup_full"):
        kitchen.how_to("cup_ful")


@pytest.mark.parametrize(
    ("taught", "message"),
    [
        ("gone.json", r"cannot be read \(No such file or directory\)"),
        (None, "teaching is None: give a text, a path or a mapping"),
        ({"knowledge": [{"name": "a\0b"}]}, "a value cannot be stored: .* NUL"),
        ({"knowledge": [{"name": "ab", "properties": {"x": "\0"}}]}, "a value cannot be stored"),
        ({"knowledge": [{"name": "ab", "properties": {"x": float("nan")}}]}, "values that JSON ha"),
        ({"knowledge": [{"name": "ab", "properties": {"x": object()}}]}, "values that JSON has"),
    ],
)
def test_bad_input_is_refused_in_words(kitchen: semmap.Map, taught: Any, message: str) -> None:
    before = kitchen.types()
    with pytest.raises(ValueError, match=message):
        kitchen.teach(taught)
    assert kitchen.types() == before
    with pytest.raises(ValueError, match=r"format is .abnf.: give one of gbnf, jsgf"):
        kitchen.grammar("abnf")
