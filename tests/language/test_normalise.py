"""The notation of the paper becomes SPARQL; SPARQL is not changed; positions are kept."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.language.normalise import normalise
from tests.fields.queries.test_query import ANSWERS, PAPER, STORES, TIMES

NORMALISED = {
    PAPER: """PREFIX : <http://kb.openrobots.org/>
SELECT ?voxels
WHERE {
?voxels :inFieldOfView :human1 .
?voxels :containsObject 'mug' }
STORE
:containsObject
""",
    "PREFIX a.b: http://x/y# BASE urn:z SELECT": "PREFIX a.b: <http://x/y#> BASE <urn:z> SELECT",
    "ASK WHERE ?v :p a1 # WHERE b\nLIMIT 3": "ASK WHERE { ?v :p :a1 } # WHERE b\nLIMIT 3",
    "select ?v where ?v :p x filter(?v > 1) order by ?v": (
        "select ?v where { ?v :p :x filter(?v > 1) } order by ?v"
    ),
    "{ SELECT ?v WHERE ?v :p book_3. } LIMIT 1": "{ SELECT ?v WHERE { ?v :p :book_3. } } LIMIT 1",
    "ASK WHERE human-1 :sees ?x OPTIONAL { ?x a robot }": (
        "ASK WHERE { :human-1 :sees ?x OPTIONAL { ?x a :robot } }"
    ),
    "INSERT DATA { mug1 :occupies 'SPHERE(0 0 0 1)'^^region }": (
        "INSERT DATA { :mug1 :occupies 'SPHERE(0 0 0 1)'^^:region }"
    ),
    r"ASK { ?v :p \u003Aa \U0000003Ab '\\u0041' }": r"ASK { ?v :p :a :b '\\u0041' }",
    "ASK { ?a sees größe }": "ASK { ?a :sees :größe }",
}


@pytest.mark.parametrize("text", NORMALISED)
def test_missing_brackets_and_colons_are_inserted(text: str) -> None:
    assert normalise(text).sparql == NORMALISED[text]


SAME = [
    *(text for text, _ in ANSWERS.values()),
    *(text for text, _ in STORES.values()),
    *(f"SELECT ?v WHERE {{ ?v :free ?b }} {clause}" for clause in TIMES),
    *(text for text in NORMALISED.values()),
    "PREFIX foaf: <http://a/b#c> SELECT ?v FROM NAMED <x> WHERE { ?v foaf:p 'it''s' } # human1",
    "SELECT ?v WHERE#\n{ ?v :p \"\"\"a 'b' \"c\" human1\"\"\" . ?v :q '''x'y''' . ?v :p 'a\\'b' }",
    "SELECT ?v { ?v :p true, false, 1.5e3, -2, .5 ; a :b . FILTER(?a<?b && STR(?c) != 'x'@en-GB) }",
    "SELECT (SUM(DISTINCT ?v) AS ?n) (COUNT(*) AS ?m) { ?v !:p/^:q|:r* _:b0 , [ ] }",
    "ASK { ?v :a.b-c:d ?w. ?w :p%20q :a\\,b. VALUES (?v) { (UNDEF) } } ORDER BY ASC(?v) DESC(?w)",
]


@pytest.mark.parametrize("text", SAME)
def test_sparql_is_not_changed(text: str) -> None:
    assert normalise(text).sparql == text


@given(st.text(alphabet="PREFIX WHERE{}()<>?v:a'\"#\\u0041\n STORE.human1", max_size=60))
def test_positions_map_to_the_original_text(text: str) -> None:
    done = normalise(text)
    places = [done.offset(i) for i in range(len(done.sparql) + 1)]
    assert places == sorted(places)
    assert places[-1] == len(text)
    kept = [i for i, place in enumerate(places[:-1]) if done.sparql[i] == text[place : place + 1]]
    inserted = len(done.sparql) - len(kept)
    assert inserted >= len(done.sparql) - len(text)
    # each character of the text is there, in its order, unless it was an escape
    if "\\" not in text:
        assert "".join(done.sparql[i] for i in _first(places, len(text))) == text


def _first(places: list[int], length: int) -> list[int]:
    """Return for each place in the old text the last place in the new text that maps to it."""
    last = {place: i for i, place in enumerate(places[:-1])}
    return [last[place] for place in range(length)]
