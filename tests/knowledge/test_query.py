"""Answers are those of oxigraph on the dump of the graph, and of rdflib where it follows SPARQL."""

from __future__ import annotations

import operator
from collections import Counter

import psycopg
import pytest

from semmap.knowledge.queries import KnowledgeError, query
from tests.knowledge.engines import Engines, comparable

EX = "PREFIX ex: <http://example.org/>\n"

QUERIES = (
    # basic graph patterns
    "SELECT ?x ?n { ?x a semmap:Table ; semmap:name ?n }",
    'SELECT ?x ?p ?o { ?x semmap:name "table" . ?x ?p ?o }',
    "SELECT ?x ?h { ?x a semmap:Cup ; semmap:heldBy ?h . ?h a semmap:Table }",
    "SELECT ?s ?p { ?s ?p :table }",
    "SELECT ?s ?o { ?s ex:likes ?o }",
    "SELECT ?s ?o { ?s ex:likes ?o . ?o a semmap:Cup }",
    "SELECT ?s ?t { ?s a ?t . ?s ex:servedIn ?c }",
    'SELECT ?s { ?s ex:likes "tea"@en }',
    "SELECT ?s { ?s ex:likes 5 }",
    'SELECT ?s { ?s prop:colour "red" }',
    "SELECT ?s { ?s prop:fixed true }",
    "SELECT ?s ?v { ?s prop:mass ?v }",
    "SELECT ?s ?k ?v { ?s a semmap:Cup ; ?k ?v FILTER(STRSTARTS(STR(?k), STR(prop:))) }",
    "SELECT ?a ?b { ?a rel:beside ?b }",
    "SELECT ?r { :table ?r :sofa }",
    "SELECT ?x { ?x a bot:Space }",
    "SELECT ?x { ?x foaf:knows ?x }",
    "SELECT ?x ?y { ?x foaf:knows ?y . ?y foaf:knows ?x }",
    "SELECT ?x ?l { ?x rdfs:label ?l }",
    "SELECT ?p (COUNT(*) AS ?n) { ?s ?p ?o } GROUP BY ?p",
    "SELECT ?s { ?s <http://nowhere/at#all> ?o }",
    "SELECT * { :unknown ?p ?o }",
    "SELECT ?x { ?x semmap:heldBy [ a semmap:Room ] }",
    # Named graphs, and datasets of them
    "SELECT ?g { GRAPH ?g {} }",
    "SELECT ?g ?x ?y { GRAPH ?g { ?x ex:likes* ?y } }",
    "SELECT ?x { GRAPH ?g { { SELECT ?x { ?x ?g ?y } } } }",
    "SELECT ?g ?x ?h { GRAPH ?g { ?x ex:likes ?y OPTIONAL { ?z semmap:heldBy ?h } } }",
    "SELECT * FROM ex:archive { ?s ?p ?o }",
    "SELECT * FROM ex:archive FROM :ann_believes { ?s ?p ?o }",
    "SELECT * FROM NAMED ex:archive { { ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } } }",
    "SELECT * FROM ex:archive FROM NAMED :ann_believes { ?s ?p ?o "
    "GRAPH :ann_believes { ?t ?q ?s } }",
    "SELECT * FROM ex:archive FROM NAMED :ann_believes { GRAPH ex:archive { ?s ?p ?o } }",
    "SELECT ?x FROM ex:archive { ?x a semmap:Room }",
    "SELECT ?x FROM ex:archive { ?x semmap:on|semmap:name ?y }",
    # OPTIONAL, UNION, MINUS, EXISTS
    "SELECT ?x ?l { ?x a semmap:Room OPTIONAL { ?x rdfs:label ?l } }",
    "SELECT ?x ?c ?m { ?x a semmap:Object OPTIONAL { ?x prop:colour ?c OPTIONAL { ?x prop:mass ?m "
    "FILTER(?m > 1) } } }",
    "SELECT ?x ?c { ?x a semmap:Object OPTIONAL { ?x prop:colour ?c FILTER(?x != :table) } }",
    "SELECT ?x ?l ?y { ?x a semmap:Object OPTIONAL { ?x prop:colour ?l } OPTIONAL { ?y "
    "prop:colour ?l } }",
    "SELECT ?x ?n { { ?x a semmap:Sofa } UNION { ?x a semmap:Room ; semmap:name ?n } }",
    "SELECT ?x { ?x a semmap:Object MINUS { ?x prop:colour ?c } }",
    "SELECT ?x { ?x a semmap:Object MINUS { ?y prop:colour ?c } }",
    "SELECT ?x ?c { ?x a semmap:Object OPTIONAL { ?x prop:colour ?c } MINUS { ?x prop:mass ?m . "
    '?x prop:colour "red" } }',
    "SELECT ?x { ?x a semmap:Object FILTER NOT EXISTS { ?x prop:colour ?c } }",
    "SELECT ?x { ?x a semmap:Object FILTER EXISTS { ?y semmap:heldBy ?x . ?y a semmap:Cup } }",
    "SELECT ?x { ?x a semmap:Object FILTER NOT EXISTS { ?y semmap:heldBy ?x FILTER(?y = :cup%201) "
    "FILTER NOT EXISTS { ?y prop:colour ?c FILTER(?x = :sofa) } } }",
    "SELECT ?x { ?x semmap:z ?z FILTER EXISTS { ?y semmap:z ?w FILTER(?w > ?z) } }",
    "SELECT ?x { { ?x a semmap:Cup } { ?x prop:colour ?c } { ?x prop:mass ?c } }",
    # FILTER and BIND
    'SELECT ?x { ?x semmap:name ?n FILTER REGEX(?n, "^S", "i") }',
    "SELECT ?x ?m { ?x prop:mass ?m FILTER(?m >= 1) }",
    "SELECT ?x ?m { ?x prop:mass ?m FILTER(?m = 1.0) }",
    "SELECT ?x ?z { ?x semmap:z ?z FILTER(?z > 0 && ?z < 1) }",
    "SELECT ?x ?f { ?x prop:fixed ?f FILTER(?f = true) }",
    'SELECT ?x { ?x semmap:name ?n FILTER(?n IN ("table", "sofa")) }',
    'SELECT ?x { ?x semmap:name ?n FILTER(?n NOT IN ("table", "sofa")) }',
    'SELECT ?x ("h" IN () AS ?i) { ?x semmap:name ?n FILTER(?n NOT IN ()) }',
    "SELECT ?o { :ann ex:likes ?o FILTER(isLITERAL(?o)) }",
    "SELECT ?o { :ann ex:likes ?o FILTER(isIRI(?o)) }",
    "SELECT ?o { :ann ex:likes ?o FILTER(isNUMERIC(?o)) }",
    "SELECT ?o { :ann ex:likes ?o FILTER(?o > 3) }",
    "SELECT ?o { :ann ex:likes ?o FILTER(!(?o > 3)) }",
    "SELECT ?o { :ann ex:likes ?o FILTER(?o = 5 || ?o = ex:coffee) }",
    'SELECT ?o { :ann ex:likes ?o FILTER(LANG(?o) = "") FILTER(?o) }',
    'SELECT ?o { :ann ex:likes ?o FILTER(LANG(?o) = "de") }',
    'SELECT ?o { :ann ex:likes ?o FILTER(LANGMATCHES(LANG(?o), "*")) }',
    "SELECT ?o (DATATYPE(?o) AS ?d) { :ann ex:likes ?o }",
    "SELECT ?o (STR(?o) AS ?s) { :ann ex:likes ?o }",
    'SELECT ?o (STRBEFORE(?o, "a"@de) AS ?b) (STRAFTER(?o, "a"@en) AS ?a) { :ann ex:likes ?o }',
    'SELECT ?o (CONTAINS(?o, "e"@de) AS ?c) (STRSTARTS(?o, "t") AS ?s) { :ann ex:likes ?o }',
    'SELECT ?o (STRLANG(?o, "fr") AS ?l) (STRDT(?o, xsd:string) AS ?d) { :ann ex:likes ?o }',
    "SELECT ?o (xsd:float(?o) AS ?f) (xsd:float(?o) + 1 AS ?g) { :ann ex:likes ?o }",
    'SELECT ?o { :ann ex:likes ?o FILTER(?o != "tea"^^xsd:integer) }',
    'BASE <http://base.org/> SELECT (IRI("a/b") AS ?i) (IRI("urn:x") AS ?j) {}',
    "SELECT ?o (?o + 1 AS ?s) (?o / 2 AS ?h) (-?o AS ?n) { :ann ex:likes ?o }",
    "SELECT ?x (?m * 2 AS ?d) { ?x prop:mass ?m }",
    'SELECT ?x (CONCAT(?n, "-", ?n) AS ?s) (STRLEN(?n) AS ?l) (UCASE(?n) AS ?u) { ?x a '
    "semmap:Cup ; semmap:name ?n }",
    'SELECT ?n (STRBEFORE(?n, " ") AS ?a) (STRAFTER(?n, " ") AS ?b) (SUBSTR(?n, 2, 3) AS ?c) '
    "(ENCODE_FOR_URI(?n) AS ?d) { ?x semmap:name ?n }",
    'SELECT ?n (REPLACE(?n, "([aeiou])", "<$1>") AS ?r) { ?x semmap:name ?n }',
    'SELECT ?n { ?x semmap:name ?n FILTER(CONTAINS(?n, "t") && !STRENDS(?n, "e")) }',
    'SELECT ?x ?k { ?x semmap:kind ?k BIND(IF(?k = "room", 1, 2) AS ?i) FILTER(?i = 1) }',
    "SELECT ?x ?v { ?x a semmap:Object OPTIONAL { ?x prop:colour ?c } BIND(COALESCE(?c, "
    '"none") AS ?v) }',
    "SELECT ?x ?b { ?x a semmap:Object OPTIONAL { ?x prop:colour ?c } BIND(BOUND(?c) AS ?b) }",
    'SELECT ?x { ?x ex:born ?t FILTER(?t < "2000-01-01T00:00:00Z"^^xsd:dateTime) }',
    "SELECT ?a (ABS(?z - 1) AS ?b) (CEIL(?z) AS ?c) (FLOOR(?z) AS ?d) { ?a semmap:highest ?z }",
    "SELECT (xsd:integer(?n) AS ?i) (xsd:decimal(?n) AS ?d) (xsd:boolean(?n) AS ?b) "
    '{ VALUES ?n { "1" "0" "x" 2 true "12.5" } }',
    'SELECT (STRDT("5", xsd:integer) + 1 AS ?a) (STRLANG("x", "en") AS ?b) (IRI("http://a/b") '
    "AS ?c) {}",
    'SELECT (MD5("abc") AS ?a) (SHA256("abc") AS ?b) {}',
    "SELECT ?x ?o { ?x ex:likes ?o FILTER(sameTerm(?o, ex:coffee)) }",
    "SELECT ?y { ?x semmap:since ?t ; a semmap:Sofa BIND(YEAR(?t) > 2000 AS ?y) }",
    "SELECT ?x { ?x ex:likes ?o FILTER(?nothing > 1) }",
    # paths
    "SELECT ?x ?y { ?x semmap:heldBy+ ?y }",
    "SELECT ?y { :cup%201 semmap:heldBy+ ?y }",
    "SELECT ?x { ?x semmap:heldBy+ :studio }",
    "SELECT ?x ?y { ?x a semmap:Cup ; semmap:heldBy* ?y }",
    "SELECT ?x ?y { ?x a semmap:Cup ; semmap:heldBy? ?y }",
    "SELECT ?x ?y { ?x semmap:heldBy/semmap:heldBy ?y }",
    "SELECT ?x ?y { ?x ^semmap:heldBy ?y . ?x a semmap:Room }",
    "SELECT ?x ?y { ?x (semmap:heldBy|rel:beside) ?y }",
    "SELECT ?x ?y { :ann (foaf:knows|ex:likes)+ ?y }",
    "SELECT ?x ?y { ?x (rel:beside/^semmap:heldBy)+ ?y }",
    "SELECT ?y { :ann !(rdf:type|ex:likes) ?y }",
    "SELECT ?y { ex:thing !(^ex:likes) ?y }",
    # a term that no statement has
    "SELECT ?x ?o { ?x ex:likes ?o FILTER(?x != ex:nobody) }",
    "SELECT ?x ?y { GRAPH ?g { ?x !(ex:nobody) ?y } }",
    "SELECT ?x { ?x ex:likes ?o FILTER(?x IN (ex:nobody, :ann) || ?g = ex:nobody) }",
    "SELECT ?x ?p { ?x ?p 'said by nobody' }",
    "SELECT ?x ?y { ?x ex:likes ?o BIND(ex:nobody AS ?y) OPTIONAL { ?y ex:likes ?o } }",
    "SELECT DISTINCT ?x ?y { ?x !(^ex:likes|ex:age|^rdf:type) ?y FILTER(isIRI(?x) && isIRI(?y)) }",
    "SELECT ?t { semmap:DiningTable rdfs:subClassOf+ ?t }",
    "SELECT ?x { ?x a/rdfs:subClassOf* ex:Liquid }",
    "SELECT ?x { :unknown semmap:heldBy* ?x }",
    "ASK { :cup%201 semmap:heldBy+ :studio }",
    # VALUES, subqueries, aggregates, modifiers
    "SELECT ?x ?k { VALUES ?x { :table :sofa :unknown } ?x semmap:kind ?k }",
    'SELECT ?x ?k { VALUES (?x ?k) { (:table UNDEF) (UNDEF "room") } ?x semmap:kind ?k }',
    'SELECT ?v { VALUES ?v { 1 "a" :table ex:z } }',
    "SELECT ?h (COUNT(?x) AS ?n) { ?x semmap:heldBy ?h } GROUP BY ?h HAVING(COUNT(?x) > 1)",
    "SELECT (COUNT(*) AS ?n) (COUNT(DISTINCT ?h) AS ?m) { ?x semmap:heldBy ?h }",
    "SELECT (COUNT(*) AS ?n) (SUM(?v) AS ?s) (AVG(?v) AS ?a) { ?x a semmap:Piano ; prop:mass ?v }",
    "SELECT (SUM(?m) AS ?s) (AVG(?m) AS ?a) (MIN(?m) AS ?i) (MAX(?m) AS ?j) { ?x prop:mass ?m }",
    "SELECT (SUM(?z) AS ?s) (AVG(?z) AS ?a) (MIN(?z) AS ?i) (MAX(?z) AS ?j) { ?x semmap:z ?z }",
    "SELECT (MIN(?n) AS ?i) (MAX(?n) AS ?j) { ?x semmap:name ?n }",
    "SELECT ?k (SUM(STRLEN(?n)) AS ?s) { ?x semmap:kind ?k ; semmap:name ?n } GROUP BY ?k",
    "SELECT ?l (COUNT(*) AS ?n) { ?x semmap:name ?m } GROUP BY (STRLEN(?m) AS ?l)",
    "SELECT ?c (COUNT(*) AS ?n) { ?x prop:colour ?c } GROUP BY (?c)",
    "SELECT (COUNT(*) AS ?n) { ?x prop:mass ?m } GROUP BY (?m > 1)",
    "SELECT ?x ?z { { SELECT ?x { ?x semmap:highest ?z } ORDER BY DESC(?z) ?x LIMIT 3 } ?x "
    "semmap:z ?z }",
    "SELECT ?x ?n { ?x a semmap:Room { SELECT ?x (COUNT(*) AS ?n) { ?y semmap:heldBy ?x } GROUP "
    "BY ?x } }",
    "SELECT DISTINCT ?t { ?x semmap:heldBy ?y . ?y semmap:directType ?t }",
    "SELECT ?n { ?x semmap:name ?n } ORDER BY DESC(?n) LIMIT 3 OFFSET 1",
    "SELECT DISTINCT ?k { ?x semmap:kind ?k } ORDER BY ?k LIMIT 2",
    "SELECT ?x { ?x a semmap:Cup } VALUES ?x { :table :cup%201 }",
    # named graphs
    "SELECT ?s ?o { GRAPH :ann_believes { ?s ?p ?o } }",
    "SELECT ?g ?o { GRAPH ?g { :bob ex:likes ?o } }",
    "SELECT ?g ?t { GRAPH ?g { ?x semmap:heldBy ?h } ?x a ?t . ?t rdfs:subClassOf ?u }",
    "ASK { GRAPH ?g {} }",
    "ASK FROM ex:archive { GRAPH ?g {} }",
    # CONSTRUCT and ASK
    "CONSTRUCT { ?y ex:has ?x } { ?x semmap:heldBy ?y }",
    "CONSTRUCT WHERE { ?x a semmap:Cup ; semmap:heldBy ?y }",
    "CONSTRUCT { ?x ex:n [ ex:v ?o ] } { ?x ex:likes ?o }",
    "ASK { ?x a semmap:Cup }",
    "ASK { ?x a semmap:Piano }",
    # the T-Box
    "SELECT ?c { ?c a owl:Class ; rdfs:subClassOf semmap:Table }",
    "SELECT ?c ?l { semmap:Cup rdfs:label ?l ; rdfs:subClassOf ?c }",
)

