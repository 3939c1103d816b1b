"""The query language on fields of 50,000 statements, compared with rdflib voxel by voxel.

A second table answers the same queries by SQL: docs/decisions/one_evaluator.md has the decision.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import rdflib
from numpy.typing import NDArray
from psycopg.pq import Format

from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, median_seconds, print_rows
from semmap.database import open_engine
from semmap.fields.queries import SelectResult, query
from semmap.fields.queries.columns import (
    ALL,
    Demand,
    Entities,
    Numbers,
    StatementColumn,
    StatementRelation,
    Statements,
    VoxelColumn,
)
from semmap.fields.queries.voxel_functions import VOXEL_FUNCTIONS
from semmap.geometry.voxel_keys import keys_of, voxels_of_keys
from semmap.language.parser import parse_query
from semmap.language.schema import Function, Property, SideKind

__all__ = ["main"]

KB = "http://kb.openrobots.org/"
PREFIX = f"PREFIX : <{KB}>\n"
ROOM = (86, 90, 120)
"""The voxels of a room of 4.3 m x 4.5 m x 6 m: 928,800."""

MILLISECONDS = 50.0
"""The most for a text that is parsed already: both parse with the same grammar."""

QUERIES = {
    "two fields joined, filtered": (
        "SELECT ?v ?d { ?v :inFieldOfView :human1 . ?v :distanceToPerson ?d FILTER(?d > 1.2) }"
    ),
    "three fields joined, filtered": (
        "SELECT ?v ?o { ?v :inFieldOfView :human1 ; :containsObject ?o ; :distanceToPerson ?d "
        "FILTER(?d > 1.2 && ?o != :cup) }"
    ),
    "objects that do not exist": (
        "SELECT ?v { ?v :inFieldOfView :human1 FILTER NOT EXISTS { ?v :containsObject ?o } }"
    ),
    "counts by object": (
        "SELECT ?o (COUNT(?v) AS ?n) { ?v :inFieldOfView :human1 ; :containsObject ?o } GROUP BY ?o"
    ),
}

OF_A_ROOM = {
    "a room": "SELECT ?v { ?v :inRoom :kitchen }",
    "counts by object in a room": (
        "SELECT ?o (COUNT(?v) AS ?n) { ?v :inRoom :kitchen ; :containsObject ?o } GROUP BY ?o"
    ),
}

BY_SQL = {
    "two fields joined, filtered": (
        "SELECT f.s, d.o FROM {inFieldOfView} f(s, o) JOIN {distanceToPerson} d(s, o) USING (s) "
        "WHERE f.o = 0 AND d.o > 1.2"
    ),
    "three fields joined, filtered": (
        "SELECT f.s, c.o FROM {inFieldOfView} f(s, o) JOIN {containsObject} c(s, o) USING (s) "
        "JOIN {distanceToPerson} d(s, o) USING (s) WHERE f.o = 0 AND d.o > 1.2 AND c.o <> 1"
    ),
    "objects that do not exist": (
        "SELECT f.s FROM {inFieldOfView} f(s, o) WHERE f.o = 0 "
        "AND NOT EXISTS (SELECT FROM {containsObject} c(s, o) WHERE c.s = f.s)"
    ),
    "counts by object": (
        "SELECT c.o, count(*) FROM {inFieldOfView} f(s, o) JOIN {containsObject} c(s, o) USING (s) "
        "WHERE f.o = 0 GROUP BY c.o"
    ),
    "a room": "SELECT r.s FROM {inRoom} r(s, o) WHERE r.o = 0",
    "counts by object in a room": (
        "SELECT c.o, count(*) FROM {inRoom} r(s, o) JOIN {containsObject} c(s, o) USING (s) "
        "WHERE r.o = 0 GROUP BY c.o"
    ),
}
"""The best that a translation could give: keys of voxels, numbers of entities, no texts."""

SLOWER = 1.5
"""SQL replaces the evaluator where it takes at most so many times as long."""


@dataclass
class Field:
    """A property and its statements."""

    property: Property
    subject: StatementColumn
    object: StatementColumn

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements, only those of some objects if wanted."""
        subject, object_, objects = self.subject, self.object, wanted.objects
        if (
            objects is None
            or not isinstance(object_, Entities)
            or not isinstance(subject, VoxelColumn)
        ):
            return Statements(subject, object_)
        kept = np.isin(object_.codes, [i for i, n in enumerate(object_.names) if n in objects])
        return Statements(
            VoxelColumn(subject.keys[kept]), Entities(object_.codes[kept], object_.names)
        )


