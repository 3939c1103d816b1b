"""SHACL shapes: validation, and updates that would break them."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

import psycopg
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from semmap.ingest.world import WorldError
from semmap.knowledge.map_view import MapView
from semmap.knowledge.rdf_file import parse_facts, store_facts
from semmap.knowledge.reasoning.runs import reason
from semmap.knowledge.shacl import (
    BrokenShapeError,
    bind_shapes,
    binding_shapes,
    domain_shapes,
    read_shapes,
    unbind_shapes,
    validate,
)
from semmap.knowledge.updates import update
from semmap.language.error import QueryError

EX = "PREFIX ex: <http://example.org/> "
HEAD = """
@prefix sh: <http://www.w3.org/ns/shacl#> . @prefix semmap: <urn:semmap:ontology#> .
@prefix prop: <urn:semmap:property#> . @prefix rel: <urn:semmap:relation#> .
@prefix ex: <http://example.org/> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
"""
CUPS = """
ex:CupShape a sh:NodeShape ; sh:targetClass semmap:Cup ;
    sh:property [ sh:path prop:mass ; sh:maxInclusive 2.0 ; sh:message "is too heavy" ] ;
    sh:property [ sh:path (semmap:heldBy semmap:heldBy) ; sh:class semmap:Room ;
        sh:message "is held by what is in no room" ] ;
    sh:property [ sh:path ex:owner ; sh:class semmap:Person ; sh:message "is owned by nobody" ] .
ex:TableShape a sh:NodeShape ; sh:targetClass semmap:Table ;
    sh:property [ sh:path [ sh:inversePath rel:beside ] ; sh:maxCount 1 ;
        sh:message "has two neighbours" ] .
ex:Drink a sh:NodeShape ; sh:targetSubjectsOf ex:servedIn ;
    sh:property [ sh:path ex:servedIn ; sh:node ex:Vessel ] .
