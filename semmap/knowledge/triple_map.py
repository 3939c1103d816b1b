"""What the mapping is made of: terms as columns, sources of rows, and rows as triples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from semmap.knowledge.vocabulary import SEMMAP

Form = str
"""How a term is kept in columns: a name of `NODES` or `DATATYPES`, "iri" or "term".

- a node: a key, from which the IRI is made;
- a datatype: a value of SQL;
- "iri": the IRI itself;
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
class Column:
    """A term: its form, and the SQL of its value; a "term" also has the SQL of its tag."""

    form: Form
    sql: str
    tag: str | None = None


@dataclass(frozen=True)
class TripleTables:
    """Tables, or functions of tables before them, by the letters that columns use for them."""

    tables: tuple[tuple[str, str], ...]  # letter and table
    where: tuple[str, ...] = ()  # conditions
    map_id: str | None = None  # the column with the map; None where a table has none
    key: str | None = None  # the column of the first table that is unique, if there is one
    one_map: bool = False  # both entities of a row are in one map, as the database checks


@dataclass(frozen=True)
class TripleMap:
    """Rows of a source as triples."""

    property: str  # the IRI; with `name`, its namespace
    source: TripleTables
    subject: Column
    object: Column
    # the SQL of the property's local name, before it is encoded; "" for a whole IRI
    name: str | None = None
    nullable: bool = False  # the object may be null, which is no triple
    shared: bool = False  # statements may have this property, too


@dataclass(frozen=True)
class Computed:
    """A relation between entities that SQL functions decide when it is asked for."""

    property: str  # the IRI
    decide: str  # SQL of the condition for {a} and {b}, ids of entities
    # members, converse: SQL of all {a} for one {b}, and of all {b} for one {a}, where an index has
    # them
    members: str | None = None
    converse: str | None = None


def constant(iri: str) -> Column:
    """Return a column that has the same IRI in each row."""
    return Column("iri", f"'{iri}'::text")


def columns_of(
    source: TripleTables, subject: Column, *columns: tuple[str, Form, str]
) -> Iterator[TripleMap]:
    """Yield a triple map for each property, form and column of a source."""
    for name, form, sql in columns:
        yield TripleMap(f"{SEMMAP}{name}", source, subject, Column(form, sql), nullable=True)
