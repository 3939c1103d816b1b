"""A query with names that the map does not have says so."""

from __future__ import annotations

import psycopg
import pytest
import rdflib

from semmap.knowledge.queries import query
from semmap.knowledge.updates import update
from semmap.knowledge.vocabulary import SEMMAP, TYPE, map_namespace
from semmap.knowledge.whole_graph import dump
from semmap.language.error import QueryError

UNKNOWN = (
    ("SELECT * { ?x semmap:heldby ?y }", "semmap:heldby is neither a class nor a property; "),
    ("SELECT (COUNT(*) AS ?n) { ?x a semmap:Tabel }", "semmap:Tabel is neither a class nor a"),
    ("SELECT * { ?x a type:sofaa }", "there is no type sofaa; did you mean sofa"),
    ("ASK { :tabel semmap:on ?x }", "the map has no entity tabel; did you mean table"),
    ("SELECT * { ?x semmap:on :cup%202 }", "the map has no entity cup 2; did you mean cup 1"),
    ("SELECT * { ?x a semmap:Cup OPTIONAL { ?x semmap:labl ?l } }", "semmap:labl is neither"),
    ("SELECT * { ?x semmap:heldby+ ?y }", "semmap:heldby is neither a class nor a property; "),
)


@pytest.mark.parametrize(("text", "note"), UNKNOWN)
def test_names_that_nothing_has_are_told(loft: psycopg.Connection, text: str, note: str) -> None:
    """Twice, as what is known of a text is kept."""
    for _ in range(2):
        (told,) = query(loft, text).notes
        assert told.startswith(note)


def test_no_name_of_the_graph_is_told(loft: psycopg.Connection) -> None:
    """Whatever the dump has is known, and so are functions and what is computed."""
    own = (SEMMAP, TYPE, map_namespace("loft"))
    graph = dump(loft)
    used = {str(t) for quad in graph.quads() for t in quad if isinstance(t, rdflib.URIRef)}
    names = sorted(iri for iri in used if iri.startswith(own))
    assert len(names) > 300
    values = " ".join(f"<{iri}>" for iri in names)
    assert query(loft, f"SELECT ?x {{ VALUES ?x {{ {values} }} }}").notes == ()
    computed = "SELECT ?x { ?x semmap:on :table FILTER(semmap:distance(?x, :sofa) < 100) }"
    assert query(loft, computed).notes == ()


def test_a_type_has_its_own_name_beside_that_of_its_ontology(loft: psycopg.Connection) -> None:
    """What an ontology declares later answers the same queries."""
    declared = query(loft, "SELECT ?x { ?x a semmap:Table } ORDER BY ?x").rows
    assert declared
    assert query(loft, "SELECT ?x { ?x a type:table } ORDER BY ?x").rows == declared
    by_value = "SELECT ?x { ?x a ?t FILTER(?t = type:table) } ORDER BY ?x"
    assert query(loft, by_value).rows == declared
    kept = query(loft, "SELECT ?t { :table a ?t FILTER(?t IN (type:table)) }").rows
    assert kept == ((rdflib.URIRef(f"{SEMMAP}Table"),),)


@pytest.mark.parametrize("type_", ["type:tabel", "semmap:Tabel"])
def test_an_unknown_type_is_not_stated(loft: psycopg.Connection, type_: str) -> None:
    before = query(loft, "SELECT ?x ?t { ?x a ?t } ORDER BY ?x ?t").rows
    for name in (":new", ":table"):
        with pytest.raises(QueryError, match=r"(?i)did you mean (semmap:)?table"):
            update(loft, f"INSERT DATA {{ {name} a {type_} }}")
    assert query(loft, "SELECT ?x ?t { ?x a ?t } ORDER BY ?x ?t").rows == before
