"""Wrong queries: the error states the reason, and the place in the text of the user."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.fields.queries import QueryError, SelectResult, StoreResult, query
from tests.fields.queries.arrays import PREFIX, kitchen
from tests.fields.queries.test_query import ANSWERS, STORES

WRONG = {
    # names
    "SELECT ?v { ?v »:inFeildOfView :human1 }": "did you mean inFieldOfView",
    "SELECT ?v { ?v a »:mug }": None,
    "SELECT ?v { ?v »a :mug }": "there is no property http://www.w3.org/1999/02/22-rdf-syntax-ns#t",
    "SELECT ?v { ?v :inFieldOfView »:nobody }": "there is no entity and no type nobody",
    "SELECT ?v { ?v »kb:free ?b }": "the prefix kb: is not declared: begin with PREFIX kb: <...>",
    "SELECT ?v { ?v »?p :human1 }": "a property cannot be a variable: name it",
    # kinds
    "SELECT ?v { ?v :inFieldOfView »'mug' }": "mug is not of the type agent",
    "SELECT ?v { ?v :inFieldOfView ?o FILTER(?o = »'mug') }": "mug is not of the type agent",
    "SELECT ?v { ?v :free ?a . »?a :free ?b }": "?a is a voxel here, but an entity in line 2",
    "SELECT ?v { ?v :free ?a .\n?w :distanceToPerson »?a }": "?a is a number here, but an entity",
    "SELECT ?v { »:mug1 :free ?a }": "the subject of :free is a voxel, which has no name",
    "SELECT ?v { ?v :free »2.5 }": "the object of :free is an entity: write an IRI or a plain name",
    "SELECT ?v { ?v :distanceToPerson »'far' }": "the object of :distanceToPerson is a number",
    "SELECT ?v { ?v :free ?b FILTER(»?b > 2) }": "an entity cannot be compared with a number",
    "SELECT ?v { ?v :free ?b FILTER(»?b > ?b) }": "an entity has no order: compare STR(...)",
    "SELECT ?v { ?v :free ?b FILTER(»?b > 'a') }": "an entity has no order: compare STR(...)",
    "SELECT ?v { ?v :free ?b FILTER(»?v < ?v) }": "a voxel has no order: compare :x(...)",
    "SELECT ?v { ?v :free ?b FILTER(»?v = :mug1) }": "a voxel cannot be compared with a name",
    "SELECT ?v { ?v :free ?b FILTER(»:a = :b) }": "both sides are constants",
    "SELECT ?v { ?v :free ?b FILTER(»?v) }": "a voxel is neither true nor false: compare it",
    "SELECT ?v { ?v :free ?b FILTER(1 + »?b > 2) }": "an entity is not a number",
    "SELECT ?v { ?v :free ?b FILTER(1 + »'a' > 2) }": "this is not a number",
    "SELECT ?v { ?v :free ?b FILTER(?b IN (»1, 2)) }": "an entity cannot be compared with a number",
    "SELECT ?v { ?v :free ?b FILTER(STRLEN(»?b) > 2) }": "an entity is not a text: write STR(...)",
    "SELECT ?v { ?v :free ?b FILTER(REGEX(STR(?b), »'(')) }": "this is not a regular expression:",
    "SELECT ?v { ?v :free ?b FILTER(REGEX(STR(?b), »?b)) }": "this has to be a constant",
    "SELECT ?v { ?v :free ?b FILTER(:x(»?b) > 2) }": "x takes a voxel, and this is an entity",
    "SELECT ?v { ?v :free ?b FILTER(»:x(?v, ?v) > 2) }": "x takes 1 argument, not 2",
    "SELECT ?v { ?v :free ?b FILTER(»:distance(?v) > 2) }": "distance takes 2 arguments, not 1",
    "SELECT ?v { ?v :free ?b FILTER(»:height(?v) > 2) }": "there is no function height",
    "SELECT ?v { ?v :free ?b FILTER(»<urn:other#x>(?v) > 2) }": "there is no function x",
    "SELECT ?v { ?v :free ?b BIND(IF(?b = ?b, 1, »?b) AS ?c) }": "all of these must be of one",
    "SELECT ?v { VALUES ?x { :mug1 »2 } ?v :free ?b }": "?x is a number here, but an entity in",
    'SELECT ?v { ?v :distanceToPerson ?d FILTER(?d > »"soon"^^xsd:dateTime) }': "neither a number",
    # what binds
    "SELECT »?w { ?v :free ?b }": "?w is not bound by any pattern",
    "SELECT ?v { ?v :free ?b FILTER(»?d > 1) }": "?d is not bound by any pattern",
    "SELECT ?v { ?v :free ?b { ?w :free ?c FILTER(»?v = ?w) } }": "?v is not bound in this group",
    "SELECT ?v { ?v :free ?b BIND(1 AS »?b) }": "?b is bound already: take another name",
    "SELECT (1 AS »?v) { ?v :free ?b }": "?v is bound already",
    # groups
    "SELECT »?v (COUNT(*) AS ?n) { ?v :free ?b } GROUP BY ?b": "?v is neither grouped by nor aggre",
    "»SELECT * { ?v :free ?b } GROUP BY ?b": "* cannot be used with groups: name the variables",
    "SELECT (SUM(»?b) AS ?n) { ?v :free ?b }": "SUM takes numbers, and this is an entity",
    "SELECT (MAX(»?b) AS ?n) { ?v :free ?b }": "an entity has no order: write STR(...)",
    "SELECT ?v { ?v :distanceToPerson ?d FILTER(»SUM(?d) > 1) }": "an aggregate is allowed in",
    "SELECT (SUM(»COUNT(?d)) AS ?n) { ?v :distanceToPerson ?d }": "not within another aggregate",
    # what is in SPARQL, but not here
    "SELECT ?v { ?v »:on/:on ?b }": "property paths are not supported: write a pattern for each st",
    "SELECT ?v { ?v »:on|:free ?b }": "property paths are not supported: write UNION",
    "SELECT ?v { ?v »:on+ ?b }": "property paths are not supported",
    "SELECT ?v { ?v !»:on ?b }": "property paths are not supported",
    "SELECT ?v { ?v ^»:on ?b }": "property paths are not supported: exchange subject and object",
    "SELECT ?v { ?v :free »(:a :b) }": "lists are not supported",
    "SELECT ?v { »SERVICE <urn:x> { ?v :free ?b } }": "SERVICE is not supported",
    "SELECT ?v { »GRAPH <urn:x> { ?v :free ?b } }": "GRAPH is not supported",
    "SELECT ?v »FROM <urn:x> { ?v :free ?b }": "FROM is not supported",
    "»CONSTRUCT { ?v :free ?b } WHERE { ?v :free ?b }": "CONSTRUCT is not supported",
    "»DESCRIBE ?v WHERE { ?v :free ?b }": "DESCRIBE is not supported",
    "SELECT (»GROUP_CONCAT(?b) AS ?n) { ?v :free ?b }": "GROUP_CONCAT is not supported",
    "SELECT ?v { ?v :free ?b FILTER(»isIRI(?b)) }": "isIRI is not supported",
    "SELECT ?v { ?v :free ?b FILTER(»RAND() > 1) }": "RAND is not supported",
    "SELECT (»EXISTS { ?v :free ?b } AS ?e) { ?v :free ?b }": "EXISTS is allowed in FILTER and",
    "SELECT ?v { »VALUES (?v ?b) { (1) } }": "VALUES has 2 variables, but a row has 1 values",
    # no SPARQL
    "»SELCT ?v WHERE { ?v :free ?b }": "not SPARQL",
    "SELECT ?v { ?v :free ?b FILTER(?v >»> 2) }": "not SPARQL",
    "SELECT ?v { ?v :free ?b . ?v »}": "not SPARQL",
    "SELECT ?v WHERE ?v :free human1 »FILTR(?v) LIMIT 3": "not SPARQL",
    "SELECT ?v { ?v :free 'a »}": None,
    "SELECT ?v { ?v :free ?b »": "the text ends too early: expected",
    "»": "the text ends too early",
    # STORE
    "SELECT ?v { ?v :free ?b } STORE »:fre": "did you mean free",
    "SELECT ?v { ?v :free ?b } STORE »:on": "STORE makes a map, but :on is a property of",
    "SELECT »?b { ?v :free ?b } STORE :free": "STORE needs a voxel first, and ?b is an entity",
    "SELECT ?v ?b ?d { ?v :free ?b ; :distanceToPerson ?d } STORE »:free": "STORE needs SELECT",
    "SELECT * { ?v :free ?b } STORE »:free": "STORE needs SELECT with a voxel, or with a voxel",
    "SELECT ?v »?d { ?v :distanceToPerson ?d } STORE :free": "the object of :free is an entity,",
    "SELECT ?v { ?v :free ?b } STORE »:distanceToPerson": "STORE needs a number for each voxel:",
    "SELECT ?v { { SELECT ?v { ?v :free ?b } } } STORE »:free": "STORE needs an entity for each",
    "SELECT ?v { ?v :free ?b } GROUP BY ?v STORE »:free": "STORE needs an entity for each voxel:",
    "SELECT ?v { ?v :free :robot ; »:free ?b } STORE :free": "?v has several objects of :free:",
    "SELECT ?v { { ?v »:free ?b } UNION { ?v :inFieldOfView ?b } } STORE :free": "STORE takes the",
    "SELECT ?v ?b { ?v :occupiedBy ?b } STORE »:inFieldOfView": "cup1 is not of the type agent",
    "ASK { ?v :free ?b } »STORE :free": "ASK has nothing to STORE",
    "SELECT ?v { ?v :free ?b } STORE :free »STORE :free": "STORE is given twice: give it once",
    # time
    'SELECT ?v { ?v :free ?b } AT »"noon"': "this is not a time: write",
    'SELECT ?v { ?v :free ?b } AT »"noon"^^xsd:dateTime': "this is not a time: write",
    'SELECT ?v { ?v :free ?b } AT »"2026-01-31T12:00:00"^^xsd:dateTime': "this time has no zone",
    'SELECT ?v { ?v :free ?b } AT »"2026-01-31T12:00:00Z"^^xsd:dateTime': "2026-01-31",
    'SELECT ?v { ?v :free ?b } DURING »"10 s"^^xsd:duration': "this is not a duration: write",
    'SELECT ?v { ?v :free ?b } DURING »"P1Y"^^xsd:duration': "this is not a duration: write",
    'SELECT ?v { ?v :free ?b } DURING »"-PT1S"^^xsd:duration': "a duration must be at least 0: it",
    'SELECT ?v { ?v :free ?b } DURING "2026-01-31T12:00:00Z"^^xsd:dateTime '
    '»"2026-01-31T11:00:00Z"^^xsd:dateTime': "the end is before the beginning: exchange them",
    'SELECT ?v { ?v :free ?b } DURING "PT1S"^^xsd:duration '
    '»AT "2026-01-31T12:00:00Z"^^xsd:dateTime': "AT and DURING are both given",
}
"""Texts with » before the wrong character, and part of the reason; None for any reason."""


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_query_is_refused_with_its_place(text: str) -> None:
    plain, at = text.replace("»", ""), text.index("»")
    whole = "PREFIX : <http://kb.openrobots.org/>\n" + plain
    with pytest.raises(QueryError) as caught:
        query(kitchen(), whole)
    error = caught.value
    if WRONG[text] is None:
        return
    assert str(WRONG[text]) in error.reason
    lines = whole.split("\n")
    line = plain.count("\n", 0, at) + 2
    assert (error.line, error.column) == (line, at - (plain.rfind("\n", 0, at) + 1) + 1)
    message = str(error).splitlines()
    assert message[0] == f"line {error.line}, column {error.column}: {error.reason}"
    assert message[1].strip() == lines[line - 1].strip()
    assert message[2] == " " * (4 + error.column - 1) + "^"


TOKEN = re.compile(r"""'[^']*'|[?$]?:?\w+|\s+|.""", re.DOTALL)
TEXTS = [TOKEN.findall(text) for text, _ in (*ANSWERS.values(), *STORES.values())]
TOKENS = st.sampled_from(sorted({token for text in TEXTS for token in text}))


