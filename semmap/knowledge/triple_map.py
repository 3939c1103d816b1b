"""What the mapping is made of: terms as columns, sources of rows, and rows as triples."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from semmap.knowledge.vocabulary import SEMMAP

Form = str
"""How a term is kept in columns: a name of `NODES` or `DATATYPES`, "iri" or "term".

- a node: a key, from which the IRI is made;
- a datatype: a value of SQL;
- "iri": the IRI itself;
- "resource": the number of an entity or, negative, of an IRI in `term`;
- "stored": the number of an entity or, negative, of any term in `term`;
- "term": any term, as its text and its tag (`schema/functions/500_knowledge.sql`).
"""


@dataclass(frozen=True)
class Node:
    """An IRI template."""

    prefix: str  # before the key
    # the key is the id of an entity, and the IRI is made of the namespace of its map, `prefix` and
    # its name
    of_map: bool = False
    # table, column and its type: the key is the `id` of a row, and the IRI is `prefix` and the
    # column, so that it is the same in all databases. Else, the IRI is `prefix` and the key
    keyed: tuple[str, str, str] | None = None


@dataclass(frozen=True)
class Value:
    """A term in SQL; in a triple map, {a}, {b} ... stand for the tables of its source."""

    form: Form
    sql: str  # its value, key, IRI or text; null where it is not bound
    tag: str | None = None  # of a "term"
    constant: tuple[str, str] | None = None  # text and tag of a term that a query has
    between: tuple[str, ...] | None = None  # of a distance: the two entities

    @classmethod
    def of_columns(cls, form: Form, columns: Iterable[str]) -> Value:
        """Return a value of a form from the SQL of its columns."""
        sql, *tag = columns
        return cls(form, sql, tag[0] if tag else None)

    def columns(self) -> tuple[str, ...]:
        """Return the SQL of its columns."""
        return (self.sql,) if self.tag is None else (self.sql, self.tag)

    def placed(self, letters: Mapping[str, str]) -> Value:
        """Return the value in the tables that letters stand for."""
        columns = (sql.format(**letters) for sql in self.columns())
        return Value.of_columns(self.form, columns)


@dataclass(frozen=True)
class TripleTables:
    """Tables, or functions of tables before them, which columns call {a}, {b} ..."""

    tables: tuple[str, ...]
    where: tuple[str, ...] = ()  # conditions
    map_id: str | None = None  # the column with the map; None where a table has none
    key: str | None = None  # the column of the first table that is unique, if there is one
    one_map: bool = False  # both entities of a row are in one map, as the database checks


@dataclass(frozen=True)
class TripleMap:
    """Rows of a source as triples."""

    property: str  # the IRI; with `name`, its namespace
    source: TripleTables
    subject: Value
    object: Value
    # the SQL of the property's local name, before it is encoded; "" for a whole IRI
    name: str | None = None
    nullable: bool = False  # the object may be null, which is no triple
    shared: bool = False  # statements may have this property, too

    def verb(self, letters: Mapping[str, str]) -> tuple[str, str | None]:
        """Return the SQL of the property and, where it has one, of its local name."""
        if self.name is None:
            return f"'{self.property}'", None
        name = self.name.format(**letters)
        return f"'{self.property}' || iri_encode({name})" if self.property else name, name

    def rows(self) -> tuple[list[str], list[str]]:
        """Return tables and conditions, with the letters as aliases and the map as parameter."""
        source, subject = self.source, self.subject.placed(OWN_LETTERS)
        tables = [
            named if " AS " in (named := table.format(**OWN_LETTERS)) else f"{named} {letter}"
            for letter, table in zip(OWN_LETTERS, source.tables, strict=False)
        ]
        where = [each.format(**OWN_LETTERS) for each in source.where]
        if source.map_id is not None:
            where.append(f"{source.map_id.format(**OWN_LETTERS)} = %(map)s")
        elif subject.form == "entity":
            tables.append("entity of_map")
            where.append(f"of_map.id = {subject.sql} AND of_map.map_id = %(map)s")
        return tables, where

    def tables(self) -> tuple[list[str], list[str]]:
        """Return the same of the rows whose object is not null."""
        tables, where = self.rows()
        return tables, [*where, f"{self.object.placed(OWN_LETTERS).sql} IS NOT NULL"]


LETTERS = "abcdef"
OWN_LETTERS = {letter: letter for letter in LETTERS}


def letters_from(first: int) -> dict[str, str]:
    """Return other letters for those of tables that follow others."""
    return {a: f"{{{b}}}" for a, b in zip(LETTERS, LETTERS[first:], strict=False)}


@dataclass(frozen=True)
class Computed:
    """A relation between entities that SQL functions decide when it is asked for."""

    property: str  # the IRI
    decide: str  # SQL of the condition for {a} and {b}, ids of entities
    # members, converse: SQL of all {a} for one {b}, and of all {b} for one {a}, where an index has
    # them
    members: str | None = None
    converse: str | None = None
    # pairs: SQL of all {a} and {b} of a map {map}, as columns a and b, and the name by which they
    # are kept (`schema/functions/475_kept_relations.sql`)
    pairs: str | None = None
    kept: str | None = None


def constant(iri: str) -> Value:
    """Return a column that has the same IRI in each row."""
    return Value("iri", f"'{iri}'::text")


def constant_iri(value: Value) -> str | None:
    """Return the IRI of a `constant`; None for a column with more than one."""
    found = re.fullmatch("'([^']*)'::text", value.sql)
    return found and found[1]


def columns_of(
    source: TripleTables, subject: Value, *columns: tuple[str, Form, str]
) -> Iterator[TripleMap]:
    """Yield a triple map for each property, form and column of a source."""
    for name, form, sql in columns:
        yield TripleMap(f"{SEMMAP}{name}", source, subject, Value(form, sql), nullable=True)