ex:Vessel sh:property [ sh:path prop:colour ; sh:minCount 1 ; sh:message "has no colour" ] .
"""


def written(folder: Path, text: str, name: str = "rules.ttl") -> Path:
    path = folder / name
    path.write_text(HEAD + text)
    return path


def wrong(session: psycopg.Connection, *shapes: object) -> set[tuple[str, str]]:
    found = validate(session, shapes)
    return {(each.name, each.message) for each in found if each.severity == "violation"}


def test_the_loft_lacks_what_a_robot_needs(changing: psycopg.Connection) -> None:
    lost = (":lost", "has neither a pose nor a holder: nothing is known of where it is")
    assert wrong(changing, domain_shapes()) == {lost}
    update(changing, "INSERT DATA { :lost semmap:heldBy :studio }")
    assert wrong(changing, domain_shapes()) == set()
    warnings = {(v.name, v.path) for v in validate(changing, [domain_shapes()])}
    assert (":lost", "geo:hasBoundingBox") in warnings
    update(
        changing,
        "INSERT DATA { :spoon a semmap:Spoon ; semmap:heldBy :studio . :table prop:mass -1 }",
    )
    found = validate(changing, [domain_shapes()])
    assert {(v.name, v.value) for v in found if v.severity == "violation"} == {
        (":spoon", ""),
        (":table", "-1"),
    }


def test_an_update_that_breaks_a_binding_shape_changes_nothing(
    changing: psycopg.Connection, tmp_path: Path
) -> None:
    shapes = read_shapes(written(tmp_path, CUPS))
    bind_shapes(changing, shapes)
    facts = (
        "SELECT (SELECT count(*) FROM statement), (SELECT count(*) FROM entity), "
        "(SELECT string_agg(properties::text, '' ORDER BY id) FROM entity)"
    )
    before = changing.execute(facts).fetchone()
    for text, reason_ in (
        ("INSERT DATA { :mug a semmap:Mug . :cup%201 prop:mass 2.5 }", ":cup%201: is too heavy"),
        ("INSERT DATA { :sofa rel:beside :table . :ann rel:beside :table }", "two neighbours"),
        ("DELETE WHERE { :cup%201 prop:colour ?c }", "ex:coffee|coffee"),
        ("INSERT DATA { :cup%201 ex:owner :sofa }", "owned by nobody .*:sofa"),
    ):
        with pytest.raises(QueryError, match=rf"breaks the shapes rules.*{reason_}"):
            update(changing, EX + text)
        assert changing.execute(facts).fetchone() == before
    assert update(changing, EX + "INSERT DATA { :cup%201 ex:owner :ann ; prop:mass 2 }").added == 2
    path = Path("facts.ttl")
    text = "<urn:semmap:map:loft#cup%201> <urn:semmap:property#mass> 9 ."
    with pytest.raises(WorldError, match="too heavy"):
        store_facts(changing, parse_facts(text, "turtle", path), path)
    with pytest.raises(LookupError, match="those that do: rules"):
        unbind_shapes(changing, "other")
    unbind_shapes(changing, "rules")
    assert update(changing, "INSERT DATA { :cup%201 prop:mass 2.5 }").added == 1
    with pytest.raises(BrokenShapeError, match="does not conform"):
        bind_shapes(changing, shapes)
    assert binding_shapes(MapView.of(changing)) == []


def test_inferences_count(changing: psycopg.Connection, tmp_path: Path) -> None:
    text = "ex:S a sh:NodeShape ; sh:targetClass ex:Fragile ; sh:property ex:P ."
    text += "ex:P sh:path ex:wrap ; sh:minCount 1 ."
    shapes = read_shapes(written(tmp_path, text))
    update(changing, "INSERT DATA { :lost semmap:heldBy :studio }")
    update(
        changing,
        EX + "INSERT DATA { ex:stack rdfs:range ex:Fragile . ex:Kind owl:disjointWith ex:Fragile }",
    )
    reason(changing)
    bind_shapes(changing, shapes)
    with pytest.raises(QueryError, match=":sofa"):
        update(changing, EX + "INSERT DATA { :ann ex:stack :sofa }")
    update(changing, EX + "INSERT DATA { :ann ex:stack :sofa . :sofa ex:wrap 'foil' }")
    bind_shapes(changing, domain_shapes())
    with pytest.raises(QueryError, match="contradicts an axiom"):
        update(changing, EX + "INSERT DATA { :sofa a ex:Kind }")


BAD = (
    ("ex:A ex:b", "not Turtle"),
    ("ex:A a ex:B .", "no SHACL shape"),
    ("ex:A a sh:NodeShape ; sh:property [ sh:minCount 1 ] .", "malformed"),
    ("ex:A a sh:NodeShape ; sh:targetClass ex:B ; sh:pattern '[' .", "malformed"),
    ("<> owl:imports <http://example.org/x> . ex:A a sh:NodeShape .", "owl:imports"),
    ("ex:A a sh:NodeShape ; sh:js [ sh:jsFunctionName 'f' ] .", "code"),
)


@pytest.mark.parametrize(("text", "reason_"), BAD)
def test_malformed_shapes_are_refused(tmp_path: Path, text: str, reason_: str) -> None:
    with pytest.raises(WorldError, match=reason_):
        read_shapes(written(tmp_path, text))


def test_a_pattern_that_takes_too_long_is_refused(
    changing: psycopg.Connection, tmp_path: Path
) -> None:
    update(changing, EX + f"INSERT DATA {{ :table ex:code '{'a' * 40}b' }}")
    text = "ex:A a sh:NodeShape ; sh:targetSubjectsOf ex:code ; sh:property ex:P ."
    path = written(tmp_path, text + 'ex:P sh:path ex:code ; sh:pattern "^(a|aa)+$" .')
    with pytest.raises(WorldError, match=r"sh:pattern: takes longer than 1 s .*Do not nest"):
        validate(changing, [read_shapes(path)])


SLOW = """
ex:Fast a sh:NodeShape ; sh:targetClass semmap:Cup ;
    sh:sparql [ sh:select "SELECT $this { $this a ?none }" ] .