RDFLIB_DIFFERS = (
    "MIN(?n) AS ?i",  # gives no datatype to strings
    "!(rdf:type",
    "!(^ex:likes",  # loses the property
    "?o > 3",  # orders numbers and strings
    "xsd:boolean(?n)",
    "(?m * 2",
    "?o / 2",
    "prop:mass ?m }",
    "ex:n [",
    "CEIL(?z)",
    "BIND(YEAR",
    "VALUES (?x ?k)",
    "STRLANG(?o",
    "xsd:float(?o)",
    '"tea"^^xsd:integer',
    "GROUP BY (?c)",  # evaluates None
)
"""Where rdflib's types or errors are not those of SPARQL 1.1: oxigraph alone is the oracle."""

OXIGRAPH_DIFFERS = (":unknown semmap:heldBy*",)
"""Where oxigraph has no path of length 0 from a term that no fact has: rdflib is the oracle."""


@pytest.mark.parametrize("text", QUERIES, ids=range(len(QUERIES)))
def test_answers_are_those_of_other_engines(
    loft: psycopg.Connection, engines: Engines, text: str
) -> None:
    answer = query(loft, EX + text)
    assert not answer.explanation[0].startswith("evaluated by rdflib")
    found = comparable(answer)
    if not any(part in text for part in OXIGRAPH_DIFFERS):
        assert found == engines.oxigraph(EX + text)
    if not any(part in text for part in RDFLIB_DIFFERS):
        assert found == engines.rdflib(EX + text)


