"""The prefix that a text about fields need not declare."""

from __future__ import annotations

from semmap.language.parser import parse_query, parse_update

DECLARED = "PREFIX : <urn:semmap:ontology#> "


def test_the_empty_prefix_is_that_of_the_ontology() -> None:
    text = "SELECT ?o { ?o :on :table1 }"
    assert parse_query(text).algebra == parse_query(DECLARED + text).algebra
    update = "INSERT DATA { :mug :in :kitchen }"
    assert parse_update(update).requests == parse_update(DECLARED + update).requests


def test_another_namespace_may_be_declared() -> None:
    text = "SELECT ?o { ?o :on :table1 }"
    other = parse_query("PREFIX : <http://kb.openrobots.org/> " + text)
    assert "http://kb.openrobots.org/on" in str(other.algebra)
    assert "urn:semmap:ontology" not in str(other.algebra)
