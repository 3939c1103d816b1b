"""SPARQL's algebra (1.1, section 18) as one statement of SQL."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import rdflib
from rdflib.paths import Path
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.fields.properties import comparisons, count_variables
from semmap.knowledge.sparql.expressions import Environment, Expressions, UntranslatedError
from semmap.knowledge.sparql.geosparql import AGGREGATES, geometry_of
from semmap.knowledge.sparql.relation import (
    UNBOUND,
    Rows,
    either,
    entity_iri,
    in_form,
    renamed,
    union,
    union_form,
    unless_null,
)
from semmap.knowledge.sparql.scope import MapGraph, PatternScope
from semmap.knowledge.sparql.stored_terms import columns_with_numbers
from semmap.knowledge.sparql.triples import TriplePatterns
from semmap.knowledge.sparql.values import NUMERIC, as_term, same, tag_of, text_of
from semmap.knowledge.triple_map import Form, Value
from semmap.knowledge.vocabulary import XSD

GIVEN = "given p"
"""Stands for the table with the given values; no text of a user is in a statement."""


@dataclass(frozen=True)
class SqlStatement:
    """A statement of SQL with its parameters; a text and a tag for each variable."""

    sql: str  # with named parameters of psycopg
    parameters: dict[str, Any]  # by name
    names: tuple[str, ...]  # the variables of the columns, in order
    relations: frozenset[str] = frozenset()  # kept relations of which it could read all pairs


def translate(
    algebra: Any, names: tuple[str, ...], source: MapGraph, limit: int | None = None
) -> SqlStatement:
    """Translate a pattern for at most `limit` rows, with terms of statements as numbers.

    Raises UntranslatedError.
    """
    algebra = count_solutions(algebra)
    uses = count_variables(algebra) + Counter(names)
    translator = _Translator(source, uses)
    translator.numbered = True
    sql = translator.result(algebra, names)
    if limit is not None:
        sql = f"SELECT * FROM ({sql}) result LIMIT {translator.parameters.bind(limit, 'bigint')}"
    relations = frozenset(translator.relations)
    return SqlStatement(sql, translator.parameters.values, names, relations)


def translate_each(
    algebra: Any, names: tuple[str, ...], source: MapGraph, given: Mapping[str, Form]
) -> SqlStatement:
    """Translate a pattern that is answered for each row of a table p with values of variables.

    The columns of p are n, and for each given variable s0, s1 ..., with t0 ... for the tag of a
    "term". With given ones, the pattern is not a SELECT or ASK. The statement has `GIVEN` in place
    of p, and n is its first column. Raises UntranslatedError.
    """
    algebra = count_solutions(algebra)
    uses = count_variables(algebra) + Counter(names)
    translator = _Translator(source, uses)
    if not given:
        result = translator.result(algebra, names)
        if not names:
            result = f"SELECT * FROM ({result}) q LIMIT 1"
        sql = f"SELECT p.n, r.* FROM {GIVEN}, LATERAL ({result}) r"
        return SqlStatement(sql, translator.parameters.values, names)
    values = {
        name: Value(form, f"p.s{i}", f"p.t{i}" if form == "term" else None)
        for i, (name, form) in enumerate(given.items())
    }
    rows = Rows([GIVEN], variables=dict(values))
    rows.join(
        translator.rows(algebra, PatternScope(bindings=values, given=values)), translator.namespace
    )
    sql = f"SELECT {', '.join(['p.n', *translator.columns(rows, names)])}{rows.tables()}"
    return SqlStatement(sql, translator.parameters.values, names)


class _Translator(TriplePatterns):
    """Translates patterns; each method `_rows_X` those of the algebra's node X."""

    numbered = False
    """Whether columns of the result have the numbers of terms that statements have."""

    def __init__(self, source: MapGraph, uses: Counter[str]) -> None:
        super().__init__(source, uses)
        self._scope = PatternScope()
        self.expressions = Expressions(
            self.parameters.bind, self.namespace, self.map_id, self.constant, self._exists
        )

    def result(self, node: Any, names: tuple[str, ...]) -> str:
        """Return a SELECT of the text and the tag of each variable, in order."""
        rows, order, tail = self._modified(node, PatternScope())
        sql = f"SELECT {', '.join(self.columns(rows, names)) or '1 AS v0'}{rows.tables()}"
        return f"{sql}{order}{tail}"

    def columns(self, rows: Rows, names: tuple[str, ...]) -> list[str]:
        """Return the text and the tag of each variable, in order."""
        columns = []
        for i, name in enumerate(names):
            value = rows.variables.get(name, UNBOUND)
            if self.numbered and value.form in ("resource", "stored"):
                text, tag = columns_with_numbers(value, self.namespace)
                columns.append(f"{text} AS v{i}, {tag} AS t{i}")
                continue
            text = entity_iri(rows, value, self.namespace) or text_of(value, self.namespace)
            tag = tag_of(value)
            if value.tag is None and not isinstance(value.constant, tuple):
                tag = f"CASE WHEN {value.sql} IS NULL THEN NULL ELSE {tag} END"
            columns.append(f"{text} AS v{i}, {tag} AS t{i}")
        return columns

    def rows(self, node: Any, scope: PatternScope) -> Rows:
        """Return the solutions of a pattern."""
        method: Callable[[Any, PatternScope], Rows] | None = getattr(
            self, f"_rows_{node.name}", None
        )
        if method is None:
            raise UntranslatedError(f"{node.name} has no translation to SQL")
        return method(node, scope)

    def _rows_BGP(self, node: Any, scope: PatternScope) -> Rows:
        if not node.triples:
            return Rows()
        return self.triples(node.triples, scope)

    def _rows_Join(self, node: Any, scope: PatternScope) -> Rows:
        left = self.rows(node.p1, scope)
        right = self.rows(node.p2, scope.joined(left.sure()))
        left.join(right, self.namespace)
        return left

    def _rows_Union(self, node: Any, scope: PatternScope) -> Rows:
        parts = [self.rows(p, scope) for p in (node.p1, node.p2)]
        return union(parts, self.parameters, self.namespace)

    def _rows_Filter(self, node: Any, scope: PatternScope) -> Rows:
        conditions = (*scope.conditions, *comparisons(node.expr))
        rows = self.rows(node.p, replace(scope, conditions=conditions))
        rows.where.append(self._condition(node.expr, rows, scope))
        return rows

    def _condition(self, tree: Any, rows: Rows, scope: PatternScope) -> str:
        found: str = self._in(scope, partial(self.expressions.condition, tree), rows)
        return found

    def _in(self, scope: PatternScope, make: Callable[[Environment], Any], rows: Rows) -> Any:
        outside, self._scope = self._scope, scope
        try:
            return make({**scope.outer, **rows.variables})
        finally:
            self._scope = outside

    def _rows_Extend(self, node: Any, scope: PatternScope) -> Rows:
        name = str(node.var)
        bindings = {n: v for n, v in scope.bindings.items() if n != name}
        rows = self.rows(node.p, replace(scope, bindings=bindings))
        value = self._in(scope, lambda seen: self.expressions.value(node.expr, seen), rows)
        if name in rows.variables:
            return rows  # rdflib extends groups by their keys again
        rows.variables[name] = value
        if not isinstance(node.expr, rdflib.Variable) or str(node.expr) not in rows.sure():
            rows.nullable.add(name)
        if isinstance(node.expr, rdflib.term.Identifier) and not isinstance(
            node.expr, rdflib.Variable
        ):
            rows.nullable.discard(name)
        return rows

    def _rows_LeftJoin(self, node: Any, scope: PatternScope) -> Rows:
        left = self.rows(node.p1, scope).closed(self.parameters)
        right = self.rows(node.p2, replace(scope, bindings=left.sure()))
        right = right.closed(self.parameters)
        both = Rows(variables=dict(left.variables), nullable=set(left.nullable))
        both.join(Rows(variables=right.variables, nullable=right.nullable), self.namespace)
        if getattr(node.expr, "name", "") != "TrueFilter":
            both.where.append(self._condition(node.expr, both, scope))
        on = " AND ".join(both.where) or "true"
        rows = Rows([f"{left.froms[0]} LEFT JOIN {right.froms[0]} ON {on}"])
        rows.variables = {**both.variables, **left.sure()}
        rows.nullable = (both.variables.keys() - left.variables.keys()) | left.nullable
        for name in left.nullable & right.variables.keys():
            a, b = left.variables[name], right.variables[name]
            rows.variables[name] = either(a, b, self.namespace)
        return rows

    def _rows_Minus(self, node: Any, scope: PatternScope) -> Rows:
        left = self.rows(node.p1, scope)
        right = self.rows(node.p2, replace(scope, bindings=left.sure(), conditions=()))
        shared = [n for n in right.variables if n in left.variables]
        if not shared:
            return left
        # Solutions that share no bound variable are not removed.
        conditions, both = [], []
        for name in shared:
            a, b = left.variables[name], right.variables[name]
            maybe = [v for v, rows in ((a, left), (b, right)) if name in rows.nullable]
            conditions.append(unless_null(same(a, b, self.namespace), *maybe))
            both.append(f"({a.sql} IS NOT NULL AND {b.sql} IS NOT NULL)")
        if all(name in left.nullable or name in right.nullable for name in shared):
            conditions.append(f"({' OR '.join(both)})")
        right.where += conditions
        left.where.append(f"NOT EXISTS ({right.select(())})")
        return left

    def _exists(self, graph: Any, seen: Environment) -> str:
        """Return the condition that a pattern has a solution with the values of a row."""
        scope = self._scope
        inner = PatternScope(scope.graph, bindings=dict(seen), outer=dict(seen))
        # What may be unbound outside cannot limit the pattern.
        if graph.name in ("GroupGraphPatternSub", "SubSelect"):
            raise UntranslatedError("EXISTS is translated in FILTER and BIND only")
        rows = self.rows(graph, replace(inner, bindings={}))
        for name in [n for n in rows.variables if n in seen]:
            value, known = rows.variables[name], seen[name]
            maybe = [known, value] if name in rows.nullable else [known]
            rows.where.append(unless_null(same(value, known, self.namespace), *maybe))
        return f"EXISTS ({rows.select(())})"

    def _rows_Graph(self, node: Any, scope: PatternScope) -> Rows:
        graph = self.part(node.term)
        if isinstance(graph, Value) or _is_of_one_graph(node.p):
            return self.rows(node.p, replace(scope, graph=graph))
        # Each graph by itself: the pattern has parts that do not bind its name.
        rows = self._graphs(graph)
        name = rows.variables[graph]
        inner = scope.joined(rows.variables)
        rows.join(self.rows(node.p, replace(inner, graph=name)), self.namespace)
        return rows

    def _graphs(self, name: str) -> Rows:
        alias, graph = self.parameters.alias("q"), self.parameters.alias()
        rows = Rows([f"triple {graph}"], [f"{graph}.map_id = {self.map_id}", _ALIVE.format(graph)])
        self._match_graph(rows, graph, name)
        select = rows.select([rows.variables[name]], distinct=True)
        return Rows([f"LATERAL ({select}) {alias}"], [], {name: Value("resource", f"{alias}.c0")})

    def _rows_ToMultiSet(self, node: Any, scope: PatternScope) -> Rows:
        if isinstance(node.p, list):
            return Rows(where=["false"] if not node.p else [])
        if node.p.name == "values":
            return self._values(node.p.res)
        rows, order, tail = self._modified(node.p, PatternScope(scope.graph, outer=scope.outer))
        return rows.closed(self.parameters, order + tail if tail else "")

    def _values(self, solutions: list[dict[Any, Any]]) -> Rows:
        if not solutions:
            return Rows(where=["false"])
        if not solutions[0]:
            return Rows()
        lines: list[list[str]] = [[] for _ in solutions]
        first, nullable = {}, set()
        for variable in solutions[0]:
            terms = (solution.get(variable) for solution in solutions)
            values = [
                self.constant(term) if isinstance(term, rdflib.term.Identifier) else UNBOUND
                for term in terms
            ]
            form = union_form(values)
            placed = [in_form(value, form, self.namespace) for value in values]
            for line, value in zip(lines, placed, strict=True):
                line += value.columns()
            first[str(variable)] = placed[0]
            if UNBOUND in values:
                nullable.add(str(variable))
        alias = self.parameters.alias("v")
        text = ", ".join(f"({', '.join(line)})" for line in lines)
        labels = ", ".join(f"c{i}" for i in range(len(lines[0])))
        return Rows([f"(VALUES {text}) {alias} ({labels})"], [], renamed(first, alias), nullable)

    def _modified(self, node: Any, scope: PatternScope) -> tuple[Rows, str, str]:
        tail, distinct, projected, order = "", False, None, []
        while True:
            if node.name == "Slice":
                tail = self._slice(node)
            elif node.name in ("Distinct", "Reduced"):
                distinct = distinct or node.name == "Distinct"
            elif node.name == "Project":
                projected = [str(name) for name in node.PV]
            elif node.name == "OrderBy":
                order = list(node.expr)
            elif node.name not in ("SelectQuery", "AskQuery", "ConstructQuery", "DescribeQuery"):
                break
            node = node.p
        rows = self.rows(node, scope)
        whole = rows
        if projected is not None:
            rows = Rows(
                rows.froms,
                rows.where,
                {n: rows.variables.get(n, UNBOUND) for n in projected},
                {n for n in projected if n in rows.nullable or n not in rows.variables},
            )
        if distinct:
            for each in order:
                if not count_variables(each.expr).keys() <= rows.variables.keys():
                    raise UntranslatedError(
                        "ORDER BY with DISTINCT is translated for variables of the result"
                    )
            whole = rows = rows.closed(self.parameters, distinct=True)
        keys = [key for each in order for key in self._order(each, whole, scope)]
        return rows, f" ORDER BY {', '.join(keys)}" if keys else "", tail

    def _slice(self, node: Any) -> str:
        tail = ""
        if node.length is not None:
            tail += f" LIMIT {self.parameters.bind(int(node.length), 'bigint')}"
        if node.start:
            tail += f" OFFSET {self.parameters.bind(int(node.start), 'bigint')}"
        return tail

    def _order(self, each: Any, rows: Rows, scope: PatternScope) -> list[str]:
        """Return the keys of an order: unbound, blank nodes, IRIs, literals (section 15.1)."""
        value = self._in(scope, lambda seen: self.expressions.value(each.expr, seen), rows)
        end = " DESC NULLS LAST" if each.order == "DESC" else " NULLS FIRST"
        if value.form in (*NUMERIC, "time", "boolean"):
            if str(each.expr) in rows.sure():  # in the order of an index
                end = " DESC" if each.order == "DESC" else ""
            return [value.sql + end]
        text = text_of(value, self.namespace)
        if value.form != "term":
            return [f'{text} COLLATE "C"{end}']
        return [key + end for key in _order_keys(value)]

    def _rows_Group(self, node: Any, scope: PatternScope) -> Rows:
        raise UntranslatedError("a group without aggregates has no translation to SQL")

    def _rows_AggregateJoin(self, node: Any, scope: PatternScope) -> Rows:
        inner_scope = PatternScope(scope.graph, outer=scope.outer)
        rows = self.rows(node.p.p, inner_scope)
        keys: dict[str, Value] = {}
        for i, key in enumerate(node.p.expr or ()):
            value = rows.variables.get(str(key), UNBOUND)
            if not isinstance(key, rdflib.Variable) or value.form != "stored":
                value = self._in(scope, partial(self.expressions.value, key), rows)
            keys[str(key) if isinstance(key, rdflib.Variable) else f"*key{i}"] = value
        found: dict[str, Value] = dict(keys)
        maybe = {name for name in keys if name in rows.nullable or name.startswith("*")}
        for each in node.A:
            name = str(each.res)
            sample = each.name == "Aggregate_Sample" and isinstance(each.vars, rdflib.Variable)
            if sample and str(each.vars) in keys:
                found[name] = keys[str(each.vars)]
                if str(each.vars) in maybe:
                    maybe.add(name)
                continue
            value, sure = self._in(scope, partial(self._aggregate, each), rows)
            found[name] = value
            if not sure:
                maybe.add(name)
        group = [sql for value in keys.values() for sql in value.columns()]
        alias = self.parameters.alias("g")
        text = rows.select(found.values())
        if group:
            text += f" GROUP BY {', '.join(group)}"
        elif node.p.expr is not None:
            text += " GROUP BY ()"
        if not node.A and not group:
            text += " GROUP BY ()"
        return Rows([f"LATERAL ({text}) {alias}"], [], renamed(found, alias), maybe)

    def _aggregate(self, each: Any, seen: Environment) -> tuple[Value, bool]:
        """Return an aggregate (section 18.5.1), and whether it has a value for each group."""
        function = each.name.removeprefix("Aggregate_")
        distinct = "DISTINCT " if each.distinct else ""
        if function == "Count" and not isinstance(each.vars, (rdflib.term.Identifier, CompValue)):
            if not distinct:
                return Value("integer", "count(*)::numeric"), True
            columns = [sql for v in seen.values() for sql in v.columns()]
            return Value("integer", f"count(DISTINCT ROW({', '.join(columns)}))::numeric"), True
        value = self.expressions.value(each.vars, seen)
        if function == "Count":
            value = seen.get(str(each.vars), value)  # the number of a term
            counted = value.sql
            if distinct and value.form == "term":
                counted = f"CASE WHEN {value.sql} IS NOT NULL THEN ({value.sql}, {value.tag}) END"
            return Value("integer", f"count({distinct}{counted})::numeric"), True
        if function in ("Sum", "Avg"):
            return self._sum(function, distinct, value)
        if function in ("Min", "Max"):
            return self._extreme(function.lower(), value), False
        if function == "Sample":
            return self._sample(value), False
        if function == "GroupConcat":
            separator = each.separator if each.separator is not None else " "
            between = self.parameters.bind(str(separator))
            text = text_of(value, self.namespace)
            order = f" ORDER BY {text}" if distinct else ""
            joined = f"string_agg({distinct}{text}, {between}{order})"
            return Value("string", f"coalesce({joined}, '')"), True
        if function in AGGREGATES:
            return Value(
                "geometry", AGGREGATES[function].format(geometry_of(value), map=self.map_id)
            ), False
        raise UntranslatedError(f"{function} has no translation to SQL")

    def _sum(self, function: str, distinct: str, value: Value) -> tuple[Value, bool]:
        call = "sum" if function == "Sum" else "avg"
        if value.form == "double":
            return Value("double", _total(function, distinct, value.sql)), True
        if value.form in NUMERIC:
            form = "decimal" if (function, value.form) == ("Avg", "integer") else value.form
            return Value(form, f"coalesce({call}({distinct}{value.sql}), 0)"), True
        if value.form != "term":
            return Value("integer", f"CASE WHEN count({value.sql}) = 0 THEN 0::numeric END"), False
        number = f"rdf_number({value.sql}, {value.tag})"
        total = _total(function, distinct, number)
        wrong = f"bool_or({value.sql} IS NOT NULL AND {number} IS NULL)"
        double = f"bool_or({value.tag} IN ('{XSD}double', '{XSD}float'))"
        decimal = f"bool_or({value.tag} = '{XSD}decimal')"
        if function == "Avg":
            decimal = f"count({value.sql}) > 0"
        text = (
            f"CASE WHEN {wrong} THEN NULL WHEN {double} THEN rdf_double({total}) "
            f"WHEN abs({total}) = 'Infinity' THEN NULL "
            f"WHEN {decimal} THEN rdf_decimal(({total})::numeric) ELSE ({total})::numeric::text END"
        )
        tag = (
            f"CASE WHEN {double} THEN '{XSD}double' WHEN {decimal} THEN '{XSD}decimal' "
            f"ELSE '{XSD}integer' END"
        )
        return Value("term", text, tag), False

    def _extreme(self, call: str, value: Value) -> Value:
        if value.form in (*NUMERIC, "time"):
            return Value(value.form, f"{call}({value.sql})")
        if value.form == "string":
            return Value("string", f'{call}({value.sql} COLLATE "C")')
        if value.form == "boolean":
            both = "bool_and" if call == "min" else "bool_or"
            return Value("boolean", f"{both}({value.sql})")
        term = as_term(value, self.namespace)
        end = "DESC NULLS LAST" if call == "max" else "NULLS LAST"
        order = ", ".join(f"{key} {end}" for key in _order_keys(term))
        known = f"FILTER (WHERE {term.sql} IS NOT NULL)"
        text = f"(array_agg({term.sql} ORDER BY {order}) {known})[1]"
        return Value("term", text, f"(array_agg({term.tag} ORDER BY {order}) {known})[1]")

    def _sample(self, value: Value) -> Value:
        known = f"FILTER (WHERE {value.sql} IS NOT NULL)"
        columns = [f"(array_agg({sql}) {known})[1]" for sql in value.columns()]
        return Value.of_columns(value.form, columns)