ex:Slow a sh:NodeShape ; sh:targetClass semmap:Sofa ; sh:property [ sh:path ex:code ;
    sh:sparql [ sh:select "SELECT $this { %s FILTER(?p9 != 1) }" ] ] .
"""
MANY = "".join(f"{{ SELECT $this ?p{i} {{ ?s{i} ?p{i} ?o{i} }} }}" for i in range(10))
NESTED = "$this <http://example.org/name> ?p9 FILTER(REGEX(?p9, '^(a|aa)+$'))"


@pytest.mark.parametrize("pattern", [MANY, NESTED])
def test_sparql_of_a_shape_that_takes_too_long_is_stopped(
    changing: psycopg.Connection, tmp_path: Path, pattern: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    update(changing, EX + f"INSERT DATA {{ :sofa ex:name '{'a' * 60}b' }}")
    shapes = read_shapes(written(tmp_path, SLOW % pattern))
    begin = time.monotonic()
    stopped = r"shape http://example.org/Slow: its SPARQL was stopped after [12].* s\. Make it"
    with pytest.raises(WorldError, match=stopped):
        validate(changing, [shapes], seconds=2)
    monkeypatch.setenv("SEMMAP_MAX_QUERY_SECONDS", "2")
    with pytest.raises(WorldError, match=stopped):
        bind_shapes(changing, shapes)
    assert time.monotonic() - begin < 30
    assert not binding_shapes(MapView.of(changing))


def test_sparql_of_a_shape_has_a_limit_of_memory(
    changing: psycopg.Connection, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grow = "".join(f"BIND(CONCAT(?p{i}, ?p{i}) AS ?p{i + 1}) " for i in range(40))
    shapes = read_shapes(written(tmp_path, SLOW % f"BIND('abcdefgh' AS ?p0) {grow}"))
    monkeypatch.setenv("SEMMAP_MAX_READER_BYTES", str(2**29))
    with pytest.raises(WorldError, match="512 MiB of memory"):
        validate(changing, [shapes])


CHANGES = (
    ":cup%201 prop:mass 3",
    ":cup%201 prop:mass 1",
    ":cup%201 prop:colour 'red'",
    ":tasse%20%CE%B2 semmap:heldBy :sofa",
    ":cup%201 semmap:heldBy :shelf%2Fleft",
    ":table semmap:heldBy :sofa",
    ":sofa rel:beside :table",
    ":ann rel:beside :table",
    ":cup%201 ex:owner :ann",
    ":cup%201 ex:owner ex:robin",
    "ex:robin a semmap:Person",
    "ex:tea ex:servedIn :sofa",
    ":sofa prop:colour 'grey'",
    ":sofa a semmap:Table",
    ":jug a semmap:Cup",
)


@settings(
    max_examples=5,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    changes=st.lists(
        st.tuples(st.sampled_from(("INSERT", "INSERT", "DELETE")), st.sampled_from(CHANGES)),
        min_size=1,
        max_size=6,
    )
)
def test_an_update_is_refused_where_the_whole_map_would_not_conform(
    changing: psycopg.Connection, tmp_path: Path, changes: list[tuple[str, str]]
) -> None:
    shapes = read_shapes(written(tmp_path, CUPS))
    with changing.transaction(force_rollback=True):
        for verb, fact in changes:
            text = f"{EX} {verb} DATA {{ {fact} }}"
            with suppress(psycopg.Rollback), changing.transaction() as attempt:
                with suppress(QueryError):
                    update(changing, text)
                conforms = not wrong(changing, shapes)
                raise psycopg.Rollback(attempt)
            bind_shapes(changing, shapes)
            refused = ""
            try:
                update(changing, text)
            except QueryError as error:
                refused = str(error)
            unbind_shapes(changing, "rules")
            assert ("breaks the shapes" in refused) != conforms, (text, refused)
