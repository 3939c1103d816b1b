"""Rows that patterns join to themselves, read once."""

from __future__ import annotations

import re
from dataclasses import replace

from semmap.knowledge.mapping import TRIPLES
from semmap.knowledge.sparql.relation import Rows
from semmap.knowledge.sparql.values import Value, encoded

_KEYS = {t.source.tables[0][1]: t.source.key for t in TRIPLES if t.source.key is not None}
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
