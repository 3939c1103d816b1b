"""Texts that the grammar has and the standard forbids are refused; similar ones are read."""

from __future__ import annotations

import pyoxigraph
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.language.error import QueryError
from semmap.language.grammar import Form
from semmap.language.parser import parse_query, parse_sparql, parse_update

PREFIX = "PREFIX : <http://example.org/>\n"
BOUND = "is bound already: take another name"
UNGROUPED = "is neither grouped by nor aggregated"
MISPLACED = "an aggregate is allowed in SELECT, HAVING and ORDER BY only"
EVERYTHING = "* cannot be used with groups"
REUSED = "is used in another pattern, too"
BLANK = "a blank node is allowed in INSERT only"
DATA = "is a variable, and data has none"

QUERIES = {
    # variables that AS binds
    "SELECT (?x AS ?y) (?z AS »?y) { ?x :p ?z }": BOUND,
    "SELECT ?y (1 AS »?y) {}": BOUND,
    "SELECT (1 AS »?y) { ?x :p ?y }": BOUND,
    "SELECT (SUM(?y) AS »?y) { ?x :p ?y }": BOUND,
    "SELECT (1 AS »?y) { { SELECT ?y { ?x :p ?y } } }": BOUND,
    "SELECT (1 AS »?y) { ?x :p ?z } VALUES ?y { 2 }": BOUND,
    "SELECT (COUNT(*) AS »?y) { ?x :p ?z } GROUP BY (?x AS ?y)": BOUND,
    "SELECT ?x { ?x :p ?y } GROUP BY (?y AS »?x)": BOUND,
    "SELECT ?x { ?x :p ?y BIND(1 AS »?y) }": BOUND,
    "SELECT ?x { { ?x :p ?z } UNION { ?x :p ?y } BIND(1 AS »?y) }": BOUND,
    "SELECT ?x { ?x :p ?z OPTIONAL { ?x :q ?y } BIND(1 AS »?y) }": BOUND,
    "ASK { GRAPH ?g { ?x :p ?y } BIND(1 AS »?g) }": BOUND,
    "ASK { ?x :p ?z FILTER EXISTS { ?x :q ?y BIND(1 AS »?y) } }": BOUND,
    "CONSTRUCT { ?x :p ?y } WHERE { ?x :q ?y BIND(1 AS »?y) }": BOUND,
    "ASK { VALUES (?x »?x) { (1 1) } }": "VALUES has ?x twice",
    # groups
    "SELECT »?y { ?x :p ?y } GROUP BY ?x": UNGROUPED,
    "SELECT »?x (COUNT(?y) AS ?n) { ?x :p ?y }": UNGROUPED,
    "SELECT (STR(»?y) AS ?s) { ?x :p ?y } GROUP BY ?x": UNGROUPED,
    "SELECT (»?y + 1 AS ?s) { ?x :p ?y } GROUP BY (?y + 1)": UNGROUPED,
    "SELECT (COUNT(?y) AS ?n) (»?n + 1 AS ?m) { ?x :p ?y }": UNGROUPED,
    "SELECT ?x { ?x :p ?y } GROUP BY ?x HAVING (»?y > 1)": UNGROUPED,
    "SELECT ?x (COUNT(?y) AS ?n) { ?x :p ?y } GROUP BY ?x HAVING (»?n > 1)": UNGROUPED,
    "SELECT ?x { ?x :p ?y } GROUP BY ?x ORDER BY »?y": UNGROUPED,
    "SELECT »?x { ?x :p ?y } ORDER BY COUNT(?y)": UNGROUPED,
    "ASK { { SELECT »?y { ?x :p ?y } GROUP BY ?x } }": UNGROUPED,
    "CONSTRUCT { ?x :q »?y } WHERE { ?x :p ?y } GROUP BY ?x": UNGROUPED,
    "DESCRIBE »?y { ?x :p ?y } GROUP BY ?x": UNGROUPED,
    "»SELECT * { ?x :p ?y } GROUP BY ?x": EVERYTHING,
    "»SELECT * { ?x :p ?y } HAVING (COUNT(*) > 1)": EVERYTHING,
    "»DESCRIBE * { ?x :p ?y } GROUP BY ?x": EVERYTHING,
    "SELECT ?x { ?x :p ?y FILTER(»COUNT(?y) > 1) }": MISPLACED,
    "SELECT ?x { ?x :p ?y BIND(»SUM(?y) AS ?s) }": MISPLACED,
    "SELECT (1 AS ?s) { ?x :p ?y } GROUP BY (»COUNT(?y))": MISPLACED,
    "SELECT (SUM(»COUNT(?y)) AS ?s) { ?x :p ?y }": MISPLACED,
    # blank nodes
    "ASK { _:a :p ?x { »_:a :q ?y } }": REUSED,
    "ASK { _:a :p ?x OPTIONAL { »_:a :q ?y } }": REUSED,
    "ASK { { _:a :p ?x } UNION { »_:a :q ?y } }": REUSED,
    "ASK { _:a :p ?x BIND(1 AS ?z) »_:a :q ?y }": REUSED,
    "ASK { _:a :p ?x FILTER EXISTS { »_:a :q ?y } }": REUSED,
    "ASK { _:a :p ?x { SELECT ?y { »_:a :q ?y } } }": REUSED,
    # COALESCE has at least one value
    "SELECT (»COALESCE() AS ?x) {}": "COALESCE() has no value",
}
"""Queries with » before the part that is wrong, and part of the reason."""