@dataclass
class Fields:
    """A catalogue of fields."""

    fields: list[Field]
    voxel_size: float = 0.05

    functions: Mapping[str, Function] = field(default_factory=lambda: VOXEL_FUNCTIONS)

    def find_property(self, iri: str) -> Property:
        """Return the property of an IRI."""
        return next(each.property for each in self.fields if each.property.iri == iri)

    def properties(self) -> Iterable[Property]:
        """Return all properties."""
        return [each.property for each in self.fields]

    def relation(self, property: Property) -> StatementRelation:
        """Return the field of a property."""
        return next(each for each in self.fields if each.property == property)

    def find_entities(self, name: str, range_: str | None) -> frozenset[str]:
        """Return the entity of a name: each name is one."""
        return frozenset({name})

    def during(self, begin: datetime, end: datetime) -> Fields:
        """Refuse: there is no history."""
        raise LookupError(begin)


def box(x: int, size: tuple[int, int, int] = (50, 40, 25)) -> VoxelColumn:
    """Return the voxels of a box that begins at x."""
    at = np.indices(size).reshape(3, -1).T + np.array([x, 0, 0])
    return VoxelColumn(keys_of(at.astype(np.int32)))


def scene() -> Fields:
    """Return three fields that overlap by four fifths, and a room around them."""
    rng = np.random.default_rng(0)
    names = ("mug", "cup", "table", "chair", "sofa")

    def about(name: str, kind: SideKind = "entity") -> Property:
        return Property(KB + name, name, None, None, "voxel", kind)

    return Fields(
        [
            Field(
                about("inFieldOfView"), box(0), Entities(np.zeros(50_000, np.int32), ("human1",))
            ),
            Field(
                about("containsObject"),
                box(10),
                Entities(rng.integers(0, 5, 50_000).astype(np.int32), names),
            ),
            Field(
                about("distanceToPerson", "number"),
                box(5),
                Numbers(rng.integers(0, 3000, 50_000) / 1024),
            ),
            Field(
                about("inRoom"),
                box(0, ROOM),
                Entities(np.zeros(np.prod(ROOM), np.int32), ("kitchen",)),
            ),
        ]
    )


def graph(fields: Fields) -> rdflib.Graph:
    """Return the statements of all fields but the room as triples."""
    triples = rdflib.Graph()
    for each in fields.fields[:3]:
        assert isinstance(each.subject, VoxelColumn)
        objects: list[rdflib.term.Identifier]
        if isinstance(each.object, Entities):
            names = [rdflib.URIRef(KB + name) for name in each.object.names]
            objects = [names[code] for code in each.object.codes.tolist()]
        else:
            assert isinstance(each.object, Numbers)
            objects = [rdflib.Literal(value) for value in each.object.values.tolist()]
        verb = rdflib.URIRef(each.property.iri)
        voxels = voxels_of_keys(each.subject.keys).tolist()
        for (x, y, z), object_ in zip(voxels, objects, strict=True):
            triples.add((rdflib.URIRef(f"urn:voxel:{x}_{y}_{z}"), verb, object_))
    return triples


# The same by SQL