IN_A_GRAPH = (
    "{}",
    "{ VALUES ?x { 1 } }",
    "{ BIND(1 AS ?x) }",
    "{ :bob ex:likes* ?x }",
    "{ OPTIONAL { ?x ex:nothing ?y } }",
    "{ ?x ex:likes ?y OPTIONAL { ?x ex:nothing ?z } FILTER(?x = :bob) BIND(1 AS ?w) }",
    "{ { ?x ex:likes ?y } UNION {} }",
    "{ SELECT (COUNT(*) AS ?n) { ?x ex:nothing ?y } }",
    "{ GRAPH ex:archive { ?x ex:likes ?y } }",
)


@pytest.mark.parametrize("pattern", IN_A_GRAPH)
@pytest.mark.parametrize("graph", ["ex:archive", ":ann_believes", "ex:nowhere"])
@pytest.mark.parametrize("dataset", ["", "FROM NAMED ex:archive"])
def test_a_graph_that_is_not_there_has_no_solution(
    loft: psycopg.Connection, engines: Engines, pattern: str, graph: str, dataset: str
) -> None:
    text = f"{EX} SELECT * {dataset} {{ GRAPH {graph} {pattern} }}"
    expected: Counter[object] = Counter()
    # Where there is no such graph, oxigraph reads an empty one.
    if engines.oxigraph(f"{EX} ASK {dataset} {{ GRAPH ?g {{}} FILTER(?g = {graph}) }}"):
        expected = engines.oxigraph(text)
    assert comparable(query(loft, text)) == expected
    inside = f"{EX} ASK {dataset} {{ FILTER EXISTS {{ GRAPH {graph} {pattern} }} }}"
    assert query(loft, inside).truth == bool(expected)
    by_rdflib = f"{EX} ASK {dataset} {{ GRAPH {graph} {pattern} FILTER(TZ(NOW()) = 'Z') }}"
    assert query(loft, by_rdflib).truth == bool(expected)
    assert query(
        loft, inside.replace("EXISTS {", "EXISTS { BIND(TZ(NOW()) AS ?now) ")
    ).truth == bool(expected)