UPDATES = {
    "INSERT { ?x :p ?y } WHERE { ?x :q ?y BIND(1 AS »?y) }": BOUND,
    "INSERT { ?x :p 1 } WHERE { SELECT »?x { ?x :q ?y } GROUP BY ?y }": UNGROUPED,
    "INSERT { ?x :p 1 } WHERE { ?x :q _:a OPTIONAL { »_:a :q ?y } }": REUSED,
    "INSERT { ?x :p 1 } WHERE { ?x :q _:a } ; INSERT { ?x :r 1 } WHERE { ?x :q »_:a }": REUSED,
    "INSERT DATA { _:a :p 1 } ; INSERT DATA { »_:a :p 1 }": "is used in another INSERT DATA, too",
    "INSERT DATA { »?x :p 1 }": DATA,
    "INSERT DATA { GRAPH »?g { :a :p 1 } }": DATA,
    "DELETE DATA { :a :p »?x }": DATA,
    "DELETE DATA { »_:a :p 1 }": BLANK,
    "DELETE DATA { GRAPH :g { »_:a :p 1 } }": BLANK,
    "DELETE WHERE { »_:a :p ?x }": BLANK,
    "DELETE { »_:a :p ?x } WHERE { :b :p ?x }": BLANK,
    "DELETE { :b :p »[] } WHERE { :b :p ?x }": BLANK,
    "DELETE { :b »:p [ :q 1 ] } WHERE { :b :p ?x }": BLANK,
    "DELETE { :b »:p ( 1 ) } WHERE { :b :p ?x }": BLANK,
}

READ_QUERIES = (
    "SELECT (?x AS ?y) (?y AS ?w) { ?x :p ?z }",
    "SELECT (SUM(?y) AS ?s) { ?x :p ?y }",
    "SELECT (1 AS ?x) { { SELECT ?y { ?x :p ?y } } }",
    "SELECT (1 AS ?y) { ?x :p ?z MINUS { ?x :p ?y } FILTER EXISTS { ?x :q ?y } }",
    "SELECT ?x { ?x :p ?z { BIND(1 AS ?y) } BIND(2 AS ?w) }",
    "SELECT ?x { BIND(1 AS ?y) ?x :p ?y }",
    "ASK { { ?x :p ?y BIND(1 AS ?z) } UNION { ?x :q ?y BIND(2 AS ?z) } }",
    "SELECT ?x (COUNT(*) AS ?n) { ?x :p ?y } GROUP BY ?x HAVING (COUNT(*) > 1) ORDER BY ?n ?x",
    "SELECT ?x (STR(?x) AS ?s) { ?x :p ?y } GROUP BY (?x)",
    "SELECT ?z (?z + 1 AS ?s) { ?x :p ?y } GROUP BY (?y + 1 AS ?z)",
    "SELECT (EXISTS { ?x :q ?y } AS ?e) (MAX(?y) AS ?m) { ?x :p ?y } GROUP BY ?x",
    "SELECT * { { SELECT ?x (COUNT(?y) AS ?n) { ?x :p ?y } GROUP BY ?x } }",
    "SELECT ?x { ?x :p ?y } HAVING (?y > 1)",
    "CONSTRUCT { ?x :q _:a } WHERE { ?x :p _:a } GROUP BY ?x",
    "DESCRIBE * { ?x :p ?y }",
    "ASK { _:a :p ?x FILTER(?x > 1) _:a :q ?y . [] :p [ :q () ] . { [] :p [] } }",
)

READ_UPDATES = (
    "INSERT DATA { _:a :p 1 GRAPH :g { _:a :q [] } } ; INSERT DATA { _:b :p 1 }",
    "INSERT DATA { _:a :p 1 } ; INSERT { _:a :q ?x } WHERE { _:a :p ?x }",
    "DELETE { ?x :p 1 } INSERT { _:b :p ( 1 ) } WHERE { ?x :p [ :q _:a ] }",
    "DELETE WHERE { GRAPH ?g { ?x :p () } }",
)


