"""Inferences in the database: by update, by retraction, in queries."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psycopg
import pytest
import rdflib
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import semmap
from semmap import Map
from semmap.knowledge.queries import query
from semmap.knowledge.rdf_file import read_facts
from semmap.knowledge.reasoning.explanations import contradictions, why
from semmap.knowledge.reasoning.runs import Changed, forget, reason
from semmap.knowledge.updates import update
from semmap.language.error import QueryError
from tests import command_line
from tests.conftest import MakeDatabase

NS = "http://example.org/"
EX = f"PREFIX ex: <{NS}> "
AXIOMS = """INSERT DATA {
    semmap:Drinkware rdfs:subClassOf ex:Breakable . ex:Breakable rdfs:subClassOf ex:Delicate .
    ex:Breakable owl:disjointWith ex:Unbreakable .
    rel:beside a owl:SymmetricProperty . ex:partOf a owl:TransitiveProperty .
    ex:owner a owl:FunctionalProperty . ex:owns owl:inverseOf ex:owner .
}"""


def truth(session: psycopg.Connection, pattern: str, *, inferred: bool = True) -> bool:
    return query(session, f"{EX} ASK {{ {pattern} }}", inferred=inferred).truth


def test_inferences_follow_updates(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    assert not truth(changing, ":cup%201 a ex:Delicate")
    done = reason(changing)
    assert done.complete
    assert truth(changing, ":cup%201 a ex:Delicate")
    assert not truth(changing, ":cup%201 a ex:Delicate", inferred=False)
    assert not truth(changing, ":table a ex:Delicate")
    update(changing, EX + "INSERT DATA { :mug a semmap:Mug . :table ex:owner :ann }")
    assert truth(changing, ":mug a ex:Delicate")
    assert truth(changing, ":ann ex:owns :table")
    update(changing, EX + "DELETE DATA { :table ex:owner :ann }")
    assert not truth(changing, ":ann ex:owns :table")


def test_retraction_removes_what_lost_its_last_reason(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    reason(changing)
    update(
        changing,
        EX
        + "INSERT DATA { :a ex:partOf :b . :b ex:partOf :c . :a ex:partOf :d . :d ex:partOf :c }",
    )
    assert truth(changing, ":a ex:partOf :c")
    update(changing, EX + "DELETE DATA { :a ex:partOf :b }")
    assert truth(changing, ":a ex:partOf :c")
    update(changing, EX + "DELETE DATA { :d ex:partOf :c }")
    assert not truth(changing, ":a ex:partOf :c")
    # A statement that follows from others stays when it is no longer stated.
    update(changing, EX + "INSERT DATA { :a ex:partOf :c . :d ex:partOf :c }")
    assert truth(changing, ":a ex:partOf :c", inferred=False)
    update(changing, EX + "DELETE DATA { :a ex:partOf :c }")
    assert not truth(changing, ":a ex:partOf :c", inferred=False)
    assert truth(changing, ":a ex:partOf :c")


def test_what_is_the_same_has_the_same_facts(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    reason(changing)
    update(
        changing,
        EX + "INSERT DATA { ex:tea ex:partOf :table . :sofa ex:owner ex:tea . ex:tea ex:price 2 }",
    )
    # Two values of a functional property that may be one resource: rules of equality apply.
    update(changing, EX + "INSERT DATA { :sofa ex:owner ex:drink }")
    assert truth(changing, "ex:drink owl:sameAs ex:tea ; ex:partOf :table ; ex:price 2")
    update(changing, EX + "INSERT DATA { ex:drink ex:colour 'red' }")
    assert truth(changing, "ex:tea ex:colour 'red'")
    assert not reason(changing).complete
    update(changing, EX + "DELETE DATA { :sofa ex:owner ex:drink }")
    assert not truth(changing, "ex:drink ex:partOf :table")
    assert not truth(changing, "ex:tea ex:colour 'red'")
    before = inferences(changing)
    assert reason(changing, complete=True).complete
    assert inferences(changing) == before


def test_a_type_that_is_told_is_not_inferred(changing: psycopg.Connection) -> None:
    update(changing, EX + "INSERT DATA { ex:vessel rdfs:domain semmap:Mug . :lost ex:vessel 1 }")
    reason(changing)
    rows = "SELECT ?c { :lost a ?c FILTER(?c IN (semmap:Mug, semmap:Drinkware, semmap:Object)) }"
    assert len(query(changing, rows).rows) == 3
    changing.execute(
        "UPDATE entity SET type = 'mug' WHERE name = 'lost' AND map_id = current_map()"
    )
    assert reason(changing).removed
    assert len(query(changing, rows).rows) == 3
    assert truth(changing, ":lost a semmap:Mug", inferred=False)
    changing.execute(
        "UPDATE entity SET type = 'umbrella' WHERE name = 'lost' AND map_id = current_map()"
    )
    reason(changing)
    assert len(query(changing, rows).rows) == 3
    assert not truth(changing, ":lost a semmap:Mug", inferred=False)


def test_contradictions_name_facts_and_axioms(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    assert reason(changing).contradictions == 0
    update(
        changing,
        EX + "INSERT DATA { :cup%201 a ex:Unbreakable . :sofa ex:owner :ann, :bob . "
        "ex:livesIn rdfs:range semmap:Room . :bob ex:livesIn :sofa }",
    )
    found = {each.fact + ": " + each.axiom: each for each in contradictions(changing)}
    assert list(found) == [
        f":cup%201: <{NS}Breakable> and <{NS}Unbreakable> are disjoint",
        f":sofa: <{NS}owner> has at most one value",
        ":sofa: semmap:Room and semmap:Object are disjoint",
    ]
    text = "\n".join(next(iter(found.values())).lines())
    assert ":cup%201 a semmap:Drinkware" in text
    assert truth(changing, ":sofa semmap:contradiction ?why")
    update(
        changing, EX + "DELETE DATA { :sofa ex:owner :bob } ; DELETE DATA { :bob ex:livesIn :sofa }"
    )
    assert [each.fact for each in contradictions(changing)] == [":cup%201"]


def test_why_leads_to_told_facts(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    reason(changing)
    proof = why(changing, ":cup%201 a <http://example.org/Delicate>")
    assert proof.because[0].because[0].fact == ":cup%201 a semmap:Drinkware"
    assert proof.because[0].because[0].because == ()
    assert why(changing, ":cup%201 semmap:heldBy :table").axiom == ""
    with pytest.raises(LookupError, match="not a fact"):
        why(changing, ":cup%201 a semmap:Room")
    with pytest.raises(QueryError, match="variables"):
        why(changing, "?x a semmap:Room")


def test_the_graph_of_inferences_is_read_only(changing: psycopg.Connection) -> None:
    update(changing, EX + AXIOMS)
    reason(changing)
    rows = query(changing, "SELECT ?x { GRAPH <urn:semmap:inferred> { ?x a ?c } }").rows
    assert rows
    names = query(changing, "SELECT DISTINCT ?g { GRAPH ?g { ?x ?p ?o } }").rows
    assert len(names) == 3
    with pytest.raises(QueryError, match="follows from other facts"):
        update(changing, "INSERT DATA { GRAPH <urn:semmap:inferred> { :ann rel:beside :bob } }")
    forget(changing)
    assert not query(changing, "SELECT ?x { GRAPH <urn:semmap:inferred> { ?x a ?c } }").rows


@pytest.fixture(scope="module")
def flat(make_database: MakeDatabase) -> Iterator[tuple[str, Map]]:
    """A map that a second program can follow, and the address of its database."""
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        made = db.create_map("home")
        made.add_object("bowl", type="bowl", size=(0.2, 0.2, 0.1), pose=(1, 1, 0))
        update(made.connection, EX + AXIOMS)
        yield url, made


@contextmanager
def reasoning(url: str) -> Iterator[subprocess.Popen[str]]:
    """A process that reasons about the map."""
    words = ["knowledge", "reason", "--watch", "--json", "--map", "home"]
    with subprocess.Popen(
        [sys.executable, "-c", "from semmap.cli import main; main()", *words],
        env={**os.environ, "SEMMAP_DB": url},
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        late = threading.Timer(120, process.kill)  # a line that never comes is a failure, no wait
        late.start()
        try:
            yield process
        finally:
            late.cancel()
            process.kill()


def test_a_watch_infers_after_each_change(flat: tuple[str, Map]) -> None:
    url, made = flat
    delicate = EX + "SELECT ?x { ?x a ex:Delicate }"

    def found() -> set[str]:
        rows = query(made.connection, delicate).rows
        return {str(x).split("#")[1] for (x,) in rows}

    with reasoning(url) as watch:
        assert watch.stdout is not None
        assert json.loads(watch.stdout.readline())["complete"]
        assert found() == set()
        made.add_object("cup", type="cup", size=(0.1, 0.1, 0.1), pose=(2, 1, 0))
        first = json.loads(watch.stdout.readline())
        assert first["added"] == 2
        assert not first["complete"]
        assert found() == {"cup"}
        made["cup"].delete()
        assert json.loads(watch.stdout.readline())["removed"] == 2
        assert found() == set()
        watch.send_signal(signal.SIGINT)
        assert watch.wait(timeout=20) == 0


def test_what_is_committed_while_changes_are_read_is_not_skipped(
    flat: tuple[str, Map], monkeypatch: pytest.MonkeyPatch
) -> None:
    url, made = flat
    session = made.connection
    made.add_object("cup", type="cup", size=(0.1, 0.1, 0.1), pose=(2, 1, 0))
    reason(session)
    since = Changed.since

    def interrupted(*values: Any) -> Changed | None:
        monkeypatch.setattr(Changed, "since", since)
        found = since(*values)
        with semmap.connect(url) as other:
            other.map(made.name)["cup"].delete()
        return found

    monkeypatch.setattr(Changed, "since", interrupted)
    reason(session)
    assert reason(session).removed == 2


def test_exports_have_inferences_where_asked(flat: tuple[str, Map], tmp_path: Path) -> None:
    url, made = flat
    session = made.connection
    update(session, "INSERT DATA { :glass a semmap:Cup }")
    reason(session)
    glass = rdflib.URIRef("urn:semmap:map:home#glass")
    delicate = (glass, rdflib.RDF.type, rdflib.URIRef(f"{NS}Delicate"))

    def graphs_with_it(name: str, *words: str) -> set[object]:
        command_line.semmap(url, "rdf", "export", tmp_path / name, "--map", "home", *words)
        format_ = {".ttl": "turtle", ".trig": "trig"}[Path(name).suffix]
        facts = list(read_facts(tmp_path / name, format_))
        assert len(facts) > 20
        return {f.graph for f in facts if (f.subject, f.property, f.object) == delicate}

    assert graphs_with_it("told.ttl") == set()
    assert graphs_with_it("all.ttl", "--inferences") == {None}
    assert graphs_with_it("all.trig", "--inferences") == {rdflib.URIRef("urn:semmap:inferred")}
    # The graph of inferences is not read back: what it has would be stated.
    command_line.semmap(url, "rdf", "import", tmp_path / "all.trig", "--map", "home")
    update(session, "DELETE { :glass a ?c } WHERE { :glass semmap:directType ?c }")
    assert not truth(session, ":glass a ex:Delicate")
    forget(session)
    with pytest.raises(ValueError, match="semmap knowledge reason"):
        graphs_with_it("none.ttl", "--inferences")


THINGS = (":table", ":sofa", ":cup%201", ":ann", "ex:coffee", "ex:tea")
CHANGES = (
    "{} {{ {a} rel:beside {b} }}",
    "{} {{ {a} ex:partOf {b} }}",
    "{} {{ {a} ex:partOf {b} }}",
    "{} {{ {a} ex:owner {b} }}",
    "{} {{ {a} ex:knows {b} }}",
    "{} {{ {a} a {c} }}",
    "{} {{ {a} a {c} }}",
    "{} {{ {a} prop:colour 'red' }}",
    "{} {{ {a} semmap:heldBy {b} }}",
    "{} {{ GRAPH ex:g {{ {a} ex:partOf {b} }} }}",
    "{} {{ GRAPH ex:g {{ {a} a {c} }} }}",
    "{} {{ GRAPH ex:g {{ ex:owner a owl:InverseFunctionalProperty . {a} ex:owner {b} }} }}",
)
MORE_AXIOMS = """INSERT DATA {
    ex:heavy owl:onProperty ex:partOf ; owl:someValuesFrom ex:Delicate .
    ex:heavy rdfs:subClassOf semmap:Furniture .
    ex:red owl:onProperty prop:colour ; owl:hasValue "red" . ex:red rdfs:subClassOf ex:Unbreakable .
    ex:knows a owl:FunctionalProperty ; rdfs:range semmap:Person .
    ex:at owl:propertyChainAxiom ( semmap:heldBy ex:partOf ) .
    semmap:Sofa owl:equivalentClass ex:Couch .
}"""
SQL = (
    "UPDATE entity SET type = 'mug' WHERE name = 'lost' AND map_id = current_map()",
    "UPDATE entity SET type = 'sofa' WHERE name = 'lost' AND map_id = current_map()",
    "UPDATE entity SET type = NULL WHERE name = 'lost' AND map_id = current_map()",
    "SELECT put(entity_id('cup 1'), entity_id('sofa'))",
    "SELECT put(entity_id('cup 1'), NULL)",
    "DELETE FROM entity WHERE name = 'sofa' AND map_id = current_map()",
    "UPDATE statement SET until = clock_timestamp() - interval '1 s' "
    "WHERE predicate LIKE '%partOf'",
)


def inferences(session: psycopg.Connection) -> set[tuple[object, ...]]:
    rows = session.execute(
        "SELECT graph, subject_id, subject, predicate, object_id, object, tag FROM inference "
        "WHERE NOT told AND map_id = (SELECT current_map())"
    ).fetchall()
    assert len(rows) == len(set(rows))
    return set(rows)


change = st.builds(
    lambda template, verb, a, b, c: template.format(verb, a=a, b=b, c=c),
    st.sampled_from(CHANGES),
    st.sampled_from(("INSERT DATA", "INSERT DATA", "DELETE DATA")),
    st.sampled_from(THINGS),
    st.sampled_from(THINGS),
    st.sampled_from(("ex:Delicate", "ex:Unbreakable", "ex:Couch", "semmap:Mug", "ex:heavy")),
)


@settings(
    max_examples=6,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),  # shrinking takes minutes
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(changes=st.lists(st.one_of(change, change, st.sampled_from(SQL)), min_size=1, max_size=8))
def test_each_change_leads_to_what_all_facts_lead_to(
    changing: psycopg.Connection, changes: list[str]
) -> None:
    with changing.transaction(force_rollback=True):
        update(changing, EX + AXIOMS + ";" + MORE_AXIOMS)
        reason(changing)
        for text in changes:
            if text in SQL:
                with suppress(psycopg.Error), changing.transaction():
                    changing.execute(text)
                assert not reason(changing).complete
            else:
                with suppress(QueryError):
                    update(changing, EX + text)
            found = inferences(changing)
            assert reason(changing, complete=True).complete
            assert found == inferences(changing), text
