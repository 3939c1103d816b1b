"""Checks queries: all that can be wrong with one is found here, before it is evaluated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cached_property, partial
from itertools import product
from typing import Any

import rdflib

from semmap.language import algebra
from semmap.language.algebra import Expression, Pattern, Side
from semmap.language.error import QueryError
from semmap.language.expression_checker import check_condition, check_expression, conjuncts
from semmap.language.parser import ParsedText
from semmap.language.schema import Function, Property, Schema, SideKind, ValueKind, with_article
from semmap.language.terms import (
    EVERYTHING,
    PAPER_NAMESPACE,
    name_of,
    number_of,
    position_of,
)
from semmap.limits import QUERY_ROWS
from semmap.snake_case import namespace_of

Declaration = tuple[ValueKind, str | None, int]
"""The kind of a variable, the semantic type of its values, and where it was declared."""


class Checker:
    """Checks one text against a schema."""

    hidden: frozenset[str] = frozenset()  # variables that projections keep without naming them

    def __init__(self, parsed: ParsedText, schema: Schema) -> None:
        self.parsed = parsed
        self.schema = schema
        self.kinds: dict[str, Declaration] = {}
        self.visible: frozenset[str] = frozenset()

    def error(self, reason: str, at: object) -> QueryError:
        """Return an error at a term, a part of the tree, or a position."""
        return self.parsed.error(reason, at)

    def variable(self, term: Any) -> tuple[ValueKind, str | None]:
        """Return kind and semantic type of a variable that is visible here."""
        name = str(term)
        if name not in self.visible:
            where = "in this group" if name in self.kinds else "by any pattern"
            raise self.error(f"?{name} is not bound {where}", term)
        kind, range_, _ = self.kinds[name]
        return kind, range_

    def declare(self, name: str, kind: ValueKind, range_: str | None, position: int) -> None:
        """Set the kind of a variable. Raises QueryError: it has another kind already."""
        known, _, declared = self.kinds.setdefault(name, (kind, range_, position))
        if known != kind:
            line = self.error("", declared).line
            raise self.error(
                f"?{name} is {with_article(kind)} here, but {with_article(known)} in line {line}",
                position,
            )

    def seeing(
        self,
        variables: frozenset[str],
        check: Callable[[Any, Checker], Expression],
        *trees: Any,
    ) -> tuple[Expression, ...]:
        """Check expressions where the given variables are visible."""
        before, self.visible = self.visible, variables
        try:
            return tuple(check(tree, self) for tree in trees)
        finally:
            self.visible = before

    @contextmanager
    def own_kinds(self) -> Iterator[dict[str, Declaration]]:
        """Check a subquery: its variables are not those of the text around it."""
        outside, self.kinds = self.kinds, {}
        try:
            yield self.kinds
        finally:
            self.kinds = outside

    def find_property(self, iri: Any) -> Property:
        """Return the property of an IRI in the text."""
        try:
            return self.schema.find_property(str(iri))
        except LookupError as error:
            raise self.error(_message(error), iri) from error

    def entities(self, term: Any, range_: str | None) -> frozenset[str]:
        """Return the entities that a constant stands for."""
        name = name_of(term)
        if name is None:
            raise self.error("this is not the name of an entity", term)
        try:
            return self.schema.find_entities(name, range_)
        except (LookupError, TypeError) as error:
            raise self.error(_message(error), term) from error

    def function(self, term: Any) -> Function:
        """Return the function of an IRI in the paper's namespace or in that of a property."""
        name, functions = str(name_of(term)), self.schema.functions
        if name not in functions or namespace_of(str(term)) not in self._function_namespaces:
            known = ", ".join(f":{each}" for each in functions) or "none"
            raise self.error(f"there is no function {name}; known functions: {known}", term)
        return functions[name]

    @cached_property
    def _function_namespaces(self) -> frozenset[str]:
        known = (iri for each in self.schema.properties() for iri in (each.iri, *each.same_as))
        return frozenset({PAPER_NAMESPACE}).union(map(namespace_of, known))

    def check(self, node: Any) -> Pattern:
        """Return a part of rdflib's algebra as a checked pattern; raises QueryError."""
        check: Callable[[Any], Pattern] | None = getattr(self, f"_check_{node.name}", None)
        if check is None:
            raise self.error(f"{node.name} is not supported", node)
        return check(node)

    def visible_names(self, pattern: Pattern) -> list[str]:
        """Return the variables of a pattern that the text names, in the order of the text."""
        named = (n for n in pattern.variables if not n.startswith(("*", "_:", "__agg_")))
        return sorted(named, key=lambda name: self.kinds[name][2])

    def detached(self) -> AbstractContextManager[object]:
        """Return the context of a part that binds no rows: in MINUS, a subquery, or EXISTS."""
        return nullcontext()

    def exists(self, tree: Any) -> Expression:
        """Check EXISTS or NOT EXISTS."""
        if tree.graph.name in ("GroupGraphPatternSub", "SubSelect"):
            raise self.error("EXISTS is allowed in FILTER and BIND only", tree)
        outer = self.visible
        inner, trees = tree.graph, []
        if inner.name == "Filter":
            inner, trees = inner.p, list(conjuncts(inner.expr))
        with self.detached():
            pattern = self.check(inner)
            conditions = self.seeing(outer | pattern.variables, check_condition, *trees)
        own = tuple(c for c in conditions if c.variables <= pattern.variables)
        both = tuple(c for c in conditions if not c.variables <= pattern.variables)
        if own:
            pattern = algebra.Filter(pattern, own)
        negated = tree.name == "Builtin_NOTEXISTS"
        return algebra.Exists(
            "boolean", position_of(tree) or 0, None, pattern, both, outer, negated
        )

    def _check_BGP(self, node: Any) -> Pattern:
        triples = sorted(node.triples, key=lambda t: min(position_of(x) or 0 for x in t))
        return algebra.BasicGraphPattern(tuple(self._triple(*triple) for triple in triples))

    def _triple(self, subject: Any, verb: Any, object_: Any) -> algebra.TriplePattern:
        if not isinstance(verb, rdflib.URIRef):
            raise self.error("a property cannot be a variable: name it", verb)
        found = self.find_property(verb)
        name = found.name
        return algebra.TriplePattern(
            self._side(subject, found.subject, found.domain, f"the subject of :{name}"),
            found,
            self._side(object_, found.object, found.range, f"the object of :{name}"),
            position_of(subject) or position_of(verb) or 0,
        )

    def _side(self, term: Any, kind: SideKind, type_: str | None, role: str) -> Side:
        if isinstance(term, (rdflib.Variable, rdflib.BNode)):
            name = str(term) if isinstance(term, rdflib.Variable) else f"_:{term}"
            range_ = type_ if kind == "entity" else None
            self.declare(name, kind, range_, position_of(term) or 0)
            return name
        number = number_of(term)
        if kind == "voxel":
            raise self.error(f"{role} is a voxel, which has no name: write a variable", term)
        if kind == "number":
            if number is None:
                raise self.error(f"{role} is a number: write one, or a variable", term)
            return number
        if number is not None or name_of(term) is None:
            raise self.error(f"{role} is an entity: write an IRI or a plain name", term)
        return self.entities(term, type_)

    def _check_Join(self, node: Any) -> Pattern:
        left, right = self.check(node.p1), self.check(node.p2)
        if isinstance(left, algebra.BasicGraphPattern) and not left.patterns:
            return right
        if isinstance(right, algebra.BasicGraphPattern) and not right.patterns:
            return left
        return algebra.Join(left, right)

    def _check_LeftJoin(self, node: Any) -> Pattern:
        left, right = self.check(node.p1), self.check(node.p2)
        plain = getattr(node.expr, "name", "") == "TrueFilter"
        trees = () if plain else tuple(conjuncts(node.expr))
        both = left.variables | right.variables
        return algebra.LeftJoin(left, right, self.seeing(both, check_condition, *trees))

    def _check_Union(self, node: Any) -> Pattern:
        return algebra.Union(self.check(node.p1), self.check(node.p2))

    def _check_Minus(self, node: Any) -> Pattern:
        left = self.check(node.p1)
        with self.detached():
            right = self.check(node.p2)
        return algebra.Minus(left, right)

    def _check_Filter(self, node: Any) -> Pattern:
        of = self.check(node.p)
        return algebra.Filter(of, self.seeing(of.variables, check_condition, *conjuncts(node.expr)))

    def _check_Extend(self, node: Any) -> Pattern:
        of = self.check(node.p)
        name = str(node.var)
        if name in of.variables:
            # GROUP BY ?v: rdflib extends the group by ?v, which it has already.
            if isinstance(node.expr, rdflib.Variable) and position_of(node.expr) is None:
                return of
            raise self.error(f"?{name} is bound already: take another name", node.var)
        (value,) = self.seeing(of.variables, check_expression, node.expr)
        self.declare(name, value.kind, value.range, position_of(node.var) or 0)
        return algebra.Extend(of, name, value)

    def _check_ToMultiSet(self, node: Any) -> Pattern:
        if isinstance(node.p, list):
            return algebra.InlineData(0, {}, {})
        if node.p.name == "values":
            return self._inline_data(node.p.res)
        with self.detached(), self.own_kinds() as inside:
            pattern = self.check(node.p)
        for name in sorted(pattern.variables):
            self.declare(name, *inside[name])
        return pattern

    def _inline_data(self, rows: list[dict[Any, Any]]) -> Pattern:
        columns: dict[str, list[Any]] = {str(v): [] for v in rows[0]}
        count = 0
        for row in rows:
            each = {str(variable): self._values(variable, term) for variable, term in row.items()}
            count += math.prod(map(len, each.values()))
            error = partial(self._too_many_values, next(iter(row.values())))
            QUERY_ROWS.check(count, error, "Name entities instead of types.")
            for chosen in product(*each.values()):
                for name, value in zip(each, chosen, strict=True):
                    columns[name].append(value)
        bound = {
            name: tuple(values)
            for name, values in columns.items()
            if any(value is not None for value in values)
        }
        return algebra.InlineData(count, bound, {name: self.kinds[name][0] for name in bound})

    def _too_many_values(self, at: Any, problem: str, fix: str) -> QueryError:
        return self.error(f"VALUES {problem}. {fix}", at)

    def _values(self, variable: Any, term: Any) -> list[Any]:
        """Return what a value in VALUES stands for."""
        if str(term) == "UNDEF" and not isinstance(term, rdflib.term.Identifier):
            return [None]
        number = number_of(term)
        kind: ValueKind
        values: list[Any]
        if number is not None:
            kind, values = "number", [number]
        elif isinstance(term, rdflib.Literal) and term.datatype == rdflib.XSD.boolean:
            kind, values = "boolean", [bool(term.value)]
        else:
            range_ = self.kinds.get(str(variable), (None, None))[1]
            kind, values = "entity", sorted(self.entities(term, range_))
        self.declare(str(variable), kind, None, position_of(term) or 0)
        return values

    def _check_Project(self, node: Any) -> Pattern:
        of = self.check(node.p)
        hidden = of.variables & self.hidden
        if [str(name) for name in node.PV] == [EVERYTHING]:
            return algebra.Project(of, frozenset(self.visible_names(of)) | hidden)
        for name in node.PV:
            if str(name) not in of.variables:
                raise self.error(f"?{name} is not bound by any pattern", name)
        return algebra.Project(of, frozenset(str(name) for name in node.PV) | hidden)

    def _check_Distinct(self, node: Any) -> Pattern:
        return algebra.Distinct(self.check(node.p))

    def _check_Reduced(self, node: Any) -> Pattern:
        return self.check(node.p)

    def _check_Slice(self, node: Any) -> Pattern:
        return algebra.SolutionSlice(self.check(node.p), int(node.start), node.length)

    def _check_OrderBy(self, node: Any) -> Pattern:
        of = self.check(node.p)
        keys = self.seeing(of.variables, check_expression, *(each.expr for each in node.expr))
        descending = (each.order == "DESC" for each in node.expr)
        return algebra.OrderBy(of, tuple(zip(keys, descending, strict=True)))

    def _check_AggregateJoin(self, node: Any) -> Pattern:
        of = self.check(node.p.p)
        keys = []
        for i, key in enumerate(node.p.expr or ()):
            name = str(key)
            (value,) = self.seeing(of.variables, check_expression, key)
            if not isinstance(key, rdflib.Variable):
                name = f"*key{i}"
                self.declare(name, value.kind, value.range, value.position)
                of = algebra.Extend(of, name, value)
            keys.append(name)
        aggregates = []
        for each in node.A:
            aggregate = self._aggregate(each, of.variables)
            self.declare(aggregate.name, aggregate.kind, None, 0)
            aggregates.append(aggregate)
        return algebra.GroupPattern(of, tuple(keys), tuple(aggregates), node.p.expr is None)

    def _aggregate(self, node: Any, variables: frozenset[str]) -> algebra.Aggregate:
        function = node.name.removeprefix("Aggregate_")
        name, distinct = str(node.res), bool(node.distinct)
        if node.vars == "*" and not isinstance(node.vars, rdflib.term.Identifier):
            return algebra.Aggregate(name, function, None, distinct, "number")
        (of,) = self.seeing(variables, check_expression, node.vars)
        kind = with_article(of.kind)
        if function in ("Sum", "Avg") and of.kind != "number":
            raise self.error(f"{function.upper()} takes numbers, and this is {kind}", of.position)
        if function in ("Min", "Max") and of.kind not in ("number", "text"):
            fix = ": write STR(...)" if of.kind == "entity" else ""
            raise self.error(f"{kind} has no order{fix}", of.position)
        result: ValueKind = "number" if function in ("Count", "Sum", "Avg") else of.kind
        return algebra.Aggregate(name, function, of, distinct, result)


def _message(error: Exception) -> str:
    """Return the message of an error, without the quotes that a KeyError adds."""
    return str(error.args[0]) if error.args else type(error).__name__