@pytest.mark.parametrize("graphs", ["", "FROM NAMED ex:archive"])
def test_rdflib_lists_the_graphs(loft: psycopg.Connection, engines: Engines, graphs: str) -> None:
    text = f"{EX} SELECT ?g {graphs} {{ GRAPH ?g {{}} FILTER(%s) }}"
    found = comparable(query(loft, text % "TZ(NOW()) = 'Z'"))
    assert found == engines.oxigraph(text % "true")


def test_labels_are_nodes_of_one_solution(loft: psycopg.Connection) -> None:
    text = "SELECT (BNODE('a') AS ?x) (BNODE('a') AS ?y) (BNODE('b') AS ?z) { VALUES ?i { 1 1 2 } }"
    for each in (
        text,
        text.replace("SELECT", "SELECT ?i ?s ?t").replace(
            "} }", "} BIND(BNODE('a') AS ?s) BIND(BNODE('a') AS ?t) }"
        ),
    ):
        rows = [row[-3:] for row in query(loft, each).rows]
        assert all(x == y != z for x, y, z in rows)
        assert len({term for row in rows for term in row}) == 6


PATTERNS = (
    ("REGEX(?v, 'a.b')", "false"),
    ("REGEX(?v, 'a.b', 's')", "true"),
    ("REGEX(?v, 'a[^.]b')", "true"),
    ("REPLACE(?v, '.', '-')", "-\n-"),
    ("REPLACE(?v, '.', '-', 's')", "---"),
    ("REPLACE(?v, 'A', '-', 'i')", "-\nb"),
)


