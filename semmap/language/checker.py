"""From SPARQL's algebra to a plan: what can be wrong is found here, before evaluation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import rdflib
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.error import QueryError
from semmap.fields.queries.evaluate import exists
from semmap.language.expressions import (
    Expression,
    condition,
    expression,
    number_of,
    thing_named,
    word,
)
from semmap.language.grammar import EVERYTHING, Parsed, place
from semmap.language.plan import (
    Aggregate,
    Basic,
    Context,
    Distinct,
    Extend,
    Filter,
    Group,
    Inline,
    Join,
    Left,
    Minus,
    Order,
    Pattern,
    Plan,
    Project,
    Side,
    Slice,
    Union,
)
from semmap.fields.queries.table import Column, ColumnKind, Names, Table
from semmap.language.property import Kind
from semmap.fields.queries.statements import Catalogue, Relation
from semmap.limits import QUERY_ROWS

__all__ = ["KB", "TAKEN", "Checker"]

KB = "http://kb.openrobots.org/"
"""The namespace of the paper's examples."""

TAKEN = "*object"
"""The name of the object that STORE takes from WHERE."""


class Checker:
    """Makes plans of the algebra of one text.

    Parameters
    ----------
    parsed : Parsed
    catalogue : Catalogue
    store : Relation, optional
        Whose objects STORE takes from WHERE, where `subject` is the subject.
    """

    def __init__(
        self,
        parsed: Parsed,
        catalogue: Catalogue,
        *,
        store: Relation | None = None,
        subject: str | None = None,
    ) -> None:
        self.parsed = parsed
        self.catalogue = catalogue
        self.kinds: dict[str, tuple[ColumnKind, str | None, int]] = {}
        self.taken: list[int] = []
        self._store = store
        self._subject = subject
        self._visible: frozenset[str] = frozenset()
        self._namespaces: frozenset[str] | None = None

    # What expressions ask

    def error(self, reason: str, at: object) -> QueryError:
        """An error at a place in the text."""
        return self.parsed.error(reason, at)

    def variable(self, term: Any) -> tuple[ColumnKind, str | None]:
        """Kind and range of a variable that can be seen here."""
        name = str(term)
        if name not in self._visible:
            where = "in this group" if name in self.kinds else "by any pattern"
            raise self.error(f"?{name} is not bound {where}", term)
        kind, range_, _ = self.kinds[name]
        return kind, range_

    def things(self, term: Any, range_: str | None) -> frozenset[str]:
        """What a constant names."""
        name = thing_named(term)
        if name is None:
            raise self.error("this names no thing", term)
        try:
            return self.catalogue.things(name, range_)
        except (LookupError, TypeError) as error:
            raise self.error(_reason(error), term) from error

    def is_function(self, iri: str) -> bool:
        """Whether an IRI is of the paper's namespace, or of one that properties have."""
        if _namespace(iri) == KB:
            return True
        if self._namespaces is None:
            self._namespaces = frozenset(
                _namespace(each)
                for relation in self.catalogue.relations()
                for each in (relation.property.iri, *relation.property.same_as)
            )
        return _namespace(iri) in self._namespaces

    def exists(self, tree: Any) -> Expression:
        """EXISTS and NOT EXISTS."""
        negated = tree.name == "Builtin_NOTEXISTS"
        if tree.graph.name in ("GroupGraphPatternSub", "SubSelect"):
            raise self.error("EXISTS stands in FILTER and BIND", tree)
        outer, store = self._visible, self._store
        self._store = None
        inner, trees = tree.graph, []
        if inner.name == "Filter":
            inner, trees = inner.p, list(_conjuncts(inner.expr))
        plan = self.plan(inner)
        self._visible = outer | plan.variables
        conditions = [condition(each, self) for each in trees]
        own = tuple(c for c in conditions if c.variables <= plan.variables)
        both = tuple(c for c in conditions if not c.variables <= plan.variables)
        self._visible, self._store = outer, store
        if own:
            plan = Filter(plan, own, plan.variables)
        find = exists(plan, both)
        needed = plan.variables.union(*(c.variables for c in both)) & outer

        def run(context: Context, table: Table) -> Column:
            found = find(context, table)
            return Column("boolean", ~found if negated else found)

        return Expression("boolean", needed, run, place(tree) or 0)

    # What holds it together

    def _declare(self, name: str, kind: ColumnKind, range_: str | None, at: int) -> None:
        known = self.kinds.setdefault(name, (kind, range_, at))
        if known[0] != kind:
            line = self.error("", known[2]).line
            raise self.error(
                f"?{name} is {word(kind)} here, but {word(known[0])} in line {line}", at
            )

    def plan(self, node: Any) -> Plan:
        """A plan of a part of the algebra."""
        make = getattr(self, f"_plan_{node.name}", None)
        if make is None:
            raise self.error(f"{node.name} is not supported", node)
        found: Plan = make(node)
        return found

    def _with(self, variables: frozenset[str], make: Any, *trees: Any) -> Any:
        """Expressions where the given variables can be seen."""
        before, self._visible = self._visible, variables
        try:
            made = [make(tree, self) for tree in trees]
        finally:
            self._visible = before
        return tuple(made)

    def _plan_BGP(self, node: Any) -> Plan:
        triples = sorted(node.triples, key=lambda t: min(place(x) or 0 for x in t))
        patterns = tuple(self._pattern(*triple) for triple in triples)
        return Basic(patterns, frozenset().union(*(each.variables for each in patterns)))

    def _pattern(self, subject: Any, verb: Any, object_: Any) -> Pattern:
        if not isinstance(verb, rdflib.URIRef):
            raise self.error("a property has to be named: a variable cannot stand for it", verb)
        relation = self.relation(verb)
        about = relation.property
        sides = (
            self._side(subject, about.subject, about.domain, f"the subject of :{about.name}"),
            self._side(object_, about.object, about.range, f"the object of :{about.name}"),
        )
        taken = None
        if self._store is not None and sides[0] == self._subject:
            stored = self._store.property
            if about == stored:
                taken = TAKEN
                self.taken.append(place(verb) or 0)
        return Pattern(sides[0], relation, sides[1], place(subject) or place(verb) or 0, taken)

    def relation(self, iri: Any) -> Relation:
        """The relation of a property."""
        try:
            return self.catalogue.relation(str(iri))
        except LookupError as error:
            raise self.error(_reason(error), iri) from error

    def _side(self, term: Any, kind: Kind, type_: str | None, what: str) -> Side:
        if isinstance(term, (rdflib.Variable, rdflib.BNode)):
            name = str(term) if isinstance(term, rdflib.Variable) else f"_:{term}"
            self._declare(name, kind, type_ if kind == "thing" else None, place(term) or 0)
            return name
        number = number_of(term)
        if kind == "voxel":
            raise self.error(f"{what} is a voxel, which has no name: write a variable", term)
        if kind == "number":
            if number is None:
                raise self.error(f"{what} is a number", term)
            return number
        if number is not None or thing_named(term) is None:
            raise self.error(f"{what} is a thing: write an IRI or a plain name", term)
        return self.things(term, type_)

    def _plan_Join(self, node: Any) -> Plan:
        left, right = self.plan(node.p1), self.plan(node.p2)
        if isinstance(left, Basic) and not left.patterns:
            return right
        if isinstance(right, Basic) and not right.patterns:
            return left
        return Join(left, right, left.variables | right.variables)

    def _plan_LeftJoin(self, node: Any) -> Plan:
        left, right = self.plan(node.p1), self.plan(node.p2)
        both = left.variables | right.variables
        plain = getattr(node.expr, "name", "") == "TrueFilter"
        trees = () if plain else tuple(_conjuncts(node.expr))
        return Left(left, right, self._with(both, condition, *trees), both)

    def _plan_Union(self, node: Any) -> Plan:
        before, self.taken = self.taken, []
        left = self.plan(node.p1)
        mine, self.taken = self.taken, []
        right = self.plan(node.p2)
        theirs = self.taken
        if self._store is not None and bool(mine) != bool(theirs):
            raise self.error(
                f"STORE needs :{self._store.property.name} on both sides of UNION, or nowhere but "
                "outside of it", (mine or theirs)[0],
            )  # fmt: skip
        self.taken = before + max(mine, theirs, key=len)
        return Union(left, right, left.variables | right.variables)

    def _plan_Minus(self, node: Any) -> Plan:
        left = self.plan(node.p1)
        store, self._store = self._store, None
        right = self.plan(node.p2)
        self._store = store
        return Minus(left, right, left.variables)

    def _plan_Filter(self, node: Any) -> Plan:
        of = self.plan(node.p)
        return Filter(of, self._with(of.variables, condition, *_conjuncts(node.expr)), of.variables)

    def _plan_Extend(self, node: Any) -> Plan:
        of = self.plan(node.p)
        name = str(node.var)
        alias = isinstance(node.expr, rdflib.Variable) and place(node.expr) is None
        if name in of.variables:
            if alias:
                return of  # a variable that is grouped by: the group has it already
            raise self.error(f"?{name} is bound already: take another name", node.var)
        (value,) = self._with(of.variables, expression, node.expr)
        self._declare(name, value.kind, value.range, place(node.var) or 0)
        return Extend(of, name, value, of.variables | {name})

    def _plan_ToMultiSet(self, node: Any) -> Plan:
        if isinstance(node.p, list):
            return Inline(lambda _: Table(0, {}), frozenset())
        if node.p.name == "values":
            return self._inline(node.p.res)
        outside, visible = self.kinds, self._visible
        store, self._store = self._store, None
        self.kinds = {}
        plan = self.plan(node.p)
        inside, self.kinds, self._visible, self._store = self.kinds, outside, visible, store
        for name in sorted(plan.variables):
            self._declare(name, *inside[name])
        return plan

    def _inline(self, rows: list[dict[Any, Any]]) -> Plan:
        columns: dict[str, list[list[Any]]] = {str(v): [] for v in rows[0]}
        made = 0
        for row in rows:
            each = {str(variable): self._values(variable, term) for variable, term in row.items()}
            made += math.prod(map(len, each.values()))
            first = next(iter(row.values()))
            QUERY_ROWS.check(made, partial(self._too_many, first), "Name things, not types.")
            for chosen in product(*each.values()):
                for name, value in zip(each, chosen, strict=True):
                    columns[name].append(value)
        bound = {n: c for n, c in columns.items() if any(v is not None for v in c)}
        count = len(next(iter(columns.values())))

        def make(context: Context) -> Table:
            return Table(
                count, {n: _given(self.kinds[n][0], values, context.names)
                        for n, values in bound.items()},
            )  # fmt: skip

        return Inline(make, frozenset(bound))

    def _too_many(self, at: Any, problem: str, fix: str) -> QueryError:
        return self.error(f"VALUES {problem}. {fix}", at)

    def _values(self, variable: Any, term: Any) -> list[Any]:
        """What a value in VALUES stands for."""
        if str(term) == "UNDEF" and not isinstance(term, rdflib.term.Identifier):
            return [None]
        number = number_of(term)
        kind: ColumnKind
        found: list[Any]
        if number is not None:
            kind, found = "number", [number]
        elif isinstance(term, rdflib.Literal) and term.datatype == rdflib.XSD.boolean:
            kind, found = "boolean", [bool(term.value)]
        else:
            range_ = self.kinds.get(str(variable), (None, None))[1]
            kind, found = "thing", sorted(self.things(term, range_))
        self._declare(str(variable), kind, None, place(term) or 0)
        return found

    def _plan_Project(self, node: Any) -> Plan:
        of = self.plan(node.p)
        if [str(name) for name in node.PV] == [EVERYTHING]:
            return Project(of, frozenset(self.everything(of)) | (of.variables & {TAKEN}))
        names = frozenset(str(name) for name in node.PV)
        for name in node.PV:
            if str(name) not in of.variables:
                raise self.error(f"?{name} is not bound by any pattern", name)
        return Project(of, names | (of.variables & {TAKEN}))

    def everything(self, plan: Plan) -> list[str]:
        """The variables of a plan that have names, in the order of the text."""
        named = (n for n in plan.variables if not n.startswith(("*", "_:", "__agg_")))
        return sorted(named, key=lambda name: self.kinds[name][2])

    def _plan_Distinct(self, node: Any) -> Plan:
        of = self.plan(node.p)
        return Distinct(of, of.variables)

    def _plan_Reduced(self, node: Any) -> Plan:
        return self.plan(node.p)

    def _plan_Slice(self, node: Any) -> Plan:
        of = self.plan(node.p)
        return Slice(of, int(node.start), node.length, of.variables)

    def _plan_OrderBy(self, node: Any) -> Plan:
        of = self.plan(node.p)
        keys = self._with(of.variables, expression, *(each.expr for each in node.expr))
        down = (each.order == "DESC" for each in node.expr)
        return Order(of, tuple(zip(keys, down, strict=True)), of.variables)

    def _plan_AggregateJoin(self, node: Any) -> Plan:
        of = self.plan(node.p.p)
        keys = []
        for i, key in enumerate(node.p.expr or ()):
            name = str(key)
            (value,) = self._with(of.variables, expression, key)
            if not isinstance(key, rdflib.Variable):
                name = f"*key{i}"
                self._declare(name, value.kind, value.range, value.at)
                of = Extend(of, name, value, of.variables | {name})
            keys.append(name)
        aggregates = []
        for each in node.A:
            grouped = each.name == "Aggregate_Sample" and place(each) is None
            if grouped and str(each.vars) == EVERYTHING:
                raise self.error("* does not go with groups: name what is wanted", each.vars)
            if grouped and str(each.vars) not in keys:
                raise self.error(f"?{each.vars} is neither grouped by nor aggregated", each.vars)
            made = self._aggregate(each, of.variables)
            self._declare(made.name, made.kind, None, 0)
            aggregates.append(made)
        names = frozenset(keys).union(each.name for each in aggregates)
        return Group(of, tuple(keys), tuple(aggregates), node.p.expr is None, names)

    def _aggregate(self, node: Any, variables: frozenset[str]) -> Aggregate:
        function = node.name.removeprefix("Aggregate_")
        name, distinct = str(node.res), bool(node.distinct)
        if node.vars == "*" and not isinstance(node.vars, rdflib.term.Identifier):
            return Aggregate(name, function, None, distinct, "number")
        (of,) = self._with(variables, expression, node.vars)
        if function in ("Sum", "Avg") and of.kind != "number":
            raise self.error(
                f"{function.upper()} takes numbers, and this is {word(of.kind)}", of.at
            )
        if function in ("Min", "Max") and of.kind not in ("number", "text"):
            mend = ": write STR(...)" if of.kind == "thing" else ""
            raise self.error(f"{word(of.kind)} has no order{mend}", of.at)
        kind: ColumnKind = "number" if function in ("Count", "Sum", "Avg") else of.kind
        return Aggregate(name, function, of, distinct, kind)


def _namespace(iri: str) -> str:
    """An IRI without its local name."""
    return iri[: len(iri) - len(str(thing_named(rdflib.URIRef(iri))))]


def _conjuncts(tree: Any) -> Iterator[Any]:
    """The parts that all have to be true."""
    if isinstance(tree, CompValue) and tree.name == "ConditionalAndExpression":
        for each in (tree.expr, *tree.other):
            yield from _conjuncts(each)
    else:
        yield tree


def _reason(error: Exception) -> str:
    """What an error says, without the quotes that a KeyError has."""
    return str(error.args[0]) if error.args else type(error).__name__


def _given(kind: ColumnKind, values: list[Any], names: Names) -> Column:
    there = np.array([value is not None for value in values], np.bool_)
    if kind == "thing":
        each = [0 if value is None else names.code(value) for value in values]
        column = np.array(each, np.int64)
    else:
        column = np.array([0 if value is None else value for value in values],
                          np.bool_ if kind == "boolean" else np.float64)  # fmt: skip
    return Column(kind, column, None if there.all() else there)
