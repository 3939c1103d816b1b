"""Expressions of SPARQL (1.1, section 17) as SQL. An error of SPARQL is null."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC
from typing import Any

import rdflib
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.error import Error
from semmap.knowledge.mapping import DATATYPES
from semmap.knowledge.sparql.constants import tag_and_text
from semmap.knowledge.sparql.geosparql import (
    FUNCTIONS,
    UNITS,
    GeoFunction,
    geometry_of,
    in_one_system,
    literal_geometry,
    on_plane,
    surface_comparison,
    within_distance,
)
from semmap.knowledge.sparql.relation import SQL_TYPES, UNBOUND, in_form, union_form
from semmap.knowledge.sparql.values import (
    NUMERIC,
    are_disjoint,
    as_term,
    is_literal,
    same,
    tag_of,
    text_of,
)
from semmap.knowledge.triple_map import Value
from semmap.knowledge.vocabulary import SEMMAP, XSD
from semmap.language.schema import SPARQL_FUNCTIONS

Environment = Mapping[str, Value]  # the value of each variable that an expression sees

STRING = DATATYPES["string"]

_CASE = '{}({{0}} COLLATE "und-x-icu") COLLATE "default"'
"""By Unicode, where one letter may become two; the server's own tables have single letters."""

_SHA = "encode(sha{}(convert_to({{0}}, 'UTF8')), 'hex')"


_OF_TEXTS = {
    "text": "{}",
    "entity": "entity_of_iri({})",
    "time": "text_time({})",
    "voxel": "NULL::text",
}
"""What makes an argument of another kind of the text of a term."""


class UntranslatedError(Exception):
    """A part of SPARQL's algebra that has no translation to SQL: why."""


class UnitError(Error, ValueError):
    """A unit that a function cannot measure in."""