@pytest.mark.parametrize(("call", "expected"), PATTERNS)
@pytest.mark.parametrize("more", ["", "FILTER(TZ(NOW()) = 'Z')"], ids=["sql", "rdflib"])
def test_a_dot_matches_no_newline(
    loft: psycopg.Connection, call: str, expected: str, more: str
) -> None:
    answer = query(loft, f"SELECT ({call} AS ?x) {{ VALUES ?v {{ 'a\\nb' }} {more} }}")
    assert answer.explanation[0].startswith("evaluated by rdflib") == bool(more)
    assert [str(x) for (x,) in answer.rows] == [expected]


SUMS = (
    "1e308 1e308",
    "-1e308 -1e308 5e0",
    "1e200 3e200",
    "1e300 -1e300 5e0",
    "1e308 2.5",
    "1e0 1e-300",
    "'INF'^^xsd:double 1e0",
)


@pytest.mark.parametrize("numbers", SUMS)
@pytest.mark.parametrize("number", ["?n", "xsd:double(?n)"])
def test_a_sum_beyond_a_double_is_infinite(
    loft: psycopg.Connection, engines: Engines, numbers: str, number: str
) -> None:
    values = " ".join(f"(1 {each})" for each in numbers.split())
    text = (
        f"SELECT ?g (SUM({number}) AS ?sum) (AVG({number}) AS ?mean) "
        f"(SUM(DISTINCT {number}) AS ?once) {{ VALUES (?g ?n) {{ {values} (2 1e0) }} }} GROUP BY ?g"
    )
    assert comparable(query(loft, text)) == engines.oxigraph(text)


