"""Queries on a scene whose results are counted by hand."""

from __future__ import annotations

import json
from collections import Counter
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from semmap.fields.queries import SelectResult, StoreResult, query
from semmap.fields.queries.columns import Entities, Numbers
from tests.fields.queries.arrays import PREFIX, Arrays, Listed, kitchen, prop

PAPER = """PREFIX : http://kb.openrobots.org/
SELECT ?voxels
WHERE
?voxels :inFieldOfView human1 .
?voxels :containsObject 'mug'
STORE
:containsObject
"""


def rows(text: str, catalogue: Arrays | None = None) -> SelectResult:
    answer = query(catalogue or kitchen(), PREFIX + text)
    assert isinstance(answer, SelectResult)
    return answer


def test_the_query_of_the_paper() -> None:
    answer = query(kitchen(), PAPER)
    assert isinstance(answer, StoreResult)
    assert answer.property.name == "containsObject"
    assert answer.voxels.tolist() == [[4, 4, 2], [4, 4, 3]]
    assert answer.statements.object.names == ("coffee_mug",)  # type: ignore[union-attr]
    assert answer.about == "coffee_mug"


HUMAN1 = "(:x(?v) AS ?x) (:z(?v) AS ?z)"
ANSWERS: dict[str, tuple[str, list[tuple[object, ...]]]] = {
    "all objects on top of the table": (
        "SELECT ?object { ?object :on :table1 }",
        [("mug1",), ("cup1",)],
    ),
    "objects in this person's field of view": (
        "SELECT DISTINCT ?o { ?v :inFieldOfView :human2 ; :occupiedBy ?o }",
        [("mug1",), ("cup1",)],
    ),
    "free space more than 1.2 m from everybody": (
        "SELECT ?v { ?v :free ?by . ?v :distanceToPerson ?d FILTER(?d > 1.2) }",
        [((x + 0.25, 0.25, 0.25),) for x in (2.5, 3.0, 3.5)],
    ),
    "the same where distances are limited": (
        "SELECT ?v { ?v :free ?r FILTER NOT EXISTS { ?v :distanceToPerson ?d FILTER(?d <= 1.2) } }",
        [((x + 0.25, 0.25, 0.25),) for x in (2.5, 3.0, 3.5)],
    ),
    "counts": (
        "SELECT ?o (COUNT(*) AS ?n) { ?v :occupiedBy ?o } GROUP BY ?o ORDER BY ?n",
        [("cup1", 3), ("mug1", 4), ("table1", 35)],
    ),
    "having": (
        "SELECT ?o { ?v :occupiedBy ?o } GROUP BY ?o HAVING (COUNT(?v) < 5) ORDER BY DESC(?o)",
        [("mug1",), ("cup1",)],
    ),
    "sums of no rows": (
        "SELECT (COUNT(*) AS ?n) (SUM(?d) AS ?s) (MIN(?d) AS ?m) "
        "{ ?v :distanceToPerson ?d FILTER(?d > 9) }",
        [(0, 0.0, None)],
    ),
    "groups of no rows": (
        "SELECT ?d (COUNT(*) AS ?n) { ?v :distanceToPerson ?d FILTER(?d > 9) } GROUP BY ?d",
        [],
    ),
    "numbers": (
        "SELECT (SUM(?d) AS ?s) (AVG(?d) AS ?a) (MIN(?d) AS ?l) (MAX(?d) AS ?h) "
        "{ ?v :distanceToPerson ?d }",
        [(7.0, 0.875, 0.0, 1.75)],
    ),
    "a type finds its subtypes": (
        "SELECT (COUNT(*) AS ?n) { ?v :containsObject :artifact }",
        [(42,)],
    ),
    "values stand for their subtypes": (
        "SELECT DISTINCT ?o { VALUES ?o { 'mug' :cup } ?v :containsObject ?o } ORDER BY ?o",
        [("coffee_mug",), ("cup",)],
    ),
    "a variable that is not bound": (
        "SELECT ?o ?t { VALUES (?o ?t) { ('cup1' UNDEF) ('mug1' 'table1') ('robot' UNDEF) } "
        "OPTIONAL { ?o :on ?t } } ORDER BY ?o",
        [("cup1", "table1"), ("mug1", "table1"), ("robot", None)],
    ),
    "several levels": (
        "SELECT ?n { { SELECT ?o (COUNT(?v) AS ?n) { ?v :occupiedBy ?o } GROUP BY ?o } "
        "?o :on ?t . FILTER(?n > 3) }",
        [(4,)],
    ),
    "in, not in": (
        "SELECT DISTINCT ?o { ?v :occupiedBy ?o FILTER(?o NOT IN (:cup1, 'table1')) }",
        [("mug1",)],
    ),
    "parts of names": (
        "SELECT DISTINCT ?o { ?v :occupiedBy ?o FILTER(STRSTARTS(STR(?o), 'ta') || "
        "REGEX(STR(?o), '^CUP', 'i')) } ORDER BY ?o",
        [("cup1",), ("table1",)],
    ),
    "distances": (
        "SELECT ?d { ?v :distanceToPerson 0.5 . ?w :distanceToPerson 1.75 "
        "BIND(:distance(?v, ?w) AS ?d) }",
        [(2.5,)],
    ),
    "either or": (
        "SELECT ?how (COUNT(*) AS ?n) { ?v :distanceToPerson ?d } "
        "GROUP BY (IF(?d > 1, 'far', 'near') AS ?how) ORDER BY ?how",
        [("far", 3), ("near", 5)],
    ),
    "one of some numbers": (
        "SELECT ?d { ?v :distanceToPerson ?d FILTER(?d IN (0.5, 1, 9)) } ORDER BY ?d",
        [(0.5,), (1.0,)],
    ),
    "a join keeps what is there twice": (
        "SELECT ?o { { { ?o :on :table1 } UNION { ?o :on ?t } } "
        "{ { ?o :on :table1 } UNION { ?o :on :table1 } } }",
        [("mug1",)] * 4 + [("cup1",)] * 4,
    ),
    "a condition of OPTIONAL sees both sides": (
        "SELECT ?d ?e { ?v :distanceToPerson ?d FILTER(?d < 0.5) "
        "OPTIONAL { ?w :distanceToPerson ?e FILTER(?e - ?d = 1.75) } } ORDER BY ?d",
        [(0.0, 1.75), (0.25, None)],
    ),
    "EXISTS reads variables from outside": (
        "SELECT ?d { ?v :distanceToPerson ?d "
        "FILTER NOT EXISTS { ?w :distanceToPerson ?e FILTER(?e > ?d) } }",
        [(1.75,)],
    ),
    "not near any object": (
        "SELECT ?d { ?v :distanceToPerson ?d FILTER NOT EXISTS { ?w :containsObject ?o "
        "FILTER(:distance(?v, ?w) < 1.5) } } ORDER BY ?d",
        [(0.0,)],
    ),
    "a division by 0 is not bound": (
        "SELECT (COUNT(?q) AS ?n) { ?v :distanceToPerson ?d BIND(1 / ?d AS ?q) }",
        [(7,)],
    ),
    "an error or true": (
        "SELECT (COUNT(*) AS ?n) { ?v :distanceToPerson ?d FILTER(1 / ?d > 1 || ?d = 0) }",
        [(4,)],
    ),
    "coalesce": (
        "SELECT (COALESCE(1 / ?d, -1) AS ?q) { ?v :distanceToPerson ?d } ORDER BY ?q LIMIT 1",
        [(-1.0,)],
    ),
    "limit and offset": (
        "SELECT ?d { ?v :distanceToPerson ?d } ORDER BY DESC(?d) LIMIT 2 OFFSET 1",
        [(1.5,), (1.25,)],
    ),
    "comments": ("# all\nSELECT ?o { ?o :on :table1 . # 'x' }\n }", [("mug1",), ("cup1",)]),
    # What is found so far limits what is read next; here it must not.
    "OPTIONAL in a group is evaluated before the join": (
        "SELECT (COUNT(*) AS ?n) { ?v :inFieldOfView :human2 "
        "{ ?w :distanceToPerson 0.5 OPTIONAL { ?v :distanceToPerson 0.75 } } }",
        [(0,)],
    ),
    "what is not bound is compatible with all": (
        "SELECT ?d { ?x :distanceToPerson ?d FILTER(?d < 0.5) "
        "OPTIONAL { ?v :distanceToPerson ?d FILTER(?d = 0) } { ?v :distanceToPerson 0.5 } }",
        [(0.25,)],
    ),
    "variables of a subquery are separate": (
        "SELECT (COUNT(*) AS ?n) { ?v :inFieldOfView :human2 "
        "{ ?v :inFieldOfView ?w { SELECT ?o { ?v :occupiedBy ?o . ?o :on ?t } } } }",
        [(35,)],
    ),
    "LIMIT in a subquery": (
        "SELECT (COUNT(*) AS ?n) { ?v :inFieldOfView :human2 "
        "{ SELECT ?v { ?v :occupiedBy :mug1 } ORDER BY :z(?v) LIMIT 1 } }",
        [(0,)],
    ),
    "a semicolon more": (
        "SELECT ?o { ?o :on :table1 ; . ?v :occupiedBy ?o ;; :inFieldOfView :human2 ; }",
        [("mug1",), ("cup1",)],
    ),
    "an empty group": ("SELECT (1 + 1 AS ?two) {}", [(2.0,)]),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_query_has_its_solutions(name: str) -> None:
    text, expected = ANSWERS[name]
    answer = rows(text)
    found = list(answer)
    assert Counter(found) == Counter(expected)
    if "ORDER BY" in text:
        assert found == expected
    assert json.loads(json.dumps(answer.as_json()))["variables"] == list(answer.names)


def test_ask() -> None:
    assert query(kitchen(), PREFIX + "ASK { ?o :on :table1 }") is True
    assert query(kitchen(), PREFIX + "ASK { :robot :on :table1 }") is False
    assert query(kitchen(), PREFIX + "ASK { :mug1 :on :table1 }") is True


def test_the_voxels_of_a_column() -> None:
    answer = rows("SELECT ?v ?o { ?v :inFieldOfView :human2 OPTIONAL { ?v :occupiedBy ?o } }")
    assert answer.voxels("v").dtype == np.int32
    assert {tuple(v) for v in answer.voxels("v").tolist()} == {(6, 4, 2), (7, 4, 2), (4, 4, 3)}
    assert answer.as_json()["rows"][0][0] == tuple((0.5 * (answer.voxels("v")[0] + 0.5)).tolist())
    with pytest.raises(KeyError, match=r"\?w is not one of \?v, \?o"):
        answer.voxels("w")
    with pytest.raises(TypeError, match=r"\?o is an entity"):
        answer.voxels("o")


def test_variables_are_in_the_order_of_the_text() -> None:
    assert rows("SELECT * { ?v :occupiedBy ?o . ?o :on ?t }").names == ("v", "o", "t")


STORES = {
    "a constant": ("SELECT ?v { ?v :containsObject 'artifact' } STORE :containsObject", 42),
    "a variable": ("SELECT ?v { ?v :containsObject ?o } STORE :containsObject", 42),
    "projected": ("SELECT ?v ?o { ?v :containsObject ?o } STORE :containsObject", 42),
    "either side": (
        "SELECT ?v { { ?v :containsObject :mug } UNION { ?v :containsObject ?c . "
        "?v :inFieldOfView :human2 } } STORE :containsObject",
        5,
    ),
    "numbers": ("SELECT ?v { ?v :distanceToPerson ?d } STORE :distanceToPerson", 8),
    "computed": (
        "SELECT ?v (2 * ?d AS ?e) { ?v :distanceToPerson ?d } STORE :distanceToPerson",
        8,
    ),
    "each once": (
        "SELECT ?v { ?v :containsObject :mug . ?w :containsObject :cup } STORE :containsObject",
        4,
    ),
    "before the others": (
        "SELECT ?v { ?v :distanceToPerson ?d } STORE :distanceToPerson ORDER BY ?d LIMIT 3",
        3,
    ),
    "after the others": (
        "SELECT ?v { ?v :distanceToPerson ?d } ORDER BY ?d LIMIT 3 STORE :distanceToPerson",
        3,
    ),
}


@pytest.mark.parametrize("name", STORES)
def test_store_makes_a_map_of_its_property(name: str) -> None:
    text, count = STORES[name]
    answer = query(kitchen(), PREFIX + text)
    assert isinstance(answer, StoreResult)
    assert len(answer) == len(answer.voxels) == count
    assert isinstance(answer.statements.object, Numbers if "distance" in text else Entities)


def test_store_leaves_out_rows_without_object() -> None:
    text = "SELECT ?v ?o { ?v :inFieldOfView :human2 OPTIONAL { ?v :occupiedBy ?o } } STORE "
    answer = query(kitchen(), PREFIX + text + ":occupiedBy")
    assert isinstance(answer, StoreResult)
    assert answer.voxels.tolist() == [[4, 4, 3], [6, 4, 2]]


NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


def then() -> Arrays:
    past = Arrays([Listed(prop("free"), [(1, 1, 1)], ["robot"])], {"robot": "agent"})
    now = kitchen()
    now.past = {NOON: past}
    return now


TIMES = {
    'AT "2026-01-31T12:00:00Z"^^xsd:dateTime': 1,
    'at "2026-01-31T13:00:00+01:00"^^xsd:dateTime LIMIT 5': 1,
    'LIMIT 5 DURING "2026-01-31T11:00:00Z"^^xsd:dateTime "2026-01-31T13:00:00Z"^^xsd:dateTime': 1,
    'DURING "PT10S"^^xsd:duration': 1,
    'DURING "PT1S"^^xsd:dayTimeDuration': 8,
    "": 8,
}


@pytest.mark.parametrize("clause", TIMES)
def test_queries_of_the_past(clause: str) -> None:
    catalogue = then()
    text = PREFIX + "SELECT ?v { ?v :free :robot } " + clause
    answer = query(catalogue, text, now=NOON + timedelta(seconds=5))
    assert isinstance(answer, SelectResult)
    assert len(answer) == TIMES[clause]


def test_during_counts_back_from_now() -> None:
    catalogue = then()
    text = PREFIX + 'ASK { ?v :free :robot } DURING "PT1M30S"^^xsd:duration'
    assert query(catalogue, text, now=NOON) is True
    assert catalogue.spans == [(NOON - timedelta(seconds=90), NOON)]
    query(catalogue, text)
    begin, end = catalogue.spans[-1]
    assert end - begin == timedelta(seconds=90)
    assert abs(end - datetime.now(UTC)) < timedelta(minutes=1)


def test_bound_voxels_limit_the_next_field() -> None:
    """Constants go first, and the voxels found so far go down as `within`."""
    catalogue = kitchen()
    contains, sees, *_ = catalogue.given
    assert isinstance(contains, Listed)
    assert isinstance(sees, Listed)
    query(
        catalogue,
        PREFIX + "SELECT ?o { ?v :containsObject ?o . ?v :inFieldOfView :human2 . "
        "FILTER(:x(?v) > 3 && :x(?v) < 4) }",
    )
    assert sees.withins == [None]
    assert sees.limited == [(None, ["human2"])]
    (within,) = contains.withins
    assert within is not None
    assert len(within) == 2


OPTIONAL = "SELECT * { ?v :inFieldOfView :human2 OPTIONAL { ?v :occupiedBy ?o } }"
MINUS = "SELECT * { ?v :inFieldOfView :human2 MINUS { ?v :occupiedBy ?o } }"
EXISTS = "SELECT * { ?v :inFieldOfView :human2 FILTER NOT EXISTS { ?v :occupiedBy ?o } }"


@pytest.mark.parametrize("text", [OPTIONAL, MINUS, EXISTS])
def test_bound_voxels_limit_optional_patterns(text: str) -> None:
    catalogue = kitchen()
    occupied = catalogue.given[2]
    assert isinstance(occupied, Listed)
    query(catalogue, PREFIX + text)
    (within,) = occupied.withins
    assert within is not None
    assert len(within) == 3


def test_numbers_beyond_the_largest_are_infinite() -> None:
    free = "?v :distanceToPerson ?d FILTER(?d = 1)"
    wide = f"SELECT (?d * 1e308 * 10 AS ?n) {{ {free} }}"
    assert list(rows(wide)) == [(np.inf,)]
    none = f"SELECT (ROUND(?d * 1e308 * 10) AS ?n) (?d * 1e308 * 10 * 0 AS ?m) {{ {free} }}"
    ((infinite, not_a_number),) = rows(none)
    assert infinite == np.inf
    assert np.isnan(not_a_number)
