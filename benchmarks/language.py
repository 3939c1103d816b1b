"""The query language on fields of 50,000 statements, compared with rdflib voxel by voxel."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
import rdflib
from numpy.typing import NDArray

from benchmarks.timing import Row, median_seconds, print_rows
from semmap.fields.queries import SelectResult, query
from semmap.fields.queries.statements import (
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
    "what does not exist": (
        "SELECT ?v { ?v :inFieldOfView :human1 FILTER NOT EXISTS { ?v :containsObject ?o } }"
    ),
    "counts by object": (
        "SELECT ?o (COUNT(?v) AS ?n) { ?v :inFieldOfView :human1 ; :containsObject ?o } GROUP BY ?o"
    ),
}


@dataclass
class Field:
    """A property and its statements."""

    property: Property
    subject: StatementColumn
    object: StatementColumn

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        """Return the statements, only those of `objects` if given."""
        subject, object_ = self.subject, self.object
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

    def at(self, moment: datetime) -> Fields:
        """Refuse: there is no history."""
        raise LookupError(moment)

    def during(self, begin: datetime, end: datetime) -> Fields:
        """Refuse: there is no history."""
        raise LookupError(begin)


def box(x: int) -> VoxelColumn:
    """Return 50,000 voxels of a box that begins at x."""
    at = np.indices((50, 40, 25)).reshape(3, -1).T + np.array([x, 0, 0])
    return VoxelColumn(keys_of(at.astype(np.int32)))


def scene() -> Fields:
    """Return three fields that overlap by four fifths."""
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
        ]
    )


def graph(fields: Fields) -> rdflib.Graph:
    """Return the same statements as triples."""
    triples = rdflib.Graph()
    for each in fields.fields:
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


if __name__ == "__main__":
    main()
