"""Solutions as a SELECT that is not yet closed: tables, conditions and the variables they bind."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from semmap.knowledge.mapping import TRIPLES
from semmap.knowledge.sparql.values import (
    NUMBERED,
    Parameters,
    are_disjoint,
    as_term,
    encoded,
    same,
)
from semmap.knowledge.triple_map import Form, Value

UNBOUND = Value("term", "NULL::text", "NULL::text")  # a variable that nothing binds, or an error


@dataclass
class Rows:
    """Solutions: one for each row of the tables that meets the conditions."""

    froms: list[str] = field(default_factory=list)  # later ones may refer to earlier ones
    where: list[str] = field(default_factory=list)
    variables: dict[str, Value] = field(default_factory=dict)
    nullable: set[str] = field(default_factory=set)  # the variables that may be unbound

    def select(self, values: Iterable[Value], *, distinct: bool = False) -> str:
        """Return a SELECT of values as the columns c0, c1 ..., a "term" taking two."""
        columns = [sql for value in values for sql in value.columns()]
        named = ", ".join(f"{sql} AS c{i}" for i, sql in enumerate(columns)) or "1 AS c0"
        return f"SELECT {'DISTINCT ' if distinct else ''}{named}{self.tables()}"

    def tables(self) -> str:
        """Return FROM and WHERE."""
        text = f" FROM {', '.join(self.froms)}" if self.froms else ""
        return text + (f" WHERE {' AND '.join(self.where)}" if self.where else "")

    def sure(self) -> dict[str, Value]:
        """Return the variables that each solution binds."""
        return {n: v for n, v in self.variables.items() if n not in self.nullable}

    def closed(self, parameters: Parameters, tail: str = "", *, distinct: bool = False) -> Rows:
        """Return the same solutions as one subquery, with what follows its conditions."""
        alias = parameters.alias("q")
        select = self.select(self.variables.values(), distinct=distinct)
        return Rows(
            [f"LATERAL ({select}{tail}) {alias}"],
            variables=renamed(self.variables, alias),
            nullable=self.nullable & self.variables.keys(),
        )

    def bind(self, name: str, value: Value, namespace: str, *, nullable: bool = False) -> None:
        """Bind a variable, or let the rows be those in which it has this value."""
        known = self.variables.get(name)
        if known is None:
            self.variables[name] = value
            if nullable:
                self.nullable.add(name)
            return
        maybe = [known] * (name in self.nullable) + [value] * nullable
        self.where.append(unless_null(same(known, value, namespace), *maybe))
        if name in self.nullable:
            self.variables[name] = either(known, value, namespace) if nullable else value
            if not nullable:
                self.nullable.discard(name)
        elif not nullable and _says_more(value.form, known.form):
            self.variables[name] = value

    def join(self, other: Rows, namespace: str) -> None:
        """Join other solutions to these; their tables may refer to these tables."""
        self.froms += other.froms
        self.where += other.where
        for name, value in other.variables.items():
            self.bind(name, value, namespace, nullable=name in other.nullable)


def _says_more(form: Form, known: Form) -> bool:
    """Return whether a variable of both forms is better kept as the first one."""
    if form in NUMBERED and known in NUMBERED:
        return NUMBERED.index(form) < NUMBERED.index(known)
    return known in ("term", "iri") and form != "term"


def renamed(values: Mapping[str, Value], alias: str) -> dict[str, Value]:
    """Return values as the columns that `Rows.select` gives them."""
    found, column = {}, 0
    for name, value in values.items():
        tag = f"{alias}.c{column + 1}" if value.tag is not None else None
        found[name] = Value(value.form, f"{alias}.c{column}", tag)
        column += len(value.columns())
    return found


def union_form(values: Iterable[Value | None]) -> Form:
    """Return the form that columns with all these values have."""
    forms = {v.form for v in values if v is not None and v is not UNBOUND}
    if len(forms) > 1 and forms <= {*NUMBERED}:
        return max(forms, key=NUMBERED.index)
    return forms.pop() if len(forms) == 1 else "term"


def in_form(value: Value, form: Form, namespace: str) -> Value:
    """Return a value in a form that `union_form` found."""
    if value is UNBOUND and form != "term":
        return Value(form, f"NULL::{SQL_TYPES.get(form, 'bigint')}")
    return as_term(value, namespace) if form == "term" else replace(value, form=form)


SQL_TYPES: Mapping[Form, str] = {
    "string": "text",
    "iri": "text",
    "type": "text",
    "former": "text",
    "voxel": "text",
    "gml": "text",
    "geojson": "text",
    "integer": "numeric",
    "decimal": "numeric",
    "double": "double precision",
    "boolean": "boolean",
    "time": "timestamptz",
    "geometry": "geometry",
}
"""The SQL type of each form; others are bigint."""


def union(
    parts: list[Rows], parameters: Parameters, namespace: str, *, distinct: bool = False
) -> Rows:
    """Return the solutions of all parts as one subquery."""
    names = list(dict.fromkeys(name for part in parts for name in part.variables))
    forms = {n: union_form(part.variables.get(n) for part in parts) for n in names}
    selects = []
    for part in parts:
        values = [in_form(part.variables.get(n, UNBOUND), forms[n], namespace) for n in names]
        selects.append(part.select(map(_cast, values), distinct=distinct))
    alias = parameters.alias("u")
    shown = {n: Value(forms[n], "", "" if forms[n] == "term" else None) for n in names}
    nullable = {n for n in names for p in parts if n in p.nullable or n not in p.variables}
    return Rows(
        [f"LATERAL ({(' UNION ' if distinct else ' UNION ALL ').join(selects)}) {alias}"],
        variables=renamed(shown, alias),
        nullable=nullable,
    )


def _cast(value: Value) -> Value:
    """Return a value in the SQL type of its form, so that the parts of a union agree."""
    if value.form not in ("integer", "decimal", "double"):
        return value
    return replace(value, sql=f"({value.sql})::{SQL_TYPES[value.form]}")


def either(a: Value, b: Value, namespace: str) -> Value:
    """Return a where it is bound, else b."""
    form = union_form([a, b])
    columns = zip(*(in_form(value, form, namespace).columns() for value in (a, b)), strict=True)
    return Value.of_columns(form, (f"coalesce({x}, {y})" for x, y in columns))


def unless_null(condition: str, *values: Value) -> str:
    """Return a condition that also holds where one of some values is not bound."""
    nulls = [f"{value.sql} IS NULL" for value in values]
    return f"({' OR '.join([*nulls, condition])})" if nulls else condition


def can_join(form: Form, others: Iterable[Form]) -> bool:
    """Return whether a term of a form may be a term of one of other forms."""
    return any(not are_disjoint(form, other) for other in others)


_KEYS = {t.source.tables[0]: t.source.key for t in TRIPLES if t.source.key is not None}
"""The column of a table that is unique."""
_PLAIN = re.compile(r"[a-z_]+ t\d+")
_SAME_KEY = re.compile(r"(t\d+)\.([a-z_]+) = (t\d+)\.\2")


def share_rows(rows: Rows) -> None:
    """Read a row once that patterns join to itself by its key, as paths over geometries do."""
    while joined := next((c for c in rows.where if _is_row_with_itself(rows, c)), None):
        kept, _, gone = _SAME_KEY.fullmatch(joined).groups()  # type: ignore[union-attr]
        old, new = re.compile(rf"\b{gone}\."), f"{kept}."
        rows.froms = [old.sub(new, table) for table in rows.froms if _alias(table) != gone]
        rows.where = [old.sub(new, each) for each in rows.where if each != joined]
        rows.variables = {
            name: replace(v, sql=old.sub(new, v.sql), tag=v.tag and old.sub(new, v.tag))
            for name, v in rows.variables.items()
        }
    rows.where = list(dict.fromkeys(rows.where))


def entity_iri(rows: Rows, value: Value, namespace: str) -> str | None:
    """Return the SQL of an entity's IRI where its row is joined already; None where it is not."""
    if value.form != "entity":
        return None
    for table in rows.froms:
        key = f"{_alias(table)}.id"
        joined = key == value.sql or {f"{value.sql} = {key}", f"{key} = {value.sql}"} & {
            *rows.where
        }
        if joined and _PLAIN.fullmatch(table) and table.startswith("entity "):
            return f"({namespace} || {encoded(f'{_alias(table)}.name')})"
    return None


def _is_row_with_itself(rows: Rows, condition: str) -> bool:
    """Return whether a condition joins a table to itself by a column that is unique."""
    joined = _SAME_KEY.fullmatch(condition)
    if joined is None:
        return False
    a, column, b = joined.groups()
    tables = {_alias(t): t.split(" ")[0] for t in rows.froms if _PLAIN.fullmatch(t)}
    same_table = a != b and a in tables and tables[a] == tables.get(b)
    return same_table and _KEYS.get(tables[a]) == f"{{a}}.{column}"


def _alias(table: str) -> str:
    return table.rsplit(" ", 1)[-1]