@dataclass(frozen=True, eq=False)
class Expressions:
    """Translates expressions."""

    bind: Callable[..., str]  # makes a parameter of a value, with a type of SQL
    namespace: str  # the SQL of the map's namespace
    map_id: str  # the SQL of the map's number
    constant: Callable[[Any], Value]  # the value of an IRI
    exists: Callable[[Any, Environment], str]  # the condition of EXISTS, for what a row binds

    def value(self, tree: Any, seen: Environment) -> Value:
        """Return the value of an expression. Raises UntranslatedError: it has no translation."""
        if isinstance(tree, rdflib.Variable):
            found = seen.get(str(tree), UNBOUND)
            return self._term(found) if found.form == "stored" else found
        if isinstance(tree, rdflib.Literal):
            return self._literal(tree)
        if isinstance(tree, rdflib.term.Identifier):
            return self.constant(tree)
        if isinstance(tree, CompValue):
            name = tree.name.removeprefix("Builtin_")
            method = getattr(self, f"_of_{name}", None)
            if method is not None:
                result: Value = method(tree, seen)
                return result
            if name in _WITHOUT_ARGUMENTS:
                return _WITHOUT_ARGUMENTS[name]
            if name in _ROWS:
                translate, sql = _ROWS[name]
                return translate(self, tree, seen, sql)
            raise UntranslatedError(f"{name} has no translation to SQL")
        raise UntranslatedError(f"{type(tree).__name__} has no translation to SQL")

    def condition(self, tree: Any, seen: Environment) -> str:
        """Return the effective boolean value of an expression (section 17.2.2)."""
        return self._boolean(self.value(tree, seen))

    def _literal(self, literal: rdflib.Literal) -> Value:
        text, tag = tag_and_text(literal)
        python = literal.value
        forms: dict[str, tuple[str, Any]] = {
            STRING: ("string", text),
            DATATYPES["integer"]: ("integer", python),
            DATATYPES["decimal"]: ("decimal", python),
            DATATYPES["double"]: ("double", python),
            DATATYPES["boolean"]: ("boolean", python),
        }
        form, known = forms.get(tag, ("term", None))
        if form != "term" and known is not None:
            return Value(form, self.bind(known, SQL_TYPES[form]))
        # One in another time zone keeps it.
        if tag == DATATYPES["time"] and python is not None and not python.utcoffset():
            moment = python if python.tzinfo else python.replace(tzinfo=UTC)
            return Value("time", self.bind(moment, "timestamptz"))
        if tag == DATATYPES["geometry"]:
            return Value("geometry", literal_geometry(text, tag, self.bind))
        return Value("term", self.bind(text), self.bind(tag))

    def _text(self, value: Value) -> str:
        return text_of(value, self.namespace)

    def _term(self, value: Value) -> Value:
        return as_term(value, self.namespace)

    def _boolean(self, value: Value) -> str:
        match value.form:
            case "boolean":
                return value.sql
            case "string":
                return f"({value.sql} <> '')"
            case "integer" | "decimal":
                return f"({value.sql} <> 0)"
            case "double":
                return f"({value.sql} NOT IN (0, 'NaN'))"
            case "term":
                return f"rdf_boolean({value.sql}, {value.tag})"
        return "NULL::boolean"

    def _string(self, value: Value) -> str:
        """Return the SQL of a string, with or without language; null for other terms."""
        if value.form == "string":
            return value.sql
        if value.form == "term":
            return (
                f"(CASE WHEN {value.tag} = '{STRING}' OR starts_with({value.tag}, '@') "
                f"THEN {value.sql} END)"
            )
        return "NULL::text"

    def _simple(self, value: Value) -> str:
        """Return the SQL of a string without language; null for other terms."""
        if value.form == "term":
            return f"(CASE WHEN {value.tag} = '{STRING}' THEN {value.sql} END)"
        return self._string(value)

    def _beside(self, a: Value, b: Value, sql: str) -> str:
        """Return a function of two strings; null where languages do not fit (17.4.3.1.2)."""
        if b.form != "term":
            return sql
        return f"(CASE WHEN {b.tag} IN ('{STRING}', {tag_of(a)}) THEN {sql} END)"

    def _like(self, value: Value, sql: str) -> Value:
        """Return a string that was made from another: with the language of that one."""
        if value.form == "term":
            return Value("term", sql, value.tag)
        return Value("string", sql)

    def _number(self, value: Value) -> str:
        if value.form in NUMERIC:
            return value.sql
        if value.form == "term":
            return f"rdf_number({value.sql}, {value.tag})"
        return "NULL::double precision"

    def _unify(self, values: list[Value]) -> tuple[str, list[Value]]:
        form = union_form(values)
        return form, [in_form(value, form, self.namespace) for value in values]

    def _arguments(self, tree: Any, seen: Environment, *names: str) -> list[Value]:
        return [self.value(tree[name], seen) for name in names if getattr(tree, name) is not None]

    def _logical(self, tree: Any, seen: Environment, operator: str) -> Value:
        parts = [self.condition(each, seen) for each in (tree.expr, *tree.other)]
        return Value("boolean", f"({operator.join(parts)})")

    def _of_UnaryNot(self, tree: Any, seen: Environment) -> Value:
        return Value("boolean", f"(NOT {self.condition(tree.expr, seen)})")

    def _of_BOUND(self, tree: Any, seen: Environment) -> Value:
        return Value("boolean", f"({seen.get(str(tree.arg), UNBOUND).sql} IS NOT NULL)")

    def _existing(self, tree: Any, seen: Environment, sql: str) -> Value:
        return Value("boolean", sql.format(self.exists(tree.graph, seen)))

    def _of_IF(self, tree: Any, seen: Environment) -> Value:
        test = self.condition(tree.arg1, seen)
        form, (yes, no) = self._unify(self._arguments(tree, seen, "arg2", "arg3"))
        pairs = zip(yes.columns(), no.columns(), strict=True)
        # An error in the condition is an error.
        columns = [f"(CASE WHEN {test} THEN {y} WHEN NOT {test} THEN {n} END)" for y, n in pairs]
        return Value.of_columns(form, columns)

    def _of_COALESCE(self, tree: Any, seen: Environment) -> Value:
        form, values = self._unify([self.value(each, seen) for each in tree.arg])
        columns = zip(*(value.columns() for value in values), strict=True)
        if form != "term":
            return Value.of_columns(form, (f"coalesce({', '.join(column)})" for column in columns))
        texts, tags = columns
        cases = " ".join(
            f"WHEN {text} IS NOT NULL THEN {tag}" for text, tag in zip(texts, tags, strict=True)
        )
        return Value("term", f"coalesce({', '.join(texts)})", f"(CASE {cases} END)")

    def _of_RelationalExpression(self, tree: Any, seen: Environment) -> Value:
        if tree.op in ("IN", "NOT IN"):
            value = self.value(tree.expr, seen)
            each = [self._equal(value, self.value(item, seen)) for item in _listed(tree.other)]
            found = f"({' OR '.join(each)})" if each else "false"
            return Value("boolean", f"(NOT {found})" if tree.op == "NOT IN" else found)
        left, right = self.value(tree.expr, seen), self.value(tree.other, seen)
        if tree.op == "=":
            return Value("boolean", self._equal(left, right))
        if tree.op == "!=":
            return Value("boolean", f"(NOT {self._equal(left, right)})")
        condition = self._ordered(left, tree.op, right)
        near = within_distance(tree, lambda part: self.value(part, seen), self._number, self.map_id)
        return Value("boolean", f"({near} AND {condition})" if near else condition)

    def _equal(self, a: Value, b: Value) -> str:
        both_numeric = a.form in NUMERIC and b.form in NUMERIC
        if both_numeric or (a.form == b.form and a.form not in ("term", "geometry")):
            return f"({a.sql} = {b.sql})"
        if not is_literal(a.form) and not is_literal(b.form) and "term" not in (a.form, b.form):
            if are_disjoint(a.form, b.form):
                return f"({a.sql} IS NULL AND {b.sql} IS NULL AND NULL)"
            return f"({same(a, b, self.namespace)})"
        x, y = self._term(a), self._term(b)
        return f"rdf_equal({x.sql}, {x.tag}, {y.sql}, {y.tag})"

    def _ordered(self, a: Value, operator: str, b: Value) -> str:
        forms = {a.form, b.form}
        if forms == {"string"}:
            return f'({a.sql} COLLATE "C" {operator} {b.sql} COLLATE "C")'
        if forms <= {*NUMERIC} or forms in ({"time"}, {"boolean"}):
            if (decided := surface_comparison(a, operator, b)) is not None:
                return decided
            return f"({a.sql} {operator} {b.sql})"
        if "term" in forms and forms & {*NUMERIC}:
            return f"({self._number(a)} {operator} {self._number(b)})"
        x, y = self._term(a), self._term(b)
        return f"(rdf_order({x.sql}, {x.tag}, {y.sql}, {y.tag}) {operator} 0)"

    def _of_sameTerm(self, tree: Any, seen: Environment) -> Value:
        a, b = self._arguments(tree, seen, "arg1", "arg2")
        return Value("boolean", f"({same(a, b, self.namespace)})")

    def _of_AdditiveExpression(self, tree: Any, seen: Environment) -> Value:
        found = self.value(tree.expr, seen)
        for operator, operand in zip(tree.op, tree.other, strict=True):
            found = self._calculated(found, str(operator), self.value(operand, seen))
        return found

    _of_MultiplicativeExpression = _of_AdditiveExpression

    def _calculated(self, a: Value, operator: str, b: Value) -> Value:
        if a.form in NUMERIC and b.form in NUMERIC:
            form = max(a.form, b.form, key=NUMERIC.index)
            if operator == "/" and form == "integer":
                form = "decimal"
            x, y = (f"({v.sql})::{SQL_TYPES[form]}" for v in (a, b))
            if form == "double":
                return Value(form, f"rdf_calculate_double('{operator}', {x}, {y})")
            if operator == "/":
                y = f"nullif({y}, 0)"
            return Value(form, f"({x} {operator} {y})")
        x_, y_ = self._term(a), self._term(b)
        call = f"rdf_calculate('{operator}', {x_.sql}, {x_.tag}, {y_.sql}, {y_.tag})"
        return Value("term", f"({call})[1]", f"({call})[2]")

    def _signed(self, tree: Any, seen: Environment, sign: str) -> Value:
        value = self.value(tree.expr, seen)
        if value.form in NUMERIC:
            return Value(value.form, f"({sign} {value.sql})")
        return self._calculated(Value("integer", "0::numeric"), sign, value)

    def _rounded(self, tree: Any, seen: Environment, sql: str) -> Value:
        value = self.value(tree.arg, seen)
        if value.form in NUMERIC:
            return Value(value.form, f"({sql.format(value.sql)})")
        number = f"({sql.format(self._number(value))})"
        double = f"{value.tag} IN ('{XSD}double', '{XSD}float')"
        if value.form != "term":
            return UNBOUND
        text = (
            f"(CASE WHEN {double} THEN rdf_double({number}) WHEN {value.tag} = '{XSD}decimal' "
            f"THEN rdf_decimal({number}::numeric) ELSE {number}::numeric::text END)"
        )
        return Value("term", text, f"(CASE WHEN {double} THEN '{XSD}double' ELSE {value.tag} END)")

    def _of_STR(self, tree: Any, seen: Environment) -> Value:
        return Value("string", self._text(self.value(tree.arg, seen)))

    def _of_LANG(self, tree: Any, seen: Environment) -> Value:
        term = self._term(self.value(tree.arg, seen))
        return Value(
            "string",
            f"(CASE WHEN starts_with({term.tag}, '@') THEN substr({term.tag}, 2) "
            f"WHEN {term.tag} NOT IN ('I', 'B') AND {term.sql} IS NOT NULL THEN '' END)",
        )

    def _of_LANGMATCHES(self, tree: Any, seen: Environment) -> Value:
        text, range_ = (self._string(v) for v in self._arguments(tree, seen, "arg1", "arg2"))
        return Value(
            "boolean",
            f"(CASE WHEN {range_} = '*' THEN {text} <> '' ELSE lower({text}) = lower({range_}) "
            f"OR starts_with(lower({text}), lower({range_}) || '-') END)",
        )

    def _of_DATATYPE(self, tree: Any, seen: Environment) -> Value:
        value = self.value(tree.arg, seen)
        if is_literal(value.form):
            type_ = DATATYPES[value.form]
            return Value("iri", f"(CASE WHEN {value.sql} IS NOT NULL THEN '{type_}' END)")
        term = self._term(value)
        return Value(
            "iri",
            f"(CASE WHEN starts_with({term.tag}, '@') THEN '{rdflib.RDF.langString}' "
            f"WHEN {term.tag} NOT IN ('I', 'B') THEN {term.tag} END)",
        )

    def _of_IRI(self, tree: Any, seen: Environment) -> Value:
        value = self.value(tree.arg, seen)
        if not is_literal(value.form) and value.form != "term":
            return value
        if tree.base is not None:
            if not isinstance(tree.arg, rdflib.Literal):
                raise UntranslatedError("IRI resolves a computed text against BASE")
            return self.constant(rdflib.URIRef(str(tree.arg), base=tree.base))
        text = value.sql if value.form == "term" else self._string(value)
        return Value("term", text, "'I'::text")

    _of_URI = _of_IRI

    def _of_STRDT(self, tree: Any, seen: Environment) -> Value:
        text, type_ = self._arguments(tree, seen, "arg1", "arg2")
        return Value("term", self._simple(text), self._text(type_))

    def _of_STRLANG(self, tree: Any, seen: Environment) -> Value:
        text, language = self._arguments(tree, seen, "arg1", "arg2")
        return Value("term", self._simple(text), f"('@' || lower({self._simple(language)}))")

    def _tagged(self, tree: Any, seen: Environment, condition: str) -> Value:
        tag = tag_of(self.value(tree.arg, seen))
        known = f"{self.value(tree.arg, seen).sql} IS NOT NULL"
        return Value("boolean", f"(CASE WHEN {known} THEN {condition.format(tag)} END)")

    def _of_isNUMERIC(self, tree: Any, seen: Environment) -> Value:
        value = self.value(tree.arg, seen)
        valid = f"text_number({self._text(value)}) IS NOT NULL" if value.form == "term" else "true"
        return self._tagged(tree, seen, f"(is_numeric_tag({{0}}) AND {valid})")

    def _of_BNODE(self, tree: Any, seen: Environment) -> Value:
        if tree.arg is not None:
            raise UntranslatedError("BNODE with a label has no translation to SQL")
        return Value("term", "gen_random_uuid()::text", "'B'::text")

    def _length(self, tree: Any, seen: Environment, sql: str) -> Value:
        return Value("integer", f"{sql.format(self._string(self.value(tree.arg, seen)))}::numeric")

    def _made(self, tree: Any, seen: Environment, sql: str) -> Value:
        value = self.value(tree.arg, seen)
        return self._like(value, sql.format(self._string(value)))

    def _of_CONCAT(self, tree: Any, seen: Environment) -> Value:
        values = [self.value(each, seen) for each in _listed(tree.arg)]
        joined = " || ".join(self._string(v) for v in values) if values else "''::text"
        if not values or any(v.form != "term" for v in values):
            return Value("string", f"({joined})")
        tags = [v.tag for v in values]
        alike = " AND ".join(f"{tag} = {tags[0]}" for tag in tags[1:]) or "true"
        return Value(
            "term", f"({joined})", f"(CASE WHEN {alike} THEN {tags[0]} ELSE '{STRING}' END)"
        )

    def _pair(self, tree: Any, seen: Environment, sql: str) -> Value:
        a, b = self._arguments(tree, seen, "arg1", "arg2")
        found = sql.format(self._string(a), self._string(b))
        return Value("boolean", f"({self._beside(a, b, found)})")

    def _around(self, tree: Any, seen: Environment, sql: str) -> Value:
        a, b = self._arguments(tree, seen, "arg1", "arg2")
        x, y = self._string(a), self._string(b)
        found = f"(CASE WHEN strpos({x}, {y}) > 0 THEN {sql.format(x, y)} ELSE '' END)"
        found = f"(CASE WHEN {x} IS NOT NULL AND {y} IS NOT NULL THEN {found} END)"
        found = self._beside(a, b, found)
        if a.form != "term":
            return Value("string", found)
        return Value(
            "term", found, f"(CASE WHEN strpos({x}, {y}) > 0 THEN {a.tag} ELSE '{STRING}' END)"
        )

    def _of_SUBSTR(self, tree: Any, seen: Environment) -> Value:
        text = self.value(tree.arg, seen)
        start = self._place(tree.start, seen)
        if tree.length is None:
            return self._like(text, f"substr({self._string(text)}, {start})")
        length = self._place(tree.length, seen)
        return self._like(text, f"substr({self._string(text)}, {start}, greatest({length}, 0))")

    def _place(self, tree: Any, seen: Environment) -> str:
        """Return the SQL of a number of letters; beyond all texts where it is too large."""
        return f"least(greatest({self._number(self.value(tree, seen))}, -1e9), 1e9)::int"

    def _flags(self, tree: Any, seen: Environment) -> str:
        if tree.flags is None:
            return "''"
        flags = self._string(self.value(tree.flags, seen))
        # XPath: s lets the dot match a newline, m lets ^ and $ match at each line. Flags that
        # PostgreSQL alone has are an error.
        return f"translate({flags}, 'mbcegnptws', 'w????????')"

    def _pattern(self, tree: Any, seen: Environment) -> str:
        pattern = self._string(self.value(tree.pattern, seen))
        return f"rdf_pattern({pattern}, {self._string(self.value(tree.flags or _NONE, seen))})"

    def _of_REGEX(self, tree: Any, seen: Environment) -> Value:
        text, pattern = self._string(self.value(tree.text, seen)), self._pattern(tree, seen)
        function = "regexp_like" if _is_constant(tree) else "rdf_regex"
        return Value("boolean", f"{function}({text}, {pattern}, {self._flags(tree, seen)})")

    def _of_REPLACE(self, tree: Any, seen: Environment) -> Value:
        text = self.value(tree.arg, seen)
        pattern = self._pattern(tree, seen)
        by = self._string(self.value(tree.replacement, seen))
        by = f"regexp_replace({by}, '\\$(\\d)', '\\\\\\1', 'g')"
        flags = f"{self._flags(tree, seen)} || 'g'"
        function = "regexp_replace" if _is_constant(tree) else "rdf_replace"
        return self._like(text, f"{function}({self._string(text)}, {pattern}, {by}, {flags})")

    def _plain(self, tree: Any, seen: Environment, sql: str) -> Value:
        return Value("string", sql.format(self._string(self.value(tree.arg, seen))))

    def _field(self, tree: Any, seen: Environment, name: str) -> Value:
        value = self.value(tree.arg, seen)
        form = "decimal" if name == "second" else "integer"
        local = "NULL::timestamp"
        if value.form == "time":
            local = f"{value.sql} AT TIME ZONE 'UTC'"
        elif value.form == "term":  # in the time zone that was stated
            kinds = f"'{XSD}dateTime'" + f", '{XSD}date'" * (name in ("year", "month", "day"))
            local = f"(CASE WHEN {value.tag} IN ({kinds}) THEN text_local_time({value.sql}) END)"
        return Value(form, f"extract({name} FROM {local})")

    def _of_Function(self, tree: Any, seen: Environment) -> Value:
        iri = str(tree.iri)
        arguments = [self.value(each, seen) for each in _listed(tree.expr or ())]
        cast = CASTS.get(iri)
        if cast is not None and len(arguments) == 1:
            found = self._cast(arguments[0], *cast)
            if iri == f"{XSD}float" and found is not UNBOUND:
                tag = f"(CASE WHEN {found.sql} IS NOT NULL THEN '{XSD}float' END)"
                return Value("term", f"rdf_double({found.sql})", tag)
            return found
        function = FUNCTIONS.get(iri)
        if function is None:
            raise UntranslatedError(f"there is no function <{iri}>")
        if len(arguments) not in function.counts:
            counts = " or ".join(map(str, function.counts))
            raise UntranslatedError(
                f"{function.name} takes {counts} arguments, not {len(arguments)}"
            )
        texts, sql = [], function.sql
        units: tuple[str, ...] = ()
        if function.metric and len(arguments) == len(function.arguments):
            *arguments, _ = arguments
            sql, units = self._in_unit(function, _listed(tree.expr)[-1])
        for kind, value, given in zip(
            function.arguments, arguments, _listed(tree.expr), strict=False
        ):
            if kind == "text" and isinstance(given, rdflib.Literal):
                texts.append(self.bind(str(given)))
            elif kind == "literal":
                written = [self._text(value), tag_of(value)]
                if isinstance(given, rdflib.Literal):
                    written = [self.bind(part) for part in tag_and_text(given)]
                texts.append(", ".join(written))
            elif kind == "geometry":
                texts.append(geometry_of(value))
            elif kind == "number":
                texts.append(self._number(value))
            elif kind == value.form:
                texts.append(value.sql)
            else:
                texts.append(_OF_TEXTS[kind].format(self._text(value)))
        sql = on_plane(sql, texts)
        if function.arguments[:2] == ("geometry", "geometry") and "ground_measure" not in sql:
            texts[:2] = in_one_system(texts[0], texts[1], self.map_id)
        between = tuple(texts) if function is FUNCTIONS[f"{SEMMAP}distance"] else None
        return Value(
            function.result, f"({sql.format(*texts, *units, map=self.map_id)})", between=between
        )

    def _in_unit(self, function: GeoFunction, unit: Any) -> tuple[str, tuple[str, ...]]:
        """Return the SQL of a function that measures in a unit, and of the last argument."""
        kind, iri = function.arguments[-1], str(unit)
        if not isinstance(unit, (rdflib.URIRef, rdflib.Literal)):
            raise UntranslatedError(f"the unit of {function.name} is not an IRI that it has")
        if iri in UNITS[kind]:
            return function.metric, (f"{UNITS[kind][iri]!r}::float8",)
        if iri not in UNITS["angle"] or kind == "area":
            known = ", ".join(each.rpartition("/")[2] for each in UNITS[kind])
            raise UnitError(f"<{iri}> is no unit of {function.name}: it knows {known}")
        degrees = UNITS["angle"][iri]
        if function.result == "geometry":
            flat = f"ST_Buffer({{0}}, {{1}} * {degrees!r})"
        else:
            flat = f"{function.sql} / {degrees!r}"
        return f"CASE WHEN NOT is_metric({{0}}) THEN {flat} END", ()

    def _cast(self, value: Value, form: str, sql: str, kept: tuple[str, ...]) -> Value:
        if value.form == form:
            return value
        if form == "string":
            return Value("string", self._text(value))
        if value.form in kept:
            converted = value.sql
            if value.form == "boolean":
                converted = f"({value.sql})::int"
            if form == "integer":
                converted = f"trunc(({converted})::numeric)"
            if form == "boolean":
                return Value("boolean", self._boolean(value))
            return Value(form, f"({converted})::{SQL_TYPES[form]}")
        if value.form == "term" and form != "time":
            return Value(form, self._cast_term(value, form, sql))
        if value.form in ("string", "term"):
            return Value(form, sql.format(value.sql))
        return UNBOUND

    def _cast_term(self, value: Value, form: str, sql: str) -> str:
        """Return the SQL of a number or a boolean of a term, by its datatype."""
        written, number = sql.format(value.sql), f"rdf_number({value.sql}, {value.tag})"
        if form == "boolean":
            ebv = f"rdf_boolean({value.sql}, {value.tag})"
            return f"(CASE WHEN is_numeric_tag({value.tag}) THEN {ebv} ELSE {written} END)"
        if form == "integer":
            number = f"trunc({number})"
        truth = f"text_boolean({value.sql})::int::{SQL_TYPES[form]}"
        return (
            f"(CASE WHEN {value.tag} = '{XSD}boolean' THEN {truth} "
            f"ELSE coalesce({written}, {number}::{SQL_TYPES[form]}) END)"
        )