def _total(function: str, distinct: str, number: str) -> str:
    """Return the SQL of the sum or mean of doubles; `rdf_total` says why there are two sums."""
    is_large = f"abs({number}) > 1e280"
    large = f"sum({distinct}{number} / 1152921504606846976) FILTER (WHERE {is_large})"
    small = f"sum({distinct}{number}) FILTER (WHERE NOT {is_large})"
    count = f"count({distinct}{number})" if function == "Avg" else "1"
    return f"rdf_total({large}, {small}, {count})"


def _order_keys(term: Value) -> tuple[str, ...]:
    """Return the keys by which terms are in order: blank nodes, IRIs, then literals."""
    rank = f"CASE {term.tag} WHEN 'B' THEN 1 WHEN 'I' THEN 2 ELSE 3 END"
    return rank, f"rdf_number({term.sql}, {term.tag})", f'{term.sql} COLLATE "C"'


_ALIVE = "({0}.until IS NULL OR {0}.until > statement_timestamp())"


def _is_of_one_graph(node: Any) -> bool:
    """Return whether each solution of a pattern binds the name of the graph that it is from."""
    if node.name in ("Join", "Union"):
        return all(_is_of_one_graph(part) for part in (node.p1, node.p2))
    if node.name != "BGP":
        return False
    return bool(node.triples) and not any(isinstance(verb, Path) for _, verb, _ in node.triples)


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
    if not (plain and isinstance(aggregate.vars, rdflib.Variable) and aggregate.vars in bound):
        return aggregate
    found = aggregate.clone()
    found["vars"] = "*"
    return found


def _bound(node: Any) -> set[rdflib.Variable]:
    """The variables that have a value in each solution, as far as the form of a pattern tells."""
    if node.name == "BGP":
        return {
            part for triple in node.triples for part in triple if isinstance(part, rdflib.Variable)
        }
    if node.name == "Join":
        return _bound(node.p1) | _bound(node.p2)
    if node.name == "Union":
        return _bound(node.p1) & _bound(node.p2)
    if node.name in ("LeftJoin", "Minus"):
        return _bound(node.p1)
    if node.name == "Graph":
        return _bound(node.p) | ({node.term} if isinstance(node.term, rdflib.Variable) else set())
    if node.name in ("Project", "SelectQuery"):
        return _bound(node.p) & set(node.PV)
    return _bound(node.p) if node.name in _KEPT else set()
