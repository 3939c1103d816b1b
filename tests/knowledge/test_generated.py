"""Generated queries have the answers that oxigraph has on the dump of the graph."""

from __future__ import annotations

import psycopg
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from semmap.knowledge.queries import query
from tests.knowledge.engines import Engines, comparable

VARIABLES = ("?a", "?b", "?c", "?d")
LINKS = (
    "semmap:heldBy",
    "rel:beside",
    "foaf:knows",
    "ex:likes",
    "semmap:holds",
    "semmap:directType",
    "rdf:type",
    "rdfs:subClassOf",
    "ex:servedIn",
    "semmap:heldBy+",
    "^semmap:heldBy",
    "(semmap:heldBy|rel:beside)",
    "semmap:heldBy/semmap:heldBy",
    "semmap:onStorey",
)
VALUES = (
    "prop:colour",
    "prop:mass",
    "semmap:name",
    "semmap:z",
    "semmap:kind",
    "rdfs:label",
    "ex:likes",
)
CONSTANTS = (
    ":table",
    ":ann",
    ":cup%201",
    ":studio",
    "ex:coffee",
    "semmap:Cup",
    "semmap:Table",
    "ex:Drink",
    ":unknown",
    '"red"',
    '"kitchen"',
    "5",
    "2.5",
    "true",
    '"tea"@en',
)

variable = st.sampled_from(VARIABLES)
node = st.one_of(variable, variable, st.sampled_from(CONSTANTS[:9]))
constant = st.sampled_from(CONSTANTS)


@st.composite
def triples(draw: st.DrawFn) -> str:
    """One to three patterns, of which each shares a variable with those before."""
    subject = draw(variable)
    patterns, seen = [], [subject]
    for _ in range(draw(st.integers(1, 3))):
        subject = draw(st.sampled_from(seen))
        if draw(st.booleans()):
            verb, object_ = draw(st.sampled_from(LINKS)), draw(node)
        else:
            verb, object_ = draw(st.sampled_from(VALUES)), draw(st.one_of(variable, constant))
        if object_.startswith("?"):
            seen.append(object_)
        patterns.append(f"{subject} {verb} {object_} .")
    return " ".join(patterns)


@st.composite
def conditions(draw: st.DrawFn) -> str:
    a, b, value = draw(variable), draw(variable), draw(constant)
    return draw(
        st.sampled_from(
            (
                f"{a} = {b}",
                f"{a} != {b}",
                f"{a} = {value}",
                f"BOUND({a})",
                f"!BOUND({a}) || {a} != {value}",
                f"isIRI({a}) && {a} != {b}",
                f"STRLEN(STR({a})) > 20",
                f"isNUMERIC({a}) && {a} > 0.5",
                f"{a} IN ({value}, {b})",
                f"COALESCE({a}, {b}, 1) = {value}",
                f"sameTerm({a}, {b})",
                f"EXISTS {{ {a} semmap:heldBy {b} }}",
                f"NOT EXISTS {{ {a} rel:beside ?e }}",
            )
        )
    )


def larger(group: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.one_of(
        st.builds(lambda p, q: f"{p} OPTIONAL {{ {q} }}", group, group),
        st.builds(
            lambda p, q, c: f"{p} OPTIONAL {{ {q} FILTER({c}) }}", group, group, conditions()
        ),
        st.builds(lambda p, q: f"{{ {p} }} UNION {{ {q} }}", group, group),
        st.builds(lambda p, q: f"{p} MINUS {{ {q} }}", group, group),
        st.builds(lambda p, c: f"{p} FILTER({c})", group, conditions()),
        st.builds(lambda p, a: f"{p} BIND(STR({a}) AS ?s)", triples(), variable),
        st.builds(
            lambda p, v, c: f"VALUES {v} {{ {c} :sofa UNDEF }} {p}", triples(), variable, constant
        ),
        st.builds(lambda p, q: f"{{ SELECT DISTINCT ?a ?b {{ {p} }} }} {q}", group, triples()),
        st.builds(
            lambda p, q: f"{p} {{ SELECT ?a (COUNT(*) AS ?n) {{ {q} }} GROUP BY ?a }}",
            triples(),
            triples(),
        ),
    )


@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(group=st.recursive(triples(), larger, max_leaves=3))
def test_generated_queries(loft: psycopg.Connection, engines: Engines, group: str) -> None:
    text = f"PREFIX ex: <http://example.org/> SELECT * {{ {group} }}"
    expected = engines.oxigraph(text)
    answer = query(loft, text)
    assert comparable(answer) == expected, answer.explanation