@pytest.mark.parametrize(("pattern", "count"), [("", 1), ("FILTER(false)", 0), (":a :b :c", 0)])
def test_solutions_without_variables_are_counted(
    loft: psycopg.Connection, pattern: str, count: int
) -> None:
    answer = query(loft, f"SELECT (COUNT(DISTINCT *) AS ?n) {{ {pattern} }}")
    assert [int(n) for (n,) in answer.rows] == [count]


def test_the_order_of_solutions_is_kept(loft: psycopg.Connection) -> None:
    names = [str(n) for (n,) in query(loft, "SELECT ?n { ?x semmap:name ?n } ORDER BY ?n").rows]
    assert names == sorted(names)
    heights = query(loft, "SELECT ?z { ?x semmap:highest ?z } ORDER BY DESC(?z)").rows
    values = [z.toPython() for (z,) in heights]
    assert values == sorted(values, reverse=True)
    assert values[0] > values[-1]


def test_an_entity_of_another_map_is_not_seen(loft: psycopg.Connection) -> None:
    for text in (
        '{ ?x semmap:name "only here" }',
        "{ ?x semmap:z 4.0 }",
        "{ ?x semmap:heldBy ?y FILTER(CONTAINS(STR(?x), 'only')) }",
    ):
        assert query(loft, f"ASK {text}").truth is False


def test_describe_has_all_facts_about_a_resource(
    loft: psycopg.Connection, engines: Engines
) -> None:
    answer = query(loft, "DESCRIBE :table ?x { ?x a semmap:Sofa }")
    expected = engines.oxigraph("CONSTRUCT { ?x ?p ?o } { VALUES ?x { :table :sofa } ?x ?p ?o }")
    assert comparable(answer) == expected
    assert len(expected) > 30


def test_describe_all_describes_each_variable(loft: psycopg.Connection) -> None:
    found, expected = (
        comparable(query(loft, f"DESCRIBE {names} {{ ?x a semmap:Cup ; semmap:heldBy ?h }}"))
        for names in ("*", "?x ?h")
    )
    assert found == expected
    assert len(found) > 30