def _listed(expressions: Any) -> list[Any]:
    """Return a list of expressions, which rdflib has as rdf:nil where it is empty."""
    return [] if isinstance(expressions, rdflib.URIRef) else list(expressions)


def _is_constant(tree: Any) -> bool:
    """Return whether a pattern is of the text, where a wrong one is an error of the query."""
    return isinstance(tree.pattern, rdflib.Literal)


_NONE = rdflib.Literal("")

SHARED: Mapping[str, str] = {
    "ABS": "abs({0})",
    "CEIL": "ceil({0})",
    "FLOOR": "floor({0})",
    "ROUND": "floor({0}) + ({0} - floor({0}) >= 0.5)::int",  # a sum with 0.5 would be rounded
    "STRLEN": "length({0})",
    "UCASE": _CASE.format("upper"),
    "LCASE": _CASE.format("lower"),
    "STRSTARTS": "starts_with({0}, {1})",
    "STRENDS": "right({0}, length({1})) = {1}",
    "CONTAINS": "strpos({0}, {1}) > 0",
}
"""The SQL of each of `semmap.language.schema.SPARQL_FUNCTIONS`."""

_BY_KINDS = {
    ("number", "number"): Expressions._rounded,
    ("text", "number"): Expressions._length,
    ("text", "text"): Expressions._made,
    ("text", "text", "boolean"): Expressions._pair,
}

