"""Each sentence of a map's grammar through `teach` and `ask`, beside the methods that answer."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

import semmap
from semmap.belief.error import BeliefError
from semmap.belief.grammar import LISTS
from semmap.belief.sentences import understand
from tests import command_line
from tests.belief.jsgf import generated
from tests.conftest import MakeDatabase

ONLY = {
    "thing": ["mug 1"],
    "place": ["table", "kitchen"],
    "type": ["mug", "drinkware"],
    "action": ["grasp"],
    "kind": ["mug", "drinkware"],
    "group": ["mug", "drinkware"],
    "hour": ["midnight", "eight in the morning", "six in the evening"],
}
"""Of the names of the map, those that the test speaks of: of each rule of its grammar."""


@pytest.fixture(scope="module")
def house(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        house = db.create_map("house")
        house.add_room("kitchen", [(0, 0), (5, 0), (5, 4), (0, 4)], ceiling=2.7, type="kitchen")
        house.add_object("table", type="table", size=(1.2, 0.8, 0.75), pose=(3, 2, 0))
        house.add_object("desk", type="desk", size=(1.2, 0.8, 0.75), pose=(1, 3, 0))
        house.add_object("mug_1", type="mug", size=(0.08, 0.08, 0.1), on="desk")
        house.add_agent("robot", type="robot", size=(0.5, 0.5, 1.2), pose=(0.5, 0.5, 0))
        states = [{"name": "mug_found"}, {"name": "mug_held"}, {"name": "mug_washed"}]
        actions = [
            {"action": "grasp", "cause": "mug_found", "effect": "mug_held"},
            {"action": "wash", "cause": "mug_held", "effect": "mug_washed"},
        ]
        house.teach({"knowledge": states, "actions": actions})
        yield house


def direct(house: semmap.Map, sentence: str) -> Any:
    """The answer of the method that a person would call, chosen by the words of the sentence."""
    words = sentence.replace(" the ", " ").removeprefix("the ").split()
    place = words[-1]
    item = next(
        (name for name in ("drinkware", "mug_1", "mug") if name in sentence.replace(" ", "_")), ""
    )
    if words[0] == "which":
        return house.which(words[1], words[-2], datetime.now(UTC) - timedelta(days=1))
    if words[0] == "where":
        hour = {"midnight": 0, "morning": 8, "evening": 18}.get(words[-1])
        now = datetime.now(UTC)
        wait = 0 if hour is None else (hour - now.hour - 1) % 24 * 60 + 60 - now.minute
        return dict(house.where("mug_1", now + timedelta(minutes=wait)))
    if words[0] == "find":
        return house.search("mug_1").as_json()
    if words[0] == "bring":
        return f"on({item}, table)" if place == "table" else f"in({item}, kitchen)"
    if words[0] == "go":
        return house.route("robot", place).places
    if words[0] == "grasp":
        return ["grasp"]
    if words[-2] in ("in", "on"):
        at = house.where("mug_1")
        return at["table"] if place == "table" else sum(at.values()) - at["elsewhere"]
    return words[0] == "mug" or place == "drinkware" or words[1] == place


def test_each_sentence_is_asked(house: semmap.Map) -> None:
    sentences = generated(house.grammar("jsgf"), ONLY)
    assert len({s.split()[0] for s in sentences}) >= 7
    for sentence in sentences:
        found = house.ask(sentence)
        result, wanted = found.result, direct(house, sentence)
        if sentence.startswith("where"):
            assert dict(result) == pytest.approx(wanted, abs=2e-3)
        elif sentence.startswith("which"):
            assert result == pytest.approx(wanted, abs=1e-6)
            assert [*result] == ["mug_1"]
        elif sentence.startswith("find"):
            assert result.as_json()["tour"] == wanted["tour"]
        elif sentence.startswith("bring"):
            assert result.goal.replace('"', "") == wanted
            there = sentence.endswith("kitchen")  # where it is already
            assert [a.name for a in result.actions][-1:] == ([] if there else ["place"])
        elif sentence.startswith("go"):
            assert result.places == wanted
        elif sentence == "grasp":
            assert [action.name for action in result] == wanted
        elif isinstance(wanted, bool):
            assert result is wanted, sentence
        else:
            assert result == pytest.approx(wanted, abs=1e-6), sentence
        assert found.text
        json.dumps(found.as_json(), default=str)
    assert [a.name for a in house.ask("wash").result] == ["grasp", "wash"]


def test_each_statement_is_taught_and_the_others_are_refused(house: semmap.Map) -> None:
    for sentence in generated(house.grammar("jsgf"), ONLY):
        if sentence.startswith(("a drinkware is", "an drinkware is")) and sentence.endswith("mug"):
            with pytest.raises(BeliefError, match="contradicts the map, where mug is a kind of dr"):
                house.teach(sentence)
            assert house.ask(sentence).result is False
        elif " is " in sentence and not sentence.startswith("where"):
            assert house.teach(sentence)["relations"] == 1
            found = house.ask(sentence).result
            assert found is True or found > 0.5, sentence
        else:
            with pytest.raises(BeliefError, match="states nothing: `semmap ask` answers it"):
                house.teach({"sentences": [sentence]})


def test_the_nearest_sentence_is_named_and_nothing_is_stored(house: semmap.Map) -> None:
    before = house.execute("SELECT count(*) FROM observation")
    for call in (house.ask, house.teach):
        with pytest.raises(BeliefError, match='the nearest is "the mug 1 is on the table"'):
            call("the mug 1 is on the tabel")
    both = ["the mug 1 is on the table", "the mug 2 is on the table"]
    with pytest.raises(BeliefError, match="the nearest is"):
        house.teach({"sentences": both})
    assert house.execute("SELECT count(*) FROM observation") == before
    for sentences in ("the mug 1 is on the table", [3], [" "]):
        with pytest.raises(ValueError, match="sentences"):
            house.teach({"sentences": sentences})


def test_a_class_and_an_entity_of_one_name_are_not_exchanged(house: semmap.Map) -> None:
    house.add_object("bowl", type="bowl", size=(0.1, 0.1, 0.1), on="table")
    house.teach("a bowl is a container")
    assert house["bowl"].type == "bowl"
    assert house.ask("a bowl is a container").result
    names = {part: [] for part in LISTS.values()} | {"types": ["bowl", "container"]}
    assert understand("a bowl is a container", names).stated.of_classes


def test_the_commands(house: semmap.Map) -> None:
    url = house.database.address
    done = command_line.semmap(url, "teach", "the mug 1 is on the table")
    assert done.stdout == "the mug 1 is on the table: 1 relations, 1 observations\n"
    asked = command_line.semmap(url, "ask", "where is the mug 1")
    assert asked.stdout.startswith("mug_1: table 1.00, ")
    told = json.loads(command_line.semmap(url, "ask", "a mug is a drinkware", "--json").stdout)
    assert told == {"sentence": "a mug is a drinkware", "text": "yes", "result": True}
