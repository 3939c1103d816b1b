"""Teachings into the map, what they change, and what is refused with its reason."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from semmap import Map
from semmap.belief.error import BeliefError
from semmap.belief.grammar import spoken, write_grammar
from semmap.belief.store.teaching import vocabulary
from semmap.belief.teaching import KnownAction, action_chain, parse_teaching, read_teaching
from semmap.ingest.world import WorldError
from tests.seen import seen_by

THESIS: dict[str, Any] = {
    "knowledge": [
        {"name": "Soda Can", "properties": {"mobility": 2}},
        {"name": "cereal box", "properties": "breakfast"},
        {"name": "movable object"},
    ],
    "directedRelations": [
        {"master": "soda can", "action": "isA", "slave": "movable object"},
        {"master": "cereal box", "action": "isA", "slave": "movable object"},
        {"master": "soda can", "action": "foundIn", "slave": "refrigerator"},
        {"master": "mug", "action": "belongs to", "slave": "robot"},
    ],
    "actions": [
        {"action": "bring", "instance1": "object_held", "instance2": "object_delivered"},
        {"action": "grasp", "instance1": "object_found", "instance2": "object_held"},
    ],
    "objs": [
        {
            "name": "coke2",
            "clas": "SodaCan",
            "base_area": "0.0035",
            "volume": "0.0004",
            "occurrences": [
                {"place": "table", "x": 0.2, "y": -0.1, "time": 1.6e9},
                {"place": "kitchen", "time": "2026-05-01T12:00:00Z", "seen": False},
            ],
        }
    ],
}
STATES = ("object_found", "object_held", "object_delivered")


def lesson(**more: Any) -> dict[str, Any]:
    taught = {key: [*value] for key, value in THESIS.items()}
    taught["knowledge"] += [{"name": name} for name in STATES]
    for key, value in more.items():
        taught[key] = [*taught.get(key, []), *value]
    return taught


def test_each_field_of_the_thesis_has_a_home(flat: Map) -> None:
    counts = flat.teach(lesson())
    assert counts == {"types": 6, "relations": 4, "actions": 2, "objects": 1, "observations": 2}
    coke = flat["coke2"]
    assert coke.is_a("movable_object")
    assert coke.properties == {"base_area": 0.0035, "volume": 0.0004}
    assert flat.execute("SELECT property_of(%s, 'mobility')", coke.id) == [(2.0,)]
    assert flat.execute("SELECT properties FROM semantic_type WHERE name = 'cereal_box'") == [
        ({"text": "breakfast"},)
    ]
    assert flat.execute(
        "SELECT p.name, o.seen, o.inside, o.position, extract(epoch FROM o.at)::bigint "
        "FROM observation o JOIN entity p ON p.id = o.place_id ORDER BY o.id"
    ) == [
        ("table", True, False, [0.2, -0.1, 0.0], 1600000000),
        ("kitchen", False, True, None, 1777636800),
    ]
    assert flat.describe("mug")["links"] == ["belongs to robot"]
    assert [action.name for action in flat.how_to("object delivered")] == ["grasp", "bring"]
    assert flat.execute("SELECT count(*) > 5 FROM belief WHERE entity_id = %s", coke.id) == [
        (True,)
    ]
    again = flat.teach(lesson())
    assert again["types"] == 0


def test_teaching_where_things_are_found_changes_the_prior(flat: Map) -> None:
    before = flat.where("coke")
    flat.teach(
        {"relations": [{"subject": "umbrella", "relation": "found_in", "object": "kitchen"}]}
    )
    after = flat.where("coke")
    inside = {"kitchen", "table", "counter", "fridge"}
    assert {place for place in after if after[place] > before[place] + 1e-9} == inside
    ratio = before["table"] / before["bench"]
    assert after["table"] == pytest.approx(4 * ratio * after["bench"])
    flat.teach({"relations": [{"subject": "coke", "relation": "foundIn", "object": "bench"}]})
    share = after["bench"] / 0.9
    assert flat.where("coke")["bench"] == pytest.approx(0.9 * 4 * share / (1 + 3 * share))


def test_a_relation_of_place_is_a_sighting(flat: Map) -> None:
    counts = flat.teach({"relations": [{"subject": "coke", "relation": "on", "object": "counter"}]})
    assert counts["observations"] == 1
    assert next(iter(flat.where("coke"))) == "counter"


def taught_object(name: str, *more: dict[str, Any]) -> dict[str, Any]:
    return {"objects": [{"name": name} | each for each in more]}


def seen_at(name: str, **occurrence: Any) -> dict[str, Any]:
    return taught_object(name, {"occurrences": [occurrence]})


@pytest.mark.parametrize(
    ("taught", "message"),
    [
        ({"relations": [("cereal", "in", "mug")]}, "cereal cannot be on or in mug: it has no room"),
        ({"relations": [("movable object", "isA", "soda can")]}, "leave out one"),
        ({"relations": [("mug", "isA", "kitchen")]}, "mug isA kitchen: contradicts the map"),
        ({"relations": [("mug", "isA", "table")]}, "it is a mug, which is not a kind of"),
        ({"relations": [("soda can", "isA", "kitchen")]}, "coke2 isA soda_can: contradicts"),
        ({"relations": [("drinkware", "isA", "mug")]}, "mug is a kind of drinkware"),
        ({"relations": [("mug", "likes", "unicorn")]}, "neither the map nor the teaching has uni"),
        ({"relations": [("mug", "isA", "mug")]}, "a relation is between two names"),
        ({"objects": [{"name": "kitchen", "volume": 1}]}, "kitchen is a room of the map"),
        ({"objects": [{"name": "mug", "base_area": 0.02}]}, "mug: base_area is 0.02 m2, but its"),
        ({"objects": [{"name": "mug", "volume": 0}]}, r"mug\): volume is 0: give a number above 0"),
        ({"objects": [{"name": "mug", "mobility": -1}]}, "mobility is -1"),
        (taught_object("a", {"class": "mug"}, {"class": "pan"}), "a mug and a pan"),
        (seen_at("mug", place="moon"), "no entity moon"),
        (seen_at("mug", place="table", x="far"), "x is 'far'"),
        (seen_at("mug", place="table", time=4e9), "future"),
        ({"actions": [{"action": "fly", "cause": "wings", "effect": "table"}]}, "has wings"),
        ({"model": {"there": 1.05}}, "belief model rates are between 0 and 1"),
        ({"model": {"seconds": "soon"}}, "seconds is 'soon': give a number"),
        ({"model": {"speed": 1}}, "speed is not one of there"),
        ({"observation": []}, "observation is not one of sentences"),
        ({}, "teaches nothing"),
        ([], r"is \[\]: give a text, a path or a mapping"),
    ],
)
def test_contradictions_are_refused_and_nothing_is_stored(
    flat: Map, taught: Any, message: str
) -> None:
    if taught and "relations" in taught:
        keys = ("subject", "relation", "object")
        relations = [dict(zip(keys, row, strict=True)) for row in taught["relations"]]
        taught = (
            lesson(directedRelations=relations)
            if "can" in str(relations)
            else {"relations": relations}
        )
    before = flat.execute(STATE)
    with pytest.raises((BeliefError, LookupError, ValueError), match=message):
        flat.teach(taught)
    assert flat.execute(STATE) == before


STATE = (
    "SELECT (SELECT count(*) FROM semantic_type), (SELECT count(*) FROM type_parent), "
    "(SELECT count(*) FROM entity), (SELECT count(*) FROM observation), "
    "(SELECT md5(string_agg(properties::text || type, '' ORDER BY id)) FROM entity), "
    "(SELECT count(*) FROM taught_relation), (SELECT count(*) FROM taught_action), "
    "(SELECT count(*) FROM belief_model)"
)


def test_a_robot_teaches_objects_and_what_it_saw_but_no_classes(flat: Map) -> None:
    flat.execute("SET LOCAL ROLE semmap_robot")
    apple = {"name": "apple1", "class": "apple", "occurrences": [{"place": "table"}]}
    relation = {"subject": "apple1", "relation": "found_in", "object": "fridge"}
    assert flat.teach({"objects": [apple], "relations": [relation]})["observations"] == 1
    assert flat.where("apple1")["table"] > 0.2
    with pytest.raises(BeliefError, match=r"this login may not teach that .*classes are taught by"):
        flat.teach({"knowledge": [{"name": "gadget"}]})
    with pytest.raises(BeliefError, match="may not teach that"):
        flat.teach({"model": {"there": 0.7}})
    for told in (
        {"knowledge": [{"name": "hall", "properties": {"colour": "red"}}]},
        {"relations": [{"subject": "hall", "relation": "isA", "object": "kitchen"}]},
    ):
        with pytest.raises(BeliefError, match="rights of the role"):
            flat.teach(told)


def test_cycles_within_a_teaching_are_refused() -> None:
    circle = [("a", "isA", "b"), ("b", "is_a", "c"), ("c", "IsA", "a")]
    rows = [dict(zip(("subject", "relation", "object"), row, strict=True)) for row in circle]
    with pytest.raises(BeliefError, match=r"isA .* isA .*leave out one"):
        parse_teaching({"relations": rows})


MAP_XML = """<?xml version="1.0"?>
<map>
  <!-- base information -->
  <knowledge><knowledgeInstance name="sodacan" properties="drink"/></knowledge>
  <relations>
    <drelation><master>sodacan</master><action>isA</action><slave>object</slave></drelation>
  </relations>
  <action name="bring" instance1="sodacan" instance2="object"/>
  <objects>
    <object name="coke3" clas="sodacan" baseArea="0.66" volume="6.60">
      <occurrence place="table" x="0.1" y="0.2" time="1400000000"/>
    </object>
  </objects>