_ROWS: Mapping[str, tuple[Callable[[Expressions, Any, Environment, str], Value], str]] = {
    **{
        name: (_BY_KINDS[*function.arguments, function.result], SHARED[name])
        for name, function in SPARQL_FUNCTIONS.items()
    },
    "ConditionalAndExpression": (Expressions._logical, " AND "),
    "ConditionalOrExpression": (Expressions._logical, " OR "),
    "EXISTS": (Expressions._existing, "{}"),
    "NOTEXISTS": (Expressions._existing, "(NOT {})"),
    "UnaryMinus": (Expressions._signed, "-"),
    "UnaryPlus": (Expressions._signed, "+"),
    "isIRI": (Expressions._tagged, "{0} = 'I'"),
    "isURI": (Expressions._tagged, "{0} = 'I'"),
    "isBLANK": (Expressions._tagged, "{0} = 'B'"),
    "isLITERAL": (Expressions._tagged, "{0} NOT IN ('I', 'B')"),
    "STRBEFORE": (Expressions._around, "left({0}, strpos({0}, {1}) - 1)"),
    "STRAFTER": (Expressions._around, "substr({0}, strpos({0}, {1}) + length({1}))"),
    "ENCODE_FOR_URI": (Expressions._plain, "iri_encode({0})"),
    "MD5": (Expressions._plain, "md5({0})"),
    "SHA256": (Expressions._plain, _SHA.format(256)),
    "SHA384": (Expressions._plain, _SHA.format(384)),
    "SHA512": (Expressions._plain, _SHA.format(512)),
    "YEAR": (Expressions._field, "year"),
    "MONTH": (Expressions._field, "month"),
    "DAY": (Expressions._field, "day"),
    "HOURS": (Expressions._field, "hour"),
    "MINUTES": (Expressions._field, "minute"),
    "SECONDS": (Expressions._field, "second"),
}
"""By rdflib's names: what translates a function, and its SQL."""

_WITHOUT_ARGUMENTS: Mapping[str, Value] = {
    "TrueFilter": Value("boolean", "true"),
    "NOW": Value("time", "now()"),
    "RAND": Value("double", "random()"),
    "STRUUID": Value("string", "gen_random_uuid()::text"),
    "UUID": Value("term", "('urn:uuid:' || gen_random_uuid())", "'I'::text"),
}

CASTS: Mapping[str, tuple[str, str, tuple[str, ...]]] = {
    f"{XSD}string": ("string", "{0}", ()),
    f"{XSD}integer": ("integer", "text_integer({0})", (*NUMERIC, "boolean")),
    f"{XSD}decimal": ("decimal", "text_decimal({0})", (*NUMERIC, "boolean")),
    f"{XSD}double": ("double", "text_number({0})", (*NUMERIC, "boolean")),
    f"{XSD}float": ("double", "text_number({0})", (*NUMERIC, "boolean")),
    f"{XSD}boolean": ("boolean", "text_boolean({0})", NUMERIC),
    f"{XSD}dateTime": ("time", "text_time({0})", ()),
}
"""The casts (section 17.5): form, SQL from a text, and the forms that are converted."""
