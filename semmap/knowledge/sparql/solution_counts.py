"""COUNT of a variable that each solution binds, as COUNT(*): fields need not list its values."""

from __future__ import annotations

from typing import Any

import rdflib
from rdflib.plugins.sparql.parserutils import CompValue

_PATTERNS = "p", "p1", "p2"
_KEPT = {"Distinct", "Extend", "Filter", "OrderBy", "Reduced", "Slice", "ToMultiSet"}
"""What binds all that its pattern `p` binds."""


def count_solutions(algebra: Any) -> Any:
    """Return a pattern, but for its expressions, with COUNT(*) where all solutions bind ?v."""
    if not isinstance(algebra, CompValue):
        return algebra
    found = algebra.clone()
    for name in _PATTERNS:
        if name in found:
            found[name] = count_solutions(found[name])
    if found.name == "AggregateJoin":
        bound = _bound(found.p.p)
        found["A"] = [_counted(each, bound) for each in found.A]
    return found


def _counted(aggregate: Any, bound: set[rdflib.Variable]) -> Any:
    plain = aggregate.name == "Aggregate_Count" and not aggregate.distinct
    if not (plain and _is_variable(aggregate.vars) and aggregate.vars in bound):
        return aggregate
    found = aggregate.clone()
    found["vars"] = "*"
    return found


def _bound(node: Any) -> set[rdflib.Variable]:
    """The variables that have a value in each solution, as far as the form of a pattern tells."""
    if node.name == "BGP":
        return {part for triple in node.triples for part in triple if _is_variable(part)}
    if node.name == "Join":
        return _bound(node.p1) | _bound(node.p2)
    if node.name == "Union":
        return _bound(node.p1) & _bound(node.p2)
    if node.name in ("LeftJoin", "Minus"):
        return _bound(node.p1)
    if node.name == "Graph":
        return _bound(node.p) | ({node.term} if _is_variable(node.term) else set())
    if node.name in ("Project", "SelectQuery"):
        return _bound(node.p) & set(node.PV)
    return _bound(node.p) if node.name in _KEPT else set()


def _is_variable(part: Any) -> bool:
    return isinstance(part, rdflib.Variable)
