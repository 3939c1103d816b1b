"""Checks of SPARQL 1.1 beyond its grammar: scopes, groups, blank nodes (11.4, 18.2, 19.6, 19.8)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import rdflib
from pyparsing import ParseResults
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.normalise import NormalisedText
from semmap.language.terms import EVERYTHING, position_of

_MISPLACED = (
    "an aggregate is allowed in SELECT, HAVING and ORDER BY only, and not within another aggregate"
)


class ScopeChecker:
    """Checks one text whose names are resolved; its methods raise QueryError."""

    def __init__(self, text: NormalisedText) -> None:
        self._text = text
        # for each blank node the basic graph pattern, and the INSERT DATA, that has its label
        self._patterns: dict[rdflib.BNode, object] = {}
        self._inserted: dict[rdflib.BNode, object] = {}

    def check_query(self, tree: Any) -> set[str]:
        """Check a query; return the variables that it projects."""
        return self._select(tree)

    def check_request(self, request: Any) -> None:
        """Check one request of an update, after those before it."""
        name = request.name
        if name in ("InsertData", "DeleteData"):
            reason = "?{} is a variable, and data has none: use INSERT or DELETE with WHERE"
            self._refuse(request.quads, rdflib.Variable, reason)
        if name in ("DeleteData", "DeleteWhere", "Modify"):
            reason = "a blank node is allowed in INSERT only: use a variable and WHERE"
            deleted = request.delete if name == "Modify" else request.quads
            self._refuse(deleted, rdflib.BNode, reason)
        if name == "InsertData":
            self._expect_own_labels(request.quads, request, self._inserted, "INSERT DATA")
        if name == "Modify":
            self._group(request.where)

    def _refuse(self, tree: Any, kind: type, reason: str) -> None:
        near = 0  # the grammar gives the nodes of [...] and (...) no position
        for node in _nodes(tree):
            near = position_of(node) or near
            if isinstance(node, kind):
                raise self._text.error(reason.format(node), near)

    def _expect_own_labels(
        self, tree: Any, owner: object, known: dict[rdflib.BNode, object], kind: str
    ) -> None:
        for node in _nodes(tree):
            if isinstance(node, rdflib.BNode) and known.setdefault(node, owner) is not owner:
                reason = f"_:{node} is used in another {kind}, too: take another label"
                raise self._text.error(reason, position_of(node) or 0)

    def _group(self, tree: Any) -> set[str]:
        """Check a group; return the variables that are in scope after it (section 18.2.1)."""
        if tree.name == "SubSelect":
            return self._select(tree)
        bound: set[str] = set()
        pattern = object()  # a basic graph pattern ends at all parts but FILTER (5.1.1)
        for part in tree.part or ():
            if part.name == "TriplesBlock":
                self._expect_own_labels(part.triples, pattern, self._patterns, "pattern")
                bound |= _variables(part.triples)
            elif part.name == "Filter":
                self._expression(part.expr)
            else:
                pattern = object()
                bound |= self._part(part, bound)
        return bound

    def _part(self, part: Any, bound: set[str]) -> set[str]:
        if part.name == "Bind":
            self._expression(part.expr)
            self._expect_new(part.var, bound)
            return {str(part.var)}
        if part.name == "InlineData":
            return self._values(part)
        groups = part.graph if part.name == "GroupOrUnionGraphPattern" else [part.graph]
        found = set().union(*map(self._group, groups))
        return set() if part.name == "MinusGraphPattern" else found | _variables(part.term)

    def _values(self, tree: Any) -> set[str]:
        found: set[str] = set()
        for variable in tree.var or ():
            if str(variable) in found:
                raise self._text.error(f"VALUES has ?{variable} twice", position_of(variable) or 0)
            found.add(str(variable))
        return found

    def _select(self, tree: Any) -> set[str]:
        """Check a query or subquery; return the variables that it projects."""
        bound = self._group(tree.where) if tree.where is not None else set()
        if tree.valuesClause is not None:
            bound |= self._values(tree.valuesClause)
        keys = self._keys(tree, bound)
        names = self._projected(tree, bound, keys)
        for condition in tree.having.condition if tree.having is not None else ():
            self._expression(condition, keys)
        seen = None if keys is None else keys | names
        for order in tree.orderby.condition if tree.orderby is not None else ():
            self._expression(order.expr, seen)
        return names

    def _keys(self, tree: Any, bound: set[str]) -> set[str] | None:
        """Return the variables to group by; None where solutions are not grouped."""
        if tree.groupby is None:
            expressions = [each.expr for each in tree.projection or ()]
            parts = _nodes([expressions, tree.having, tree.orderby], _is_exists)
            return set() if any(map(_is_aggregate, parts)) else None
        keys: set[str] = set()
        for condition in tree.groupby.condition:
            self._expression(condition)
            if getattr(condition, "name", "") == "GroupAs" and condition.var is not None:
                self._expect_new(condition.var, bound | keys)
                keys.add(str(condition.var))
            elif isinstance(condition, rdflib.Variable):
                keys.add(str(condition))
        return keys

    def _projected(self, tree: Any, bound: set[str], keys: set[str] | None) -> set[str]:
        items = [each for each in tree.projection or () if str(each.var) != EVERYTHING]
        if tree.name in ("SelectQuery", "SubSelect", "DescribeQuery") and not (items or tree.var):
            if keys is not None:
                reason = "* cannot be used with groups: name the variables"
                raise self._text.error(reason, position_of(tree) or 0)
            return bound
        names: set[str] = set()
        for item in items:
            if item.var is not None:
                self._expression(item.var, None if keys is None else keys | names)
                names.add(str(item.var))
            else:
                self._expression(item.expr, keys)
                self._expect_new(item.evar, bound | (keys or set()) | names)
                names.add(str(item.evar))
        # The template of CONSTRUCT, and the resources of DESCRIBE.
        self._expression([tree.template, tree.var], keys)
        return names

    def _expect_new(self, variable: Any, bound: set[str]) -> None:
        if str(variable) in bound:
            reason = f"?{variable} is bound already: take another name"
            raise self._text.error(reason, position_of(variable) or 0)

    def _expression(self, tree: Any, keys: set[str] | None = None) -> None:
        """Check an expression; with `keys`, aggregates are allowed, and no other variables."""
        for node in _nodes(tree, lambda node: _is_exists(node) or _is_aggregate(node)):
            if _is_exists(node):
                self._group(node.graph)
            elif getattr(node, "name", "") == "Builtin_COALESCE" and not node.arg:
                raise self._text.error(
                    "COALESCE() has no value: give it an expression", position_of(node) or 0
                )
            elif _is_aggregate(node):
                if keys is None:
                    raise self._text.error(_MISPLACED, position_of(node) or 0)
                self._expression(node.vars)
            elif keys is not None and isinstance(node, rdflib.Variable) and str(node) not in keys:
                reason = f"?{node} is neither grouped by nor aggregated"
                raise self._text.error(reason, position_of(node) or 0)


def _is_exists(node: Any) -> bool:
    return getattr(node, "name", "") in ("Builtin_EXISTS", "Builtin_NOTEXISTS")


def _is_aggregate(node: Any) -> bool:
    return isinstance(node, CompValue) and node.name.startswith("Aggregate_")


def _variables(tree: Any) -> set[str]:
    return {str(node) for node in _nodes(tree) if isinstance(node, rdflib.Variable)}


def _nodes(tree: Any, is_closed: Callable[[CompValue], bool] = lambda node: False) -> Iterator[Any]:
    """Yield nodes and terms in the order of the text, without those within closed nodes."""
    stack = [tree]
    while stack:
        node = stack.pop()
        if isinstance(node, list | tuple | ParseResults):
            stack += reversed(list(node))
            continue
        yield node
        if isinstance(node, CompValue) and not is_closed(node):
            stack += reversed(list(node.values()))
