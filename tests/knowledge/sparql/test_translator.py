"""COUNT of a bound variable as COUNT(*); the oracle is rdflib, which answers both."""

from __future__ import annotations

from typing import Any

import pytest
import rdflib
from hypothesis import given
from hypothesis import strategies as st
from rdflib.plugins.sparql import prepareQuery
from rdflib.plugins.sparql.sparql import Query

from semmap.knowledge.sparql.translator import count_solutions
from semmap.language.syntax_tree import parts_of

NODES = [rdflib.URIRef(f"urn:{name}") for name in "abc"]
PATTERNS = {
    "?v <urn:a> ?r": True,
    "?r <urn:a>/<urn:b>* ?v": True,
    "?r <urn:a> ?w . ?v <urn:b> ?r": True,
    "?r <urn:a> ?w OPTIONAL { ?r <urn:b> ?v }": False,
    "?v <urn:a> ?r OPTIONAL { ?r <urn:b> ?w }": True,
    "{ ?v <urn:a> ?r } UNION { ?r <urn:b> ?v }": True,
    "{ ?v <urn:a> ?r } UNION { ?r <urn:b> ?w }": False,
    "?v <urn:a> ?r MINUS { ?v <urn:b> ?w }": True,
    "?r <urn:a> ?w BIND(?w + 1 AS ?v)": False,
    "?v <urn:a> ?r BIND(?r AS ?w)": True,
    "?v <urn:a> ?r FILTER(?v != ?r)": True,
    "?r <urn:a> ?w VALUES ?v { <urn:a> UNDEF }": False,
    "?r <urn:a> ?w { SELECT ?v { ?v <urn:b> ?x } ORDER BY ?v LIMIT 2 }": True,
    "?r <urn:a> ?w { SELECT DISTINCT ?x { ?v <urn:b> ?x } }": False,
    "?r <urn:a> ?w { SELECT (COUNT(?x) AS ?v) { ?x <urn:b> ?y } }": False,
    "GRAPH ?v { ?r <urn:a> ?w }": True,
}
QUERY = """SELECT ?r (COUNT(?v) AS ?n) (COUNT(DISTINCT ?v) AS ?m) (COUNT(?v + 1) AS ?k) {{ {} }}
    GROUP BY ?r HAVING (COUNT(?v) >= 0)"""


@pytest.mark.parametrize("pattern", PATTERNS)
def test_only_variables_that_are_bound_count_solutions(pattern: str) -> None:
    query = prepareQuery(QUERY.format(pattern)).algebra
    before = repr(query)
    counts = [
        str(each.vars)
        for each in _aggregates(count_solutions(query))
        if each.name == "Aggregate_Count" and not each.distinct and not hasattr(each.vars, "op")
    ]
    assert ("*" in counts) is PATTERNS[pattern]
    assert ("v" in counts) is not PATTERNS[pattern]
    assert repr(query) == before


@given(
    st.lists(st.tuples(*[st.sampled_from(NODES)] * 3), max_size=9),
    st.sampled_from([pattern for pattern in PATTERNS if "GRAPH" not in pattern]),
)
def test_the_answers_are_those_of_the_variable(
    triples: list[tuple[rdflib.URIRef, ...]], pattern: str
) -> None:
    data = rdflib.Graph()
    for subject, predicate, object_ in triples:
        data.add((subject, predicate, object_))
    query = prepareQuery(QUERY.format(pattern))
    counted = Query(query.prologue, count_solutions(query.algebra))
    assert sorted(data.query(counted)) == sorted(data.query(query))


def _aggregates(tree: Any) -> list[Any]:
    if not hasattr(tree, "name"):
        return []
    own = [] if tree.name != "AggregateJoin" else list(tree.A)
    # the outermost one only: sub-queries have their own
    return own or [each for _, part in parts_of(tree) for each in _aggregates(part)]