@settings(max_examples=100)
@given(st.sampled_from(TEXTS), st.integers(0, 99), st.lists(TOKENS, max_size=2))
def test_any_text_has_a_result_or_an_error(text: list[str], at: int, new: list[str]) -> None:
    at %= len(text)
    try:
        answer = query(kitchen(), "".join([PREFIX, *text[:at], *new, *text[at + 1 :]]))
    except QueryError:
        return
    assert isinstance(answer, (SelectResult, StoreResult, bool))


def test_errors_give_places_in_the_original_text() -> None:
    text = (
        "PREFIX : http://kb.openrobots.org/\nSELECT ?v\nWHERE\n?v :inFieldOfView human3 .\nSTORE :o"
    )
    with pytest.raises(QueryError, match="no entity and no type human3") as caught:
        query(kitchen(), text.replace("STORE :o", ""))
    assert (caught.value.line, caught.value.column) == (4, 19)
    with pytest.raises(QueryError, match="there is no property") as caught:
        query(kitchen(), text)
    assert (caught.value.line, caught.value.column) == (5, 7)


def test_a_result_with_too_many_rows_is_refused() -> None:
    catalogue = kitchen()
    text = "PREFIX : <http://kb.openrobots.org/> SELECT * { " + " . ".join(
        f"?v{i} :containsObject ?o{i}" for i in range(6)
    )
    with pytest.raises(QueryError, match="solutions: connect its patterns by variables"):
        query(catalogue, text + " }")


def test_deeply_nested_brackets_are_refused() -> None:
    text = "PREFIX : <http://kb.openrobots.org/> SELECT ?v { ?v :free ?b FILTER(" + "(" * 500
    with pytest.raises(QueryError):
        query(kitchen(), text)
    with pytest.raises(QueryError, match="nested too deeply"):
        query(kitchen(), text + "?v = ?v" + ")" * 500 + ")}")
