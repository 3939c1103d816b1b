"""Gives GRAPH no solution where there is no such graph (SPARQL 1.1, section 18.6)."""

from __future__ import annotations

from typing import Any

import rdflib
from rdflib.paths import Path
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.syntax_tree import nodes_in

_ANYTHING = tuple(rdflib.Variable(f"*{name}") for name in "spo")  # no text has these names


def require_graphs(algebra: Any) -> None:
    """Add to each pattern that an empty graph may match that its graph has a triple."""
    for node in nodes_in(algebra):
        if getattr(node, "name", "") == "Graph" and not _needs_a_triple(node.p):
            has_a_triple = CompValue("Builtin_EXISTS", graph=CompValue("BGP", triples=[_ANYTHING]))
            node["p"] = CompValue("Filter", expr=has_a_triple, p=node.p)


def _needs_a_triple(node: Any) -> bool:
    """Return whether a pattern has no solution in an empty graph, as far as its form tells."""
    if node.name in ("Join", "Union"):
        all_or_one = any if node.name == "Join" else all
        return all_or_one(_needs_a_triple(part) for part in (node.p1, node.p2))
    if node.name in ("LeftJoin", "Minus"):
        return _needs_a_triple(node.p1)
    if node.name in ("Extend", "Filter"):
        return _needs_a_triple(node.p)
    return node.name == "BGP" and any(not isinstance(verb, Path) for _, verb, _ in node.triples)