</map>
"""


def test_the_map_file_of_the_thesis_is_read(tmp_path: Path, flat: Map) -> None:
    path = tmp_path / "Map.xml"
    path.write_text(MAP_XML)
    teaching = read_teaching(path)
    (coke,) = teaching.objects
    assert coke.properties == pytest.approx({"base_area": 6.6e-5, "volume": 6.6e-6})
    assert coke.occurrences[0]["position"] == [0.1, 0.2, 0.0]
    assert teaching.actions == (KnownAction("bring", "sodacan", "object"),)
    assert str(teaching.relations[0]) == "sodacan isA object"
    assert flat.teach(path)["observations"] == 1
    for broken, message in (
        (MAP_XML.replace("<action ", "<acton "), "<acton> is not a part of a teaching"),
        (MAP_XML.replace("volume=", "colour="), "has colour, which is not one of name"),
        (MAP_XML.replace("0.66", "small"), "base_area of coke3 is 'small'"),
        (MAP_XML.replace("</map>", ""), "not well-formed XML"),
    ):
        path.write_text(broken)
        with pytest.raises((BeliefError, WorldError), match=message):
            read_teaching(path)
    with pytest.raises(BeliefError, match="cannot be read"):
        read_teaching(tmp_path / "absent.json")
    (tmp_path / "a.json").write_text('{"knowledge": [')
    with pytest.raises(BeliefError, match="is not valid JSON"):
        read_teaching(tmp_path / "a.json")
    (tmp_path / "b.json").write_text(json.dumps(THESIS))
    assert len(read_teaching(tmp_path / "b.json").relations) == 4


def test_the_shortest_chain_of_actions_is_found() -> None:
    actions = [
        KnownAction("walk", "awake", "at_shop"),
        KnownAction("buy", "at_shop", "food"),
        KnownAction("grow", "seed", "food"),
        KnownAction("dig", "garden", "seed"),
        KnownAction("eat", "food", "fed"),
        KnownAction("spin", "dizzy", "round"),
        KnownAction("turn", "round", "dizzy"),
    ]

    def is_a(name: str, other: str) -> bool:
        return name == other or (name, other) == ("pear", "food")

    def chain(goal: str, *given: str) -> list[str]:
        return [action.name for action in action_chain(actions, goal, is_a, given)]

    assert chain("fed") == ["walk", "buy", "eat"]
    assert chain("fed", "seed") == ["grow", "eat"]
    assert chain("fed", "pear") == ["eat"]
    assert chain("fed", "fed") == []
    with pytest.raises(BeliefError, match="needs itself"):
        chain("dizzy")
    with pytest.raises(BeliefError, match="no action brings about foot; did you mean food"):
        chain("foot")


def accepts(gbnf: str, sentence: str) -> bool:
    """Whether a grammar without recursion accepts a sentence: each rule becomes a pattern."""
    rules = dict(line.split(" ::= ", 1) for line in gbnf.splitlines())

    def pattern(rule: str) -> str:
        parts = re.findall(r'"(?:[^"\\]|\\.)*"|\(|\)\??|\||[a-z]+', rules[rule])
        return "".join(
            re.escape(p[1:-1].replace('\\"', '"'))
            if p.startswith('"')
            else p
            if p[0] in "()|"
            else f"(?:{pattern(p)})"
            for p in parts
        )

    return re.fullmatch(pattern("root"), sentence) is not None


def test_a_grammar_accepts_sentences_about_what_the_map_knows(flat: Map) -> None:
    names = vocabulary(seen_by(flat.connection))
    gbnf = write_grammar(names)
    for sentence in (
        "where is the mug",
        "find coke",
        "bring the mug to the kitchen",
        "the cereal is in the kitchen",
        "the coke is a mug",
        "a pear is a fruit",
    ):
        assert accepts(gbnf, sentence), sentence
    for sentence in ("where is the unicorn", "bring the kitchen to the mug", "where is"):
        assert not accepts(gbnf, sentence), sentence
    jsgf = write_grammar(names, "jsgf")
    assert jsgf.startswith("#JSGF V1.0;\ngrammar semmap;\npublic <command> = ")
    assert "<thing> = bench | cereal | coke" in jsgf
    assert spoken("L1_master_suite") == "l 1 master suite"
    with pytest.raises(BeliefError, match="not one of gbnf, jsgf"):
        write_grammar(names, "bnf")
    with pytest.raises(BeliefError, match="no names"):
        write_grammar({})
