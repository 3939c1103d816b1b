"""What follows in a named graph: from its statements, by the map's axioms and its own."""

from __future__ import annotations

import psycopg
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import query
from semmap.knowledge.reasoning.engine import Triple
from semmap.knowledge.reasoning.explanations import contradictions, why
from semmap.knowledge.reasoning.runs import Changed, reason
from semmap.knowledge.updates import update
from tests.knowledge.reasoning.test_rules import (
    AXIOMS,
    EX,
    PREFIXES,
    STATED,
    by_owlrl,
    plain,
    sentences,
)

RDFS = "http://www.w3.org/2000/01/rdf-schema#"
HERE = (
    f"PREFIX : <{EX}> PREFIX ex: <{EX}> PREFIX rdfs: <{RDFS}> "
    "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
)

OF_I = "GRAPH ?g { ex:i a ?c } FILTER(?g != <urn:semmap:inferred>)"


def truth(session: psycopg.Connection, pattern: str, *, inferred: bool = True) -> bool:
    return query(session, f"{HERE} ASK {{ {pattern} }}", inferred=inferred).truth


def facts_of(session: psycopg.Connection, pattern: str) -> set[Triple]:
    rows = query(session, f"SELECT ?s ?p ?o {{ {pattern} }}").rows
    assert len(rows) == len(set(rows))
    return {(str(s), str(p), str(o)) for s, p, o in rows}


def test_a_graph_has_what_follows_from_its_statements(changing: psycopg.Connection) -> None:
    update(changing, HERE + "INSERT DATA { ex:partOf a owl:TransitiveProperty }")
    reason(changing)
    update(
        changing,
        HERE + "INSERT DATA { GRAPH ex:g { ex:a ex:partOf ex:b . ex:b ex:partOf ex:c . "
        "ex:a a semmap:Mug } GRAPH ex:h { ex:c ex:partOf ex:d } ex:c ex:partOf ex:e }",
    )
    assert truth(changing, "GRAPH ex:g { ex:a ex:partOf ex:c }")
    assert not truth(changing, "GRAPH ex:g { ex:a ex:partOf ex:c }", inferred=False)
    assert not truth(changing, "GRAPH ex:h { ex:a ex:partOf ex:c }")
    assert not truth(changing, "ex:a ex:partOf ?other")
    assert not truth(changing, "GRAPH <urn:semmap:inferred> { ex:a ex:partOf ?other }")
    # No graph has facts of another one, or of the map.
    assert not truth(changing, "GRAPH ?g { ex:a ex:partOf ?far FILTER(?far IN (ex:d, ex:e)) }")
    proof = why(changing, f"GRAPH <{EX}g> {{ <{EX}a> <{EX}partOf> <{EX}c> }}")
    assert len(proof.because) == 2
    with pytest.raises(LookupError, match="is not a fact"):
        why(changing, f"GRAPH <{EX}h> {{ <{EX}a> <{EX}partOf> <{EX}c> }}")
    # The types of the map subsume others in graphs, too.
    assert truth(changing, "GRAPH ex:g { ex:a a semmap:Drinkware }")
    rows = query(changing, HERE + "SELECT ?g { GRAPH ?g { ex:a ex:partOf ex:c } }").rows
    assert [str(g) for (g,) in rows] == [f"{EX}g"]
    chosen = "SELECT ?x FROM ex:g FROM ex:h { ex:a ex:partOf ?x }"
    found = sorted(str(x)[-1] for (x,) in query(changing, HERE + chosen).rows)
    assert found == ["b", "c"]
    update(changing, HERE + "DELETE DATA { GRAPH ex:g { ex:b ex:partOf ex:c } }")
    assert not truth(changing, "GRAPH ex:g { ex:a ex:partOf ex:c }")


def test_axioms_of_a_graph_hold_in_it_alone(changing: psycopg.Connection) -> None:
    reason(changing)
    facts = "ex:a ex:partOf ex:b . ex:b ex:partOf ex:c . "
    update(
        changing,
        HERE + f"INSERT DATA {{ {facts} GRAPH ex:h {{ {facts} }} "
        f"GRAPH ex:g {{ {facts} ex:partOf a owl:TransitiveProperty, owl:AsymmetricProperty }} }}",
    )
    rows = query(changing, HERE + "SELECT ?g { GRAPH ?g { ex:a ex:partOf ex:c } }").rows
    assert [str(g) for (g,) in rows] == [f"{EX}g"]
    assert not truth(changing, "ex:a ex:partOf ex:c")
    assert not contradictions(changing)
    update(changing, HERE + "INSERT DATA { GRAPH ex:g { ex:b ex:partOf ex:a } }")
    assert reason(changing).contradictions == len({e.fact for e in contradictions(changing)}) == 2
    assert all(f"GRAPH <{EX}g>" in each.fact for each in contradictions(changing))
    update(changing, HERE + "DROP GRAPH ex:g")
    assert not truth(changing, "GRAPH ex:g { ?s ?p ?o }")
    done = reason(changing)
    assert done.contradictions == 0
    assert reason(changing, complete=True).inferences == done.inferences


