"""What users of KnowledgeCore write, on a lab with people; and a cup of the small house."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue

import pytest
from sqlalchemy import Engine, text

import semmap
from semmap import Database
from semmap.ingest.importer import import_file
from semmap.knowledge import KnowledgeClient
from semmap.knowledge.patterns import parse_pattern
from semmap.knowledge.standing.subscriptions import Event, Subscriptions
from semmap.query.map_handle import MapHandle

ROOM = [(0, 0), (5, 0), (5, 5), (0, 5)]


@pytest.fixture(scope="module")
def lab(module_engine: Engine) -> Iterator[Database]:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        lab = database.create_map("lab")
        lab.add_room("kitchen", ROOM, floor=0, ceiling=3)
        lab.add_object("table", type="table", size=(1, 1, 0.7), pose=(2, 2, 0))
        lab.add_object("book 1", type="book", size=(0.2, 0.3, 0.05), on="table")
        yield database


@pytest.fixture
def kb(lab: Database) -> Iterator[KnowledgeClient]:
    """A client of the lab, whose statements are removed at the end."""
    with KnowledgeClient(MapHandle(lab.engine, "lab")) as client:
        yield client
    with lab.engine.begin() as connection:
        connection.execute(text("DELETE FROM statement"))


def next_event(kb: KnowledgeClient, timeout: float = 5) -> Event:
    return next(kb.events(timeout))


def silent(kb: KnowledgeClient, seconds: float = 0.5) -> bool:
    return not list(kb.events(seconds))


def test_the_example_of_knowledge_core(kb: KnowledgeClient) -> None:
    kb += "ari rdf:type Robot"
    kb += ["antonio looksAt ari", "ari isIn kitchen"]
    events: SimpleQueue[Event] = SimpleQueue()
    kb.subscribe(
        ["?robot isIn ?place", "?place belongsTo antonio", "?robot rdf:type Robot"], events.put
    )
    kb += "kitchen belongsTo antonio"
    assert events.get(timeout=5).bindings == {"robot": "ari", "place": "kitchen"}
    assert kb["* rdf:type Robot"] == {"ari"}
    kb -= "antonio looksAt ari"
    assert not kb.has("antonio looksAt ari")
    assert kb.details("ari")["attributes"][0]["values"] == ["Robot"]
    kb -= ["ari isIn kitchen", "kitchen belongsTo antonio"]
    assert events.get(timeout=5).what == "disappeared"


def test_statements_are_added_found_and_removed(kb: KnowledgeClient) -> None:
    new = ["alfred rdf:type Wizard", "alfred likes icecream", 'alfred rdfs:label "Al"@en']
    assert kb.revise(new, "add").added == 3
    assert kb.revise(new, "add").added == 0
    kb += ["nono likes icecream", "nono age 18"]
    assert kb["?who likes icecream", "?who age ?age"] == [{"who": "nono", "age": 18}]
    assert kb.find("?who", "?who likes *") == {"alfred", "nono"}
    assert "* likes *" in kb
    assert "alfred likes icecream" in kb
    assert "alfred dislikes *" not in kb
    assert ("alfred", "likes", "icecream") in kb.about("alfred")
    assert ("alfred", "likes", "icecream") in kb.about("icecream")
    assert kb.about("Wizard") == [("alfred", "rdf:type", "Wizard")]
    assert kb.details("alfred") == {
        "name": "Al",
        "id": "alfred",
        "type": "instance",
        "attributes": [{"name": "Classes", "id": "classes", "values": ["Wizard"]}],
    }
    assert kb.details("Wizard")["type"] == "class"
    assert kb.details("nobody")["type"] == "undecided"
    assert kb.retract("alfred likes ?what").removed == 1
    assert kb.retract("* likes *").removed == 1
    assert not kb.has("* likes *")


def test_entities_of_the_map_are_individuals(kb: KnowledgeClient) -> None:
    assert kb.find("x", "?x isOn table") == {"book%201"}
    kb += "human1 looksAt book%201"
    found = kb.find(["who", "what"], ["?who looksAt ?what", "?what rdf:type Book"])
    assert found == [{"who": "human1", "what": "book%201"}]
    assert kb.details("Book")["type"] == "class"
    assert kb.find("x", "?x semmap:heldBy+ kitchen") >= {"table", "book%201"}


def test_a_functional_property_is_replaced(kb: KnowledgeClient) -> None:
    kb += ["nono isNice true", "nono likes tea", "isNice rdf:type owl:FunctionalProperty"]
    changes = kb.update(["nono isNice false", "nono likes milk"])
    assert (changes.added, changes.removed) == (2, 1)
    assert kb["nono isNice ?x"] == {False}
    assert kb["nono likes ?x"] == {"tea", "milk"}


@pytest.mark.parametrize(
    "literal", ['"te\\"st } x"', '"""a\nb"""', '"t"@fr', "-5", "1.3e2", "true"]
)
def test_literals_come_back_as_they_are(kb: KnowledgeClient, literal: str) -> None:
    kb.add(f"robert says {literal}")
    assert kb.has(f"robert says {literal}")
    assert kb.retract(f"robert says {literal}").removed == 1
    assert not kb.has("robert says *")


def test_a_statement_ends_with_its_lifespan_and_subscribers_see_it(kb: KnowledgeClient) -> None:
    number = kb.subscribe("human1 looksAt ?what")
    begin = time.monotonic()
    kb.revise("human1 looksAt cup", lifespan=0.6)
    assert next_event(kb) == Event(number, "appeared", {"what": "cup"})
    assert next_event(kb) == Event(number, "disappeared", {"what": "cup"})
    assert 0.5 < time.monotonic() - begin < 5
    assert not kb.has("human1 looksAt cup")
    assert kb.add("human1 looksAt cup").added == 1, "an ended statement must not hide a new one"
    assert kb.has("human1 looksAt cup")


def test_a_lifespan_ends_no_permanent_statement_and_only_puts_off_an_end(
    kb: KnowledgeClient,
) -> None:
    kb += "sky hasColor blue"
    assert kb.add("sky hasColor blue", lifespan=0.2).added == 0
    kb.add("sky has clouds", lifespan=0.2)
    kb.add("sky has clouds", lifespan=60)
    kb.add("sky has clouds", lifespan=0.1)
    kb.add("sky has rain", lifespan=0.2)
    kb.add("sky has rain")
    time.sleep(0.4)
    found = kb.find(["p", "o"], "sky ?p ?o")
    assert sorted(row["o"] for row in found) == ["blue", "clouds", "rain"]
    with pytest.raises(ValueError, match="cannot end by itself"):
        kb.add("table rdf:type Table", lifespan=1)
    assert kb.has("table rdf:type Table")


def test_ground_patterns_fire(kb: KnowledgeClient) -> None:
    number = kb.subscribe(["human1 looksAt book", "human1 isHappy true"])
    kb += "human1 looksAt book"
    assert silent(kb)
    kb += "human1 isHappy true"
    assert next_event(kb) == Event(number, "appeared", {})
    kb -= "human1 looksAt *"
    assert next_event(kb) == Event(number, "disappeared", {})


def test_what_is_true_already_is_no_event(kb: KnowledgeClient) -> None:
    kb += "alfred likes jazz"
    kb.subscribe("?who likes jazz")
    kb += "alfred likes jazz"
    assert silent(kb)
    kb += "batman likes jazz"
    assert next_event(kb).bindings == {"who": "batman"}


def test_a_one_shot_is_consumed_by_its_own_event_only(kb: KnowledgeClient) -> None:
    once = kb.subscribe("?x likes tea", one_shot=True)
    always = kb.subscribe("?x likes milk")
    kb += "ann likes milk"
    assert next_event(kb).subscription == always
    kb += ["ann likes tea", "bob likes tea"]
    assert next_event(kb) == Event(once, "appeared", {"x": "ann"})
    kb += "carl likes tea"
    kb -= "ann likes tea"
    assert silent(kb)
    kb.unsubscribe(always)
    kb -= "ann likes milk"
    assert silent(kb)


def test_models_of_agents_are_separate(kb: KnowledgeClient) -> None:
    number = kb.subscribe("cup isIn ?where", model="human1")
    kb.add("cup isIn cupboard", model="human1")
    kb.add(["cup isIn sink", "cup rdf:type Cup"], model="human2")
    assert next_event(kb) == Event(number, "appeared", {"where": "cupboard"})
    assert kb.find("w", "cup isIn ?w", model="human1") == {"cupboard"}
    assert kb.find("w", ["cup isIn ?w", "cup rdf:type Cup"], model="human2") == {"sink"}
    assert not kb.has("cup isIn *")
    kb.add("table rdf:type Altar", model="human1", lifespan=60)
    assert kb.about("table", model="human1") == [("table", "rdf:type", "Altar")]
    assert kb.retract("* * *", model="human1").removed == 2
    assert not kb.has("* * *", model="human1")
    assert kb.has("* * *", model="human2")


WRONG = (
    ("toto", "subject, a property and an object"),
    ("", "subject, a property and an object"),
    ("a b c . d e f", "more than one statement"),
    ("a b 1, 2", "more than one statement"),
    ("a b c } ; CLEAR ALL #", "quotes"),
    ("a b ?x FILTER(?x > 3)", "more than one statement"),
    ("a b c d", "quotes"),
    ('a b "c\0d"', "NUL"),
    ("a b ?x", "only what is retracted"),
    ("a b *", "only what is retracted"),
    ("a b+ c", "only what is retracted"),
    ("table semmap:x 3.0", "follows from"),
    ("stranger isOn table", "not an entity"),
)


@pytest.mark.parametrize(("statement", "reason"), WRONG)
def test_a_wrong_statement_changes_nothing(
    kb: KnowledgeClient, statement: str, reason: str
) -> None:
    with pytest.raises(ValueError, match=reason):
        kb.add(["good is here", statement])
    assert not kb.has("good is here")


def test_other_mistakes_are_errors(kb: KnowledgeClient) -> None:
    for call, reason in (
        (lambda: kb.revise("a b c", "replace"), "add, retract, update"),
        (lambda: kb.add("a b c", lifespan=-1), "lifespan"),
        (lambda: kb.add("a b c", lifespan=float("nan")), "lifespan"),
        (lambda: kb.add([]), "no statement"),
        (lambda: kb.find("y", "?x b c"), "the variable"),
        (lambda: kb.add("a b c", model=""), "a model has a name"),
        (lambda: kb.retract("table name ?x"), "follows from"),
        (lambda: kb["* b *"], "name the variables"),
    ):
        with pytest.raises(ValueError, match=reason):
            call()
    with pytest.raises(LookupError):
        KnowledgeClient(MapHandle(kb._engine, "nowhere"))
    with Subscriptions(kb._engine, "lab") as standing, pytest.raises(ValueError, match="DESCRIBE"):
        standing.add("DESCRIBE :table")


def test_an_error_of_a_callback_is_reported_and_ends_nothing(kb: KnowledgeClient) -> None:
    def fails(event: Event) -> None:
        raise RuntimeError("mine")

    kb.subscribe("?x likes tea", fails)
    kb.subscribe("?x likes milk")
    kb += "ann likes tea"
    with pytest.raises(RuntimeError, match="mine"):
        next_event(kb)
    kb += "ann likes milk"
    assert next_event(kb).bindings == {"x": "ann"}


def test_words_of_all_alphabets_are_names() -> None:
    subject = parse_pattern("tasse_β isIn küche", "lab").subject
    assert str(subject) == "urn:semmap:map:lab#tasse_%CE%B2"


def test_a_cup_that_is_moved_in_the_small_house(module_engine: Engine, worlds: Path) -> None:
    import_file(module_engine, worlds / "small_house/worlds/small_house.world", map_name="house")
    cup, table = "Tableware_01_001", "KitchenTable_01_001"
    with KnowledgeClient(MapHandle(module_engine, "house")) as kb:
        assert kb.find("on", f"{cup} semmap:placedOn ?on") == {table}
        kb.subscribe(f"{cup} heldBy {table}")
        url = module_engine.url.render_as_string(hide_password=False)
        with watched(url, f"SELECT ?x {{ ?x semmap:placedOn :{table} }}") as watch:
            with semmap.connect(url) as database:
                database.map("house")[cup].move_to(0, 0, 0)
            assert next_event(kb).what == "disappeared"
            event = json.loads(watch.stdout.readline())
            assert event["event"] == "disappeared"
            assert event["bindings"]["x"]["value"] == f"urn:semmap:map:house#{cup}"
            watch.send_signal(signal.SIGINT)
            assert watch.wait(timeout=20) == 0


@contextmanager
def watched(url: str, query: str) -> Iterator[subprocess.Popen[str]]:
    """A process that follows the house, when it has begun."""
    main = "from semmap.cli import main; main()"
    words = ["sparql", "--map", "house", "--watch", query, "--json"]
    with subprocess.Popen(
        [sys.executable, "-c", main, *words],
        env={**os.environ, "SEMMAP_DB": url},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A run of the tests in the background ignores interrupts, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        try:
            assert "rows now" in process.stderr.readline()
            yield process
        finally:
            process.kill()
