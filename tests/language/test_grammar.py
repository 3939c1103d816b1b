"""The grammar extends that of rdflib, and does not change it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pyparsing
import pytest
import rdflib
from rdflib.plugins.sparql import parser

from semmap.fields.queries import QueryError, query
from semmap.language.parser import parse_query, parse_update
from semmap.language.terms import position_of
from tests.fields.queries.arrays import PREFIX, kitchen
from tests.fields.queries.test_query import ANSWERS, rows


def test_the_grammar_of_rdflib_is_not_changed() -> None:
    text = PREFIX + "SELECT ?v { ?v :free :robot }"
    parse_query(text)
    parse_update(PREFIX + "INSERT DATA { :a :occupies 'b' }")
    with pytest.raises(QueryError):
        parse_query("SELECT ?v {")
    with pytest.raises(pyparsing.ParseException):
        parser.parseQuery(text + " STORE :free")
    tree = parser.parseQuery(text)
    assert type(tree[1].projection[0].var) is rdflib.Variable
    assert position_of(tree[1].where) is None


@pytest.mark.parametrize("number", ["-5", "-5.0", "-0.50"])
def test_a_negative_number_keeps_its_digits(number: str) -> None:
    parsed = parse_query(f"ASK {{ ?x :size {number} }}")
    ((_, _, object_),) = parsed.algebra.p.p2.triples
    assert str(object_) == number


def test_terms_know_their_positions() -> None:
    text = "PREFIX : <http://a/> # b\nSELECT ?v { ?v :p 'x' FILTER(?v != -1.5) } STORE  :q"
    parsed = parse_query(text)
    assert position_of(parsed.store) == text.index(":q")
    assert position_of(parsed.names[0]) == text.index("?v {")
    condition = parsed.algebra.p
    ((subject, verb, object_),) = condition.p.p2.triples
    assert [position_of(t) for t in (subject, verb, object_)] == [
        text.index(part) for part in ("?v :p", ":p", "'x'")
    ]
    assert position_of(condition.expr) == text.index("?v !=")
    assert position_of(condition.expr.other) == text.index("-1.5")


def test_clauses_are_allowed_before_and_after_other_modifiers() -> None:
    clauses = ('AT "2026-01-31T12:00:00Z"^^xsd:dateTime', "STORE :free")
    for text in (
        "{ ?v :free ?b } %s %s ORDER BY ?v LIMIT 3",
        "{ ?v :free ?b } %s ORDER BY ?v LIMIT 3 %s",
        "{ ?v :free ?b } ORDER BY ?v LIMIT 3 %s %s VALUES ?b { :robot }",
        "{ ?v :free ?b } LIMIT 3 VALUES ?b { :robot } %s %s",
    ):
        for order in (clauses, clauses[::-1]):
            parsed = parse_query(PREFIX + "SELECT ?v " + text % order)
            assert parsed.store is not None
            assert parsed.moment is not None


def test_several_threads_parse_at_once() -> None:
    texts = [text for text, _ in ANSWERS.values()] * 3
    expected = [sorted(map(str, rows(text))) for text in texts]
    parse_query.cache_clear()
    catalogue = kitchen()
    with ThreadPoolExecutor(4) as pool:
        found = pool.map(lambda text: query(catalogue, PREFIX + text), texts)
        assert [sorted(map(str, answer)) for answer in found] == expected  # type: ignore[arg-type]