def test_what_sql_cannot_translate_is_evaluated_by_rdflib(
    loft: psycopg.Connection, engines: Engines
) -> None:
    text = "SELECT ?x (TZ(?t) AS ?z) { ?x <http://example.org/born> ?t }"
    answer = query(loft, text)
    assert "TZ" in answer.explanation[0]
    assert comparable(answer) == engines.oxigraph(text)
    assert len(answer.rows) == 1


def test_the_notation_of_the_paper_is_read(loft: psycopg.Connection) -> None:
    text = "PREFIX : <http://kb.openrobots.org/>\nSELECT ?x WHERE ?x :isOn table"
    names = sorted(str(x).rsplit("#", 1)[1] for (x,) in query(loft, text).rows)
    assert names == ["cup%201", "tasse%20%CE%B2"]


def test_the_distance_of_a_computed_iri(loft: psycopg.Connection) -> None:
    """An entity is known by its IRI, too; other IRIs have no distance."""
    near = "SELECT ?x { ?x a semmap:Cup FILTER(semmap:distance(%s, :table) < 1) }"
    by_entity = query(loft, near % "?x").rows
    assert by_entity
    assert query(loft, near % "IRI(STR(?x))").rows == by_entity
    assert query(loft, near % 'IRI(CONCAT(STR(?x), "%FF"))').rows == ()


COMPARED = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}


@pytest.mark.parametrize(("sign", "turned"), [("<", ">"), ("<=", ">="), (">", "<"), (">=", "<=")])
def test_distances_are_compared_by_surfaces(
    loft: psycopg.Connection, sign: str, turned: str
) -> None:
    """However a query writes it, and without the distance where a comparison is enough."""
    rows = query(
        loft,
        "SELECT ?a ?b (semmap:distance(?a, ?b) AS ?d) { ?a semmap:kind ?k . ?b semmap:kind ?k }",
    ).rows
    metres = {(a, b): float(d) for a, b, d in rows if d is not None}
    assert len(set(metres.values())) > 10
    assert len(metres) < len(rows), "some are in no place"
    steps = sorted({round(d, 6) for d in metres.values()})
    limits = [0.0, steps[len(steps) // 2] + 1e-4, -1.0]
    for far in limits:
        expected = {pair for pair, d in metres.items() if COMPARED[sign](d, far)}
        for condition in (
            f"FILTER(semmap:distance(?a, ?b) {sign} {far})",
            f"FILTER({far}e0 {turned} semmap:distance(?a, ?b))",
            f"BIND(semmap:distance(?a, ?b) AS ?d) FILTER(?d {sign} {far})",
            f"FILTER(!(!(semmap:distance(?a, ?b) {sign} {far})))",
        ):
            text = f"SELECT ?a ?b {{ ?a semmap:kind ?k . ?b semmap:kind ?k . {condition} }}"
            answer = query(loft, text)
            assert "is_nearer" in answer.explanation[0]
            assert {(a, b) for a, b in answer.rows} == expected


def test_a_wide_answer_may_have_fewer_rows(loft: psycopg.Connection) -> None:
    """The limit of rows is one of values, too: those of ten columns."""
    more = " ".join(f"BIND({k} AS ?c{k})" for k in range(19))
    rows = len(query(loft, "SELECT ?x { ?x semmap:name ?n }").rows)
    assert rows > 4
    narrow = f"SELECT ?x ?c1 {{ ?x semmap:name ?n . {more} }}"
    assert len(query(loft, narrow, rows=rows).rows) == rows
    with pytest.raises(KnowledgeError, match=f"more than {10 * rows // 21:,} rows"):
        query(loft, f"SELECT * {{ ?x semmap:name ?n . {more} }}", rows=rows)


def test_an_explanation_has_the_plan_where_it_is_asked_for(loft: psycopg.Connection) -> None:
    text = "SELECT ?x { ?x a semmap:Sofa }"
    with_plan = query(loft, text, plan=True)
    assert with_plan.rows == query(loft, text).rows
    sql, plan = with_plan.explanation
    assert sql.startswith("SELECT")
    assert "object_type" in plan
    assert "Execution Time" in plan
    assert query(loft, text).explanation == (sql,)
    why, sql, plan = query(
        loft, "SELECT (BNODE(?x) AS ?n) { ?x a semmap:Sofa }", plan=True
    ).explanation
    assert why.startswith("evaluated by rdflib, because")
    assert "Execution Time" in plan