def test_what_axioms_of_the_map_state_is_in_no_graph(changing: psycopg.Connection) -> None:
    update(
        changing,
        HERE + "INSERT DATA { ex:C owl:oneOf (ex:i) . ex:C rdfs:subClassOf ex:D . "
        "ex:E owl:onProperty ex:p ; owl:someValuesFrom ex:D }",
    )
    reason(changing)
    update(changing, HERE + "INSERT DATA { GRAPH ex:g { ex:x ex:p ex:i } }")
    # The one class that follows from the statement, by what the axioms say of ex:i.
    assert truth(changing, "GRAPH ex:g { ex:x a ex:E }")
    assert not truth(changing, OF_I)
    reason(changing, complete=True)
    assert truth(changing, "GRAPH ex:g { ex:x a ex:E }")
    assert not truth(changing, OF_I)
    update(changing, HERE + "DROP GRAPH ex:g")
    assert not truth(changing, OF_I)


def test_axioms_that_move_into_a_graph_are_its_own(changing: psycopg.Connection) -> None:
    axioms = "ex:a rdfs:subClassOf ex:b . ex:b rdfs:subClassOf ex:c"
    update(changing, HERE + f"INSERT DATA {{ {axioms} . GRAPH ex:g {{ ex:x a ex:a }} }}")
    reason(changing)
    assert truth(changing, "GRAPH ex:g { ex:x a ex:c }")
    assert not truth(changing, "GRAPH ex:g { ex:a rdfs:subClassOf ex:c }")
    update(
        changing,
        HERE + f"DELETE DATA {{ {axioms} }} ; INSERT DATA {{ GRAPH ex:g {{ {axioms} }} }}",
    )
    assert truth(changing, "GRAPH ex:g { ex:x a ex:c . ex:a rdfs:subClassOf ex:c }")


def test_copies_have_what_was_stated(changing: psycopg.Connection) -> None:
    update(changing, HERE + "INSERT DATA { ex:partOf a owl:TransitiveProperty }")
    reason(changing)
    facts = "ex:a ex:partOf ex:b . ex:b ex:partOf ex:c"
    update(changing, HERE + f"INSERT DATA {{ GRAPH ex:g {{ {facts} }} }}")
    assert update(changing, HERE + "MOVE ex:g TO ex:h").added == 2
    assert truth(changing, "GRAPH ex:h { ex:a ex:partOf ex:c }")
    update(changing, HERE + "DELETE DATA { GRAPH ex:h { ex:b ex:partOf ex:c } }")
    assert not truth(changing, "GRAPH ?g { ex:a ex:partOf ex:c }")


def test_a_graph_may_be_named_like_an_entity(changing: psycopg.Connection) -> None:
    update(changing, HERE + "INSERT DATA { ex:partOf a owl:TransitiveProperty }")
    reason(changing)
    (name,) = query(changing, "SELECT ?e { ?e semmap:kind 'object' } ORDER BY ?e LIMIT 1").rows[0]
    facts = "ex:a ex:partOf ex:b . ex:b ex:partOf ex:c"
    update(changing, HERE + f"INSERT DATA {{ GRAPH {name.n3()} {{ {facts} }} }}")
    assert truth(changing, f"GRAPH {name.n3()} {{ ex:a ex:partOf ex:c }}")
    using = f"DELETE {{ ?s ex:far ?o }} INSERT {{ ?s ex:far ?o }} USING {name.n3()} "
    update(changing, HERE + using + "WHERE { ?s ex:partOf ?o }")
    assert truth(changing, "ex:a ex:far ex:b, ex:c")
    rows = "SELECT ?g FROM NAMED ex:other { GRAPH ?g { ex:a ex:partOf ex:c } }"
    assert not query(changing, HERE + rows).rows
    rows = f"SELECT ?g FROM NAMED {name.n3()} {{ GRAPH ?g {{ ex:a ex:partOf ex:c }} }}"
    assert list(query(changing, HERE + rows).rows) == [(name,)]


def test_a_deleted_entity_changes_no_graph_but_those_about_it(changing: psycopg.Connection) -> None:
    reason(changing)
    sql = "SELECT cursor, at, graphs FROM reasoning WHERE map_id = current_map()"
    cursor, at, graphs = changing.execute(sql).fetchone() or ("", None, {})
    changing.execute("DELETE FROM entity WHERE name = 'sofa' AND map_id = current_map()")
    changed = Changed.since(MapView.of(changing), cursor, at)
    assert changed is not None
    assert changed.graphs is not None
    assert changed.graphs <= {"", *graphs}
    reason(changing)
    assert changing.execute(sql).fetchone()[2].keys() <= graphs.keys()  # type: ignore[index]


@settings(
    max_examples=8,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(sentences(AXIOMS, 4), sentences(AXIOMS, 4), sentences(STATED, 6), sentences(STATED, 4))
def test_a_graph_has_what_owlrl_infers(
    changing: psycopg.Connection,
    axioms: list[str],
    own_axioms: list[str],
    stated: list[str],
    others: list[str],
) -> None:
    with changing.transaction(force_rollback=True):
        prefixes = PREFIXES.replace("@prefix", "PREFIX").replace(" .", "")
        graph, other = " ".join(own_axioms + stated), " ".join(others)
        reason(changing)
        update(
            changing,
            f"{prefixes} INSERT DATA {{ {' '.join(axioms)} GRAPH <{EX}h> {{ {other} }} "
            f"GRAPH <{EX}g> {{ {graph} }} }}",
        )
        for name, text in (("g", "\n".join(own_axioms + stated)), ("h", "\n".join(others))):
            whole = "\n".join(axioms) + "\n" + text
            # What follows from the map's axioms alone is no fact of the graph.
            of_map = plain(by_owlrl("\n".join(axioms))[0])
            found = plain(facts_of(changing, f"GRAPH <{EX}{name}> {{ ?s ?p ?o }}"))
            assert found - of_map == plain(by_owlrl(whole)[0]) - of_map