def error_of(text: str, form: Form) -> QueryError | None:
    try:
        parse_sparql(text, form)
    except QueryError as error:
        return error
    return None


def forbidden(texts: dict[str, str], form: Form) -> list[tuple[str, str, Form]]:
    return [(text, reason, form) for text, reason in texts.items()]


@pytest.mark.parametrize(
    ("text", "reason", "form"), forbidden(QUERIES, "query") + forbidden(UPDATES, "update")
)
def test_a_text_is_refused_with_place_and_reason(text: str, reason: str, form: Form) -> None:
    error = error_of(PREFIX + text.replace("»", ""), form)
    assert error is not None
    assert reason in error.reason
    assert (error.line, error.column) == (2, text.index("»") + 1)


@pytest.mark.parametrize("text", READ_QUERIES)
def test_a_similar_query_is_read(text: str) -> None:
    assert error_of(PREFIX + text, "query") is None


@pytest.mark.parametrize("text", READ_UPDATES)
def test_a_similar_update_is_read(text: str) -> None:
    assert error_of(PREFIX + text, "update") is None


def test_queries_and_updates_of_fields_are_checked() -> None:
    with pytest.raises(QueryError, match="_:a is used in another pattern"):
        parse_query("ASK { _:a :free ?x OPTIONAL { _:a :free ?y } }")
    with pytest.raises(QueryError, match="a blank node is allowed in INSERT only"):
        parse_update("DELETE WHERE { _:a :occupies ?v }")


variables = st.sampled_from(["?a", "?b", "?c"])
nodes = st.one_of(variables, st.sampled_from(["_:m", "_:n", ":k", "[]", "[ :p 1 ]"]))
triples = st.builds("{} :p {} .".format, nodes, nodes)
values = st.one_of(
    variables,
    st.builds("({} + 1)".format, variables),
    st.builds("STR({})".format, variables),
)


def parts(groups: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    part = st.one_of(
        triples,
        st.builds("BIND({} AS {})".format, values, variables),
        st.builds("FILTER({} > 1)".format, values),
        st.builds("VALUES {} {{ 1 }}".format, variables),
        st.builds("FILTER EXISTS {}".format, groups),
        st.builds("{} {}".format, st.sampled_from(["", "OPTIONAL", "MINUS", "GRAPH ?b"]), groups),
        st.builds("{} UNION {}".format, groups, groups),
        st.builds("{{ {} }}".format, selects(groups)),
    )
    return st.builds("{{ {} }}".format, st.lists(part, max_size=3).map(" ".join))


def selects(groups: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    counts = st.builds("COUNT({})".format, variables)
    new = st.builds("({} AS {})".format, st.one_of(values, counts), variables)
    # oxigraph refuses a name that is given twice without AS, which the standard allows
    items = st.lists(st.one_of(variables, new), min_size=1, max_size=3).filter(
        lambda found: (
            len({name.split()[-1].strip(")") for name in found}) == len(found)
            or not {name.strip() for name in found} & {"?a", "?b", "?c"}
        )
    )
    return st.builds(
        "SELECT {} {} {}".format,
        st.one_of(st.just("*"), items.map(" ".join)),
        groups,
        st.one_of(st.just(""), st.just(""), st.builds("GROUP BY {}".format, variables)),
    )


groups = st.recursive(st.builds("{{ {} }}".format, triples), parts, max_leaves=4)
templates = st.lists(triples, min_size=1, max_size=2).map(" ".join)
requests = st.one_of(
    st.builds("{} {{ {} }}".format, st.sampled_from(["INSERT DATA", "DELETE DATA"]), templates),
    st.builds("DELETE WHERE {{ {} }}".format, templates),
    st.builds(
        "{} {{ {} }} WHERE {}".format, st.sampled_from(["DELETE", "INSERT"]), templates, groups
    ),
)


@given(selects(groups))
def test_a_query_that_oxigraph_refuses_is_refused(text: str) -> None:
    try:
        pyoxigraph.Store().query(PREFIX + text)
    except SyntaxError:
        assert error_of(PREFIX + text, "query") is not None


@given(st.lists(requests, min_size=1, max_size=2).map(" ; ".join))
def test_an_update_that_oxigraph_refuses_is_refused(text: str) -> None:
    try:
        pyoxigraph.Store().update(PREFIX + text)
    except SyntaxError:
        assert error_of(PREFIX + text, "update") is not None