def arrays(each: Field) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return subjects and objects of a field: numbers of 8 bytes."""
    assert isinstance(each.subject, VoxelColumn)
    if isinstance(each.object, Entities):
        return each.subject.keys, each.object.codes.astype(np.int64)
    assert isinstance(each.object, Numbers)
    return each.subject.keys, each.object.values


def binary(values: NDArray[Any]) -> bytes:
    """Return an array as PostgreSQL sends it: a header, and length and value of each element."""
    elements = np.empty(len(values), [("length", ">i4"), ("value", values.dtype.newbyteorder(">"))])
    elements["length"], elements["value"] = 8, values
    of = psycopg.postgres.types["int8" if values.dtype.kind == "i" else "float8"].oid
    return np.array([1, 0, of, len(values), 1], ">i4").tobytes() + elements.tobytes()


def run_sql(session: psycopg.Connection[Any], sql: str, *sides: NDArray[Any]) -> int:
    """Return the number of rows of a statement; its columns come as one binary array each."""
    columns = ", ".join(f"array_agg(c{i})" for i in range(1 + sql.split(" FROM ")[0].count(",")))
    names = columns.replace("array_agg", "").replace("(", "").replace(")", "")
    types = [psycopg.postgres.types["int8" if a.dtype.kind == "i" else "float8"] for a in sides]
    found = session.pgconn.exec_params(
        f"SELECT {columns} FROM ({sql}) q ({names})".encode(),
        [binary(each) for each in sides],
        [each.array_oid for each in types],
        [Format.BINARY] * len(sides),
        Format.BINARY,
    )
    value = found.get_value(0, 0)
    if value is None:
        raise RuntimeError(found.error_message.decode())
    return len(np.frombuffer(value, [("length", ">i4"), ("value", ">i8")], offset=20))


@contextmanager
def tables(fields: Fields) -> Iterator[psycopg.Connection[Any]]:
    """Yield a session with a table of each field, with an index and statistics."""
    use_bench_database()
    with open_engine().connect() as connection:
        session: Any = connection.connection.driver_connection
        # As fast as it can be: the tables and their hashes in memory, in one process.
        session.execute("SET work_mem = '256MB'; SET max_parallel_workers_per_gather = 0")
        for each in fields.fields:
            name, (subjects, objects) = each.property.name, arrays(each)
            type_ = "bigint" if objects.dtype.kind == "i" else "float8"
            session.execute(f'CREATE TEMP TABLE "{name}" (s bigint, o {type_})')
            session.pgconn.exec_params(
                f'INSERT INTO "{name}" SELECT * FROM unnest($1::bigint[], $2::{type_}[])'.encode(),
                [binary(subjects), binary(objects)],
                None,
                [Format.BINARY] * 2,
            )
            session.execute(f'CREATE INDEX ON "{name}" (s); ANALYZE "{name}"')
        yield session


def compared(fields: Fields, session: psycopg.Connection[Any], job: str, text: str) -> Row:
    """Return the times of a query by the evaluator, and by SQL that has or gets the fields."""
    stated = {e.property.name: arrays(e) for e in fields.fields if e.property.name in BY_SQL[job]}
    given = {name: f"unnest(${2 * i + 1}, ${2 * i + 2})" for i, name in enumerate(stated)}
    kept = {name: f'"{name}"' for name in stated}
    backend = Path(f"/proc/{session.info.backend_pid}/schedstat")

    def seconds() -> float:
        return time.process_time() + 1e-9 * int(backend.read_text().split()[0])

    def evaluated() -> int:
        result = query(fields, PREFIX + text)
        assert isinstance(result, SelectResult)
        return len(result)

    def of_tables() -> int:
        return run_sql(session, BY_SQL[job].format(**kept))

    def of_arrays() -> int:
        sides = (side for both in stated.values() for side in both)
        return run_sql(session, BY_SQL[job].format(**given), *sides)

    if not evaluated() == of_tables() == of_arrays():
        raise RuntimeError(f"{job}: {evaluated()} solutions, by SQL {of_tables()}")
    ours, has, gets = (
        1e3 * median_seconds(run, clock=seconds) for run in (evaluated, of_tables, of_arrays)
    )
    return Row(
        f"{job}: {evaluated():,} solutions",
        f"{ours:.1f} ms",
        f"SQL that gets the fields: {gets:,.0f} ms: {gets / ours:.0f}x; "
        f"that has them in tables: {has:,.0f} ms: {has / ours:.1f}x",
        f"SQL takes more than {SLOWER} times",
        has > SLOWER * ours,
    )


def main() -> None:
    """Print the table."""
    fields = scene()
    triples = graph(fields)
    rows = []
    for job, text in QUERIES.items():

        def run(text: str = text) -> SelectResult:
            result = query(fields, PREFIX + text)
            assert isinstance(result, SelectResult)
            return result

        def parse_and_run() -> SelectResult:
            parse_query.cache_clear()
            return run()

        start = time.perf_counter()
        theirs = list(triples.query(PREFIX + text))
        taken = time.perf_counter() - start
        if len(theirs) != len(run()):
            raise RuntimeError(f"rdflib has {len(theirs)} solutions, we have {len(run())}")
        new, again = 1e3 * median_seconds(parse_and_run), 1e3 * median_seconds(run)
        rows.append(
            Row(
                f"{job}: {len(theirs):,} solutions",
                f"{again:.1f} ms, {new:.1f} ms with parsing",
                f"rdflib, voxel by voxel: {1e3 * taken:,.0f} ms: {1e3 * taken / new:.0f}x",
                f"at most {MILLISECONDS:g} ms",
                again <= MILLISECONDS,
            )
        )
    print_rows("Query language: fields of 50,000 statements", rows)
    with tables(fields) as session:
        print_rows(
            "Query language: the evaluator of fields and SQL, processor time with the server's",
            [compared(fields, session, *each) for each in {**QUERIES, **OF_A_ROOM}.items()],
        )


if __name__ == "__main__":
    main()
