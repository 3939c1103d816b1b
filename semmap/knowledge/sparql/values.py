"""Terms as columns of SQL: their IRIs, texts and tags, and when two of them are the same.

Whatever a query says reaches the server as the value of a parameter (`Parameters.bind`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from semmap.knowledge.mapping import DATATYPES, NODES
from semmap.knowledge.triple_map import Form, Value
from semmap.knowledge.vocabulary import TYPE

NUMERIC = ("integer", "decimal", "double")
"""The forms of numbers, each before those that it is promoted to."""


@dataclass
class Parameters:
    """The parameters of a statement, and the numbers of its aliases."""

    values: dict[str, Any] = field(default_factory=dict)
    _aliases: int = 0

    def bind(self, value: Any, type_: str = "text") -> str:
        """Return the SQL of a parameter with a value."""
        for name, known in self.values.items():
            if type(known) is type(value) and known == value:
                return f"%({name})s::{type_}"
        name = f"p{len(self.values)}"
        self.values[name] = value
        return f"%({name})s::{type_}"

    def alias(self, letter: str = "t") -> str:
        """Return an alias that no other table has."""
        self._aliases += 1
        return f"{letter}{self._aliases}"


def is_literal(form: Form) -> bool:
    """Return whether all terms of a form are literals."""
    return form in DATATYPES


def are_disjoint(a: Form, b: Form) -> bool:
    """Return whether no term has both forms: an entity is never kept as an "iri"."""
    if a == b or "term" in (a, b) or "stored" in (a, b):
        return False
    if "resource" in (a, b):
        return is_literal(a) or is_literal(b)
    if is_literal(a) or is_literal(b):
        return True
    return "iri" not in (a, b) or "entity" in (a, b)


NUMBERED = ("entity", "resource", "stored")
"""The forms whose values are numbers of entities and terms, each before those that have more."""

NO_NUMBER = f"({-(2**63)})::bigint"
"""The number of a term that no statement has."""

_TEXTS: Mapping[Form, str] = {
    **dict.fromkeys(("term", "iri", "string", "gml", "geojson"), "{}"),
    **dict.fromkeys(("integer", "boolean"), "({})::text"),
    "decimal": "rdf_decimal(({})::numeric)",
    "double": "rdf_double({})",
    "time": "rdf_time({})",
    "geometry": "geometry_text({})",
    # What `type_iri` returns, without a call for each row: the server inlines no subselect.
    "type": "coalesce((SELECT n.iri FROM semantic_type n WHERE n.name = {0}), "
    f"'{TYPE}' || iri_encode({{0}}))",
}
"""The SQL of the text of a term of each form but nodes of tables."""


def text_of(value: Value, namespace: str) -> str:
    """Return the SQL of a term's text, its IRI or its lexical form, from that of the namespace."""
    if value.form in _TEXTS:
        return _TEXTS[value.form].format(value.sql)
    if value.form in ("resource", "stored"):
        entity = text_of(Value("entity", value.sql), namespace)
        term = f"(SELECT n.text FROM term n WHERE n.id = {value.sql})"
        return f"(CASE WHEN {value.sql} > 0 THEN {entity} ELSE {term} END)"
    node = NODES[value.form]
    if node.of_map:
        return (
            f"(SELECT {namespace} || '{node.prefix}' || {encoded('n.name')} "
            f"FROM entity n WHERE n.id = {value.sql})"
        )
    if node.keyed:
        table, column, _ = node.keyed
        key = f"SELECT iri_encode(n.{column}::text) FROM {table} n WHERE n.id = {value.sql}"
        return f"('{node.prefix}' || ({key}))"
    return f"('{node.prefix}' || {value.sql})"


def encoded(name: str) -> str:
    """Return the SQL of a name as a part of an IRI; most names are one, which a call would slow."""
    return f"CASE WHEN {name} ~ '^[A-Za-z0-9_.~-]*$' THEN {name} ELSE iri_encode({name}) END"


def key_of(value: Value, form: Form) -> Value:
    """Return an "iri" as the key of a node that is not of a map; null where it is another IRI."""
    node = NODES[form]
    begins, key = (
        f"starts_with({value.sql}, '{node.prefix}')",
        f"substr({value.sql}, {len(node.prefix) + 1})",
    )
    if node.keyed is None:
        number = f"CASE WHEN {key} ~ '^[0-9]{{1,18}}$' THEN {key}::bigint END"
        whole = key if form in ("former", "voxel") else number
        return Value(form, f"(CASE WHEN {begins} THEN {whole} END)")
    table, column, type_ = node.keyed
    same_key = f"iri_encode(n.{column}) = {key}"
    if type_ == "uuid":
        valid = f"{key} ~ '^[0-9a-f]{{8}}(-[0-9a-f]{{4}}){{3}}-[0-9a-f]{{12}}$'"
        same_key = f"n.{column} = CASE WHEN {valid} THEN {key}::uuid END"
    return Value(form, f"(SELECT n.id FROM {table} n WHERE {begins} AND {same_key})")


def tag_of(value: Value) -> str:
    """Return the SQL of a term's tag."""
    if value.tag is not None:
        return value.tag
    if value.form == "stored":
        term = f"(SELECT n.tag FROM term n WHERE n.id = {value.sql})"
        return f"(CASE WHEN {value.sql} > 0 THEN 'I' ELSE {term} END)"
    return f"'{DATATYPES.get(value.form, 'I')}'::text"


def as_term(value: Value, namespace: str) -> Value:
    """Return a value as a "term": a null stays null."""
    if value.form == "term":
        return value
    return Value("term", text_of(value, namespace), tag_of(value), value.constant)


def number_of(value: Value, namespace: str) -> str:
    """Return the SQL of the number of a term; `NO_NUMBER` where no statement has it."""
    if value.form in NUMBERED:
        return value.sql
    text, tag = text_of(value, namespace), tag_of(value)
    found = (
        f"(SELECT n.id FROM term n WHERE md5(n.text)::uuid = md5({text})::uuid "
        f"AND n.tag = {tag} AND n.text = {text})"
    )
    if value.form == "term" and not value.constant:
        found = f"CASE WHEN {tag} = 'I' THEN entity_of_iri({text}) END, {found}"
    known = f"coalesce({found}, {NO_NUMBER})"
    return known if value.constant else f"CASE WHEN {value.sql} IS NOT NULL THEN {known} END"


def same(a: Value, b: Value, namespace: str) -> str:
    """Return the condition that two terms are the same."""
    if are_disjoint(a.form, b.form):
        return "false"
    if {a.form, b.form} & {"resource", "stored"}:
        return f"{number_of(a, namespace)} = {number_of(b, namespace)}"
    if a.form == b.form and a.form != "term":
        if a.form == "geometry":
            return f"ST_OrderingEquals({a.sql}, {b.sql})"
        return f"{a.sql} = {b.sql}"
    texts = f"{text_of(a, namespace)} = {text_of(b, namespace)}"
    return f"({texts} AND {tag_of(a)} = {tag_of(b)})"
