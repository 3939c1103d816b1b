"""What KnowledgeCore's documentation and tests show, on a lab."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import pytest
from sqlalchemy import Engine

import semmap
from semmap.database.engine import make_engine
from semmap.knowledge import KB, KbError, KnowledgeClient
from semmap.knowledge.patterns import parse_pattern
from semmap.query.map_handle import MapHandle


@pytest.fixture(scope="module")
def lab(module_engine: Engine) -> Iterator[Engine]:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        made = database.create_map("lab")
        made.add_room("kitchen", [(0, 0), (5, 0), (5, 5), (0, 5)], floor=0, ceiling=3)
        made.add_object("mug", type="mug", size=(0.1, 0.1, 0.1), pose=(1, 1, 0), label="Becher")
        yield database.engine


@pytest.fixture
def kb(lab: Engine) -> Iterator[KB]:
    with KB(MapHandle(lab, "lab")) as kb:
        kb.clear()
        yield kb
        kb.clear()


def unordered(rows: list[Any]) -> list[Any]:
    return sorted(rows, key=str)


def test_greetings(kb: KB) -> None:
    assert kb.hello() == f"semmap {semmap.__version__}"
    assert any(method.startswith("find(patterns") for method in kb.methods())
    kb.update(["s p o"], ["human1"])
    assert kb.stats()["models"] == ["default", "human1"]


@pytest.mark.parametrize(
    "wrong", ["toto", "toto titi", "toto titi tutu tata", "a b 'c", "a b 'c'", 'a b "c\nd"']
)
def test_a_malformed_statement_is_an_error(kb: KB, wrong: str) -> None:
    with pytest.raises(KbError, match=r"toto|a b"):
        kb.update([wrong])
    with pytest.raises(KbError):
        kb += [wrong]
    with pytest.raises(KbError, match="list"):
        kb.revise("a b c", {"method": "add"})  # type: ignore[arg-type]
    with pytest.raises(KbError, match="replace"):
        kb.revise(["a b c"], {"method": "replace"})
    with pytest.raises(KbError, match="forever"):
        kb.revise(["a b c"], {"method": "add", "forever": True})
    assert not kb.exist(["a b ?c"])


def test_revise_in_one_and_several_models(kb: KB) -> None:
    kb.revise(["toto likes tata"], policy={"method": "add"})
    kb.revise(["toto likes tata"], {"method": "update", "models": ["model1", "model2"]})
    kb.remove(["toto likes tata"], ["model1"])
    assert kb["toto likes tata"] is True
    assert kb["toto likes tata", ["model1"]] is False
    assert kb["toto likes tata", ["model2"]] is True
    assert kb.find(["?x likes tata"], models="all") == [{"x": "toto"}]
    kb.retract(["toto likes *"], ["all"])
    assert not kb.exist(["toto likes tata"], "all")
    kb.update(["nono isNice true"], ["model1"])
    assert kb.about("nono", ["model1"]) == [["nono", "isNice", True]]
    assert kb.about("nono", ["model2"]) == []


def test_existence(kb: KB) -> None:
    assert "alfred" not in kb
    assert "alfred likes icecream" not in kb
    kb += ["alfred rdf:type Wizard", "alfred likes icecream"]
    for pattern in ("alfred", "alfred likes *", "alfred likes ?smthg", "* likes *", "?t likes *"):
        assert pattern in kb, pattern
    for pattern in ("tartempion", "alfred likes", "* dislikes *", "alfred likes mygrandmother"):
        assert pattern not in kb, pattern
    kb -= ["alfred rdf:type Wizard", "alfred likes icecream"]
    assert "alfred" not in kb


def test_find(kb: KB) -> None:
    kb += ["james rdf:type Wizard", "laurel rdf:type Wizard", "hop rdf:type Jump"]
    kb += ["james desires hop", "laurel desires hop", "laurel desires oil", "nono desires oil"]
    both = [{"agent": "james", "action": "hop"}, {"agent": "laurel", "action": "hop"}]
    patterns, names = ["?agent desires ?action", "?action rdf:type Jump"], ["?agent", "?action"]
    assert unordered(kb.find(patterns, names)) == both
    assert unordered(kb.find(names, patterns)) == both, "the order of former versions"
    assert unordered(kb[tuple(patterns)]) == both
    assert unordered(kb[patterns]) == both
    assert kb["?agent desires oil", "?agent rdf:type *"] == [{"agent": "laurel"}]
    assert unordered(kb["* rdf:type Wizard"]) == [{"var1": "james"}, {"var1": "laurel"}]
    assert kb.find(["?x desires ?y"], ["?x"], ["human1"]) == []
    assert kb.find(["james desires hop"]) is True


def test_a_functional_property_has_one_value(kb: KB) -> None:
    kb += ["nono isNice true", "isNice rdf:type owl:FunctionalProperty"]
    assert kb["* isNice true"] == [{"var1": "nono"}]
    kb += ["nono isNice false"]
    assert kb["* isNice true"] == []
    assert kb["* isNice false"] == [{"var1": "nono"}]


def test_lookup(kb: KB) -> None:
    assert kb.lookup("alfred") == []
    kb += ['alfred rdfs:label "alfred"']
    assert kb.lookup("alfred") == [["alfred", "undecided"]]
    kb += ["alfred rdf:type Wizard", "alfred likes icecream", "alfred age 18"]
    assert kb.lookup("alfred") == [["alfred", "instance"]]
    assert kb.lookup("Wizard") == [["Wizard", "class"]]
    assert kb.lookup("likes") == [["likes", "object_property"]]
    assert kb.lookup("age") == [["age", "datatype_property"]]
    assert kb.lookup("rdf:type") == [["rdf:type", "object_property"]]
    kb += ['nono rdfs:label "alfred"', 'sentence rdfs:label "alfred is a charming person"']
    found = kb.lookup("alfred")
    assert unordered(found) == [
        ["alfred", "instance"],
        ["nono", "undecided"],
        ["sentence", "undecided"],
    ]
    assert found[-1] == ["sentence", "undecided"]
    kb += ['toulouse rdfs:label "ville rose"']
    assert kb["ville rose"] == ["toulouse"]
    assert kb.lookup("mug") == [["mug", "instance"], ["Mug", "class"]], "its label is mug, too"
    assert kb["Becher"] == ["mug"]


LITERALS = {
    '"test"': "test",
    '"""test"""': "test",
    '"""toto\ntata"""': "toto\ntata",
    '"test"@fr': "test",
    '"foo"^^<http://example.org/my/datatype>': "foo",
    '"""10"""^^xsd:decimal': 10,
    "-5": -5,
    "+1": 1,
    '"10"^^<http://www.w3.org/2001/XMLSchema#integer>': 10,
    "-12.5e10": -12.5e10,
    "1.5": 1.5,
    "true": True,
    '"false"^^xsd:boolean': False,
}


@pytest.mark.parametrize("literal", LITERALS)
def test_literals(kb: KB, literal: str) -> None:
    kb += [f"robert says {literal}"]
    (row,) = kb["* says ?what"]
    assert str(row["what"]) == str(LITERALS[literal]) or row["what"] == LITERALS[literal]
    assert kb.lookup("says") == [["says", "datatype_property"]]
    kb -= [f"robert says {literal}"]
    assert kb["* says *"] == []


def test_labels_details_and_classes(kb: KB) -> None:
    assert kb.label("johnny") == "johnny"
    kb += ["johnny rdf:type Wizard", 'johnny rdfs:label "A que Johnny"']
    assert kb.label("johnny") == kb.label("johnny", "fr") == "A que Johnny"
    kb += ['johnny rdfs:label "Jojo"@fr', "Wizard rdfs:subClassOf Sage", "johnny owl:sameAs john"]
    assert (kb.label("johnny", "fr"), kb.label("johnny", "en")) == ("Jojo", "A que Johnny")
    assert kb.classesof("johnny") == ["Wizard"]
    assert kb.classesof("johnny", direct=True) == ["Wizard"]
    assert kb.classesof("nobody") == []
    assert kb.details("johnny") == {
        "name": "A que Johnny",
        "label": {"default": "A que Johnny", "fr": "Jojo"},
        "id": "johnny",
        "type": "instance",
        "sameAs": ["john"],
        "attributes": [{"name": "Classes", "id": "classes", "values": ["Wizard"]}],
    }
    details = kb.details("Wizard")
    assert details["type"] == "class"
    assert {a["id"]: a["values"] for a in details["attributes"]} == {
        "superClasses": ["Sage"],
        "subClasses": [],
        "instances": ["johnny"],
    }
    assert "Cup" in kb.classesof("mug") or "Mug" in kb.classesof("mug")
    assert kb.classesof("mug", direct=True) == ["Mug"]
    assert ["mug"] in [a["values"] for a in kb.details("Mug")["attributes"]]
    assert unordered(kb.about("Wizard")) == [
        ["Wizard", "rdfs:subClassOf", "Sage"],
        ["johnny", "rdf:type", "Wizard"],
    ]


def test_sparql(kb: KB) -> None:
    kb += ["myself age 40"]
    answer = kb.sparql("SELECT ?age WHERE { :myself oro:age ?age . }")
    assert answer["head"] == {"vars": ["age"]}
    assert answer["results"]["bindings"] == [
        {
            "age": {
                "type": "literal",
                "value": "40",
                "datatype": "http://www.w3.org/2001/XMLSchema#integer",
            }
        }
    ]
    kb.update(["myself age 41"], ["human1"])
    (row,) = kb.sparql("SELECT * { ?who oro:age ?age }", ["human1"])["results"]["bindings"]
    assert row["age"]["value"] == "41"
    with pytest.raises(KbError, match="GRAPH"):
        kb.sparql("ASK {}", ["human1", "human2"])
    with pytest.raises(KbError, match=r"[Ss]yntax|expected"):
        kb.sparql("SELECT WHERE")


def test_events(kb: KB) -> None:
    events: SimpleQueue[Any] = SimpleQueue()
    ceased: SimpleQueue[Any] = SimpleQueue()
    kb += ["alfred isNear garage"]
    number = kb.subscribe(["?o isNear room"], events.put, gone=ceased.put)
    assert number.startswith("evt_")
    assert kb.subscribe(["?o isNear room"], events.put) == number
    assert kb.subscribe(["?o isNear garage"]) != number
    kb += ["alfred isNear room"]
    assert events.get(timeout=5) == [{"o": "alfred"}]
    kb += ["alfred isNear room", "alfred leaves room", "alfred isNear garage"]
    kb += ["batman isNear garage"]
    polled, bindings = kb.events.get(timeout=5)
    assert (polled, bindings) == (kb.subscribe("?o isNear garage"), [{"o": "batman"}])
    kb -= ["alfred isNear room"]
    assert ceased.get(timeout=5) == [{"o": "alfred"}]
    with pytest.raises(Empty):
        events.get_nowait()


def test_events_of_ground_and_joined_patterns_once(kb: KB) -> None:
    ground, joined = (
        kb.subscribe("human1 looksAt book", one_shot=True),
        kb.subscribe(["?a desires ?act", "?act rdf:type Jump"]),
    )
    kb += ["alfred desires ragnagna", "ragnagna rdf:type Zorro"]
    kb += ["ragnagna rdf:type Jump"]
    assert kb.events.get(timeout=5) == (joined, [{"a": "alfred", "act": "ragnagna"}])
    kb.update(["human1 looksAt book"], lifespan=0.2)
    assert kb.events.get(timeout=5) == (ground, [{}])
    time.sleep(0.5)
    assert "human1 looksAt book" not in kb
    kb += ["human1 looksAt book"]
    with pytest.raises(Empty):
        kb.events.get(timeout=0.5)


def test_statements_about_what_the_map_does_not_have(kb: KB) -> None:
    stated = ["alfred isIn garage", "alfred rdf:type Robot", 'alfred name "Alf"', "mug isIn sink"]
    kb += [*stated, "alfred isOn sofa", "mug rel:beside alfred"]
    assert kb["* isIn garage"] == [{"var1": "alfred"}]
    assert unordered(kb["mug isIn *"]) == [{"var1": "kitchen"}, {"var1": "sink"}]
    assert unordered(kb["?who isOn *", "?who rdf:type Robot"]) == [{"who": "alfred"}]
    assert kb["* rel:beside alfred"] == [{"var1": "mug"}]
    assert unordered(kb.about("alfred")) == [
        ["alfred", "isIn", "garage"],
        ["alfred", "isOn", "sofa"],
        ["alfred", "name", "Alf"],
        ["alfred", "rdf:type", "Robot"],
        ["mug", "rel:beside", "alfred"],
    ]
    assert "alfred" not in {row["x"] for row in kb["?x semmap:kind ?kind"]}, "it is not an entity"
    kb -= stated
    assert kb["alfred ?is ?what"] == [{"is": "isOn", "what": "sofa"}]
    assert kb["mug isIn *"] == [{"var1": "kitchen"}]
    kb -= ["alfred isOn *", "mug rel:beside alfred"]
    assert "alfred" not in kb


def test_statements_about_what_the_map_gets_later(module_engine: Engine) -> None:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database, KB(database.create_map("later")) as kb:
        kb += ["bob isIn garage", "bob likes tea"]
        made = database.map("later")
        made.add_room("garage", [(0, 0), (5, 0), (5, 5), (0, 5)], floor=0, ceiling=3)
        made.add_agent("bob", type="robot", size=(0.5, 0.5, 1), pose=(1, 1, 0))
        assert kb["bob isIn *", "bob likes ?what"] == [{"what": "tea"}]
        assert kb["?who isIn garage"] == [{"who": "bob"}]
        kb.clear()
        assert kb["?who isIn garage"] == [{"who": "bob"}], "as the map has it"


def test_all_statements_are_those_without_the_tbox(engine: Engine) -> None:
    url = engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database, KB(database.create_map("empty")) as kb:
        assert kb["* * *"] == kb["* rdf:type *"] == kb["?a ?b ?c", "?a ?d ?e"] == []
        assert "* * *" not in kb
        kb += ["alfred rdf:type Robot", "Robot rdfs:subClassOf Toy", "alfred isIn garage"]
        every = [
            {"var1": "Robot", "var2": "rdfs:subClassOf", "var3": "Toy"},
            {"var1": "alfred", "var2": "isIn", "var3": "garage"},
            {"var1": "alfred", "var2": "rdf:type", "var3": "Robot"},
        ]
        assert unordered(kb["* * *"]) == every
        assert kb["* rdf:type *"] == [{"var1": "alfred", "var2": "Robot"}]
        assert kb["?who rdf:type ?kind", "?kind rdfs:subClassOf Agent"] == [
            {"who": "alfred", "kind": "Robot"}
        ]
        assert {"x": "Mug"} in kb["?x rdf:type owl:Class"], "a class is asked for"
        everything = kb.sparql("SELECT * { ?s ?p ?o }")["results"]["bindings"]
        assert len(everything) > 1000, "SPARQL has the T-Box"


@pytest.mark.parametrize("name", ["human1", "cup%201", "_x-1", "tasse%CE%B2", "a.b"])
@pytest.mark.parametrize("statement", ["{} likes ?x_1", "?a {} b", "?a a {}", "{} rdfs:label 5"])
def test_names_are_as_their_iris_are_parsed(name: str, statement: str) -> None:
    spaces = {"{}": "urn:semmap:map:lab#", "?a": "http://kb.openrobots.org#"}
    written = f"<{spaces[statement.split()[0]]}{name}>"
    parsed = parse_pattern(statement.format(name), "lab")
    assert parsed == parse_pattern(statement.format(written), "lab")
    assert [*map(type, parsed)] == [*map(type, parse_pattern(statement.format(written), "lab"))]


def test_letters_of_names(kb: KB) -> None:
    kb += ["José likes café", "tasse%20β likes x100%25", "x%E2%82%AC likes tea"]
    assert unordered(kb["?who likes ?what"]) == [
        {"who": "José", "what": "café"},
        {"who": "tasse%20β", "what": "x100%25"},
        {"who": "x%E2%82%AC", "what": "tea"},
    ]
    for row in kb["?who likes ?what"]:
        assert f"{row['who']} likes {row['what']}" in kb


def test_what_ends_and_begins_at_once_is_an_event(kb: KB) -> None:
    number = kb.subscribe("?o isNear room")
    for _ in range(20):
        kb += ["alfred isNear room"]
        kb -= ["alfred isNear room"]
    for _ in range(20):
        assert kb.events.get(timeout=5) == (number, [{"o": "alfred"}])
    assert kb.events.empty()


def test_a_role_that_only_reads_gets_an_error(lab: Engine) -> None:
    reader = make_engine(lab.url.update_query_dict({"options": "-crole=semmap_reader"}))
    with KB(MapHandle(reader, "lab")) as kb:
        for change in (lambda: kb.update(["a b c"]), kb.clear):
            with pytest.raises(KbError, match="permission denied"):
                change()
    reader.dispose()


def test_a_subscription_for_once_is_made_again(kb: KB) -> None:
    for name in ("joe", "jim"):
        number = kb.subscribe("?who rdf:type Wizard", one_shot=True, models=["default", "human1"])
        kb.update([f"{name} rdf:type Wizard"], ["default", "human1"])
        assert kb.events.get(timeout=5) == (number, [{"who": name}])
        kb += [f"{name}2 rdf:type Wizard"]
        with pytest.raises(Empty):
            kb.events.get(timeout=0.5)


def test_a_change_of_several_models_is_made_as_a_whole(kb: KB) -> None:
    with pytest.raises(KbError, match="lifespan"):  # of a fact in a table of the map
        kb.update(["mug heldBy kitchen"], ["human1", "default"], lifespan=10)
    assert kb.find(["mug heldBy ?where"], models=["human1"]) == []
    kb.update(["mug heldBy kitchen"], ["human1"], lifespan=10)
    assert kb.find(["mug heldBy ?where"], models=["human1"]) == [{"where": "kitchen"}]


def test_clients_that_share_a_connection_have_subscriptions_of_their_own(lab: Engine) -> None:
    with KnowledgeClient(MapHandle(lab, "lab")) as client, KB(client) as one, KB(client) as other:
        number = one.subscribe("?o isNear room")
        assert other.subscribe("?o isNear room") == number
        other.close()
        one.update(["alfred isNear room"])
        assert one.events.get(timeout=5) == (number, [{"o": "alfred"}])
        assert other.events.empty()
        one.clear()


def test_a_file_is_loaded_into_a_model(kb: KB, tmp_path: Path) -> None:
    path = tmp_path / "wizards.ttl"
    path.write_text(
        "@prefix : <http://kb.openrobots.org#> . :Wizard a <http://www.w3.org/2002/07/owl#Class> ."
    )
    kb.load(path, ["human1"])
    assert kb.lookup("Wizard", ["human1"]) == [["Wizard", "class"]]
    assert kb.lookup("Wizard") == []
    path.write_text("this is not Turtle")
    with pytest.raises(KbError, match="wizards"):
        kb.load(path)
