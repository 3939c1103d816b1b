"""The query language on fields of 50,000 statements, beside rdflib voxel by voxel."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import datetime

import numpy as np
import rdflib
from numpy.typing import NDArray

from benchmarks.timing import Row, median_seconds, print_rows
from semmap.fields.queries import Rows, query
from semmap.language.grammar import parse_query
from semmap.language.property import Kind, Property
from semmap.fields.queries.statements import (
    Column,
    Numbers,
    Relation,
    Statements,
    Things,
    Voxels,
    keys_of,
    voxels_of_keys,
)

__all__ = ["main"]

KB = "http://kb.openrobots.org/"
PREFIX = f"PREFIX : <{KB}>\n"
MILLISECONDS = 50.0
"""At most, once a text was read: reading it is the same grammar for both."""

QUERIES = {
    "two fields joined, filtered": (
        "SELECT ?v ?d { ?v :inFieldOfView :human1 . ?v :distanceToPerson ?d FILTER(?d > 1.2) }"
    ),
    "three fields joined, filtered": (
        "SELECT ?v ?o { ?v :inFieldOfView :human1 ; :containsObject ?o ; :distanceToPerson ?d "
        "FILTER(?d > 1.2 && ?o != :cup) }"
    ),
    "what is not there": (
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
    subject: Column
    object: Column

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        """Those of the given objects."""
        subject, object_ = self.subject, self.object
        if objects is None or not isinstance(object_, Things) or not isinstance(subject, Voxels):
            return Statements(subject, object_)
        kept = np.isin(object_.codes, [i for i, n in enumerate(object_.names) if n in objects])
        return Statements(Voxels(subject.keys[kept]), Things(object_.codes[kept], object_.names))


@dataclass
class Fields:
    """A catalogue of them."""

    fields: list[Field]
    voxel_size: float = 0.05

    def relation(self, iri: str) -> Relation:
        """By its IRI."""
        return next(field for field in self.fields if field.property.iri == iri)

    def relations(self) -> Iterable[Relation]:
        """All."""
        return self.fields

    def things(self, name: str, range_: str | None) -> frozenset[str]:
        """Each name is a thing."""
        return frozenset({name})

    def at(self, moment: datetime) -> Fields:
        """It has no past."""
        raise LookupError(moment)

    def during(self, begin: datetime, end: datetime) -> Fields:
        """It has no past."""
        raise LookupError(begin)


def box(x: int) -> Voxels:
    """50,000 voxels in a row of boxes."""
    at = np.indices((50, 40, 25)).reshape(3, -1).T + np.array([x, 0, 0])
    return Voxels(keys_of(at.astype(np.int32)))


def scene() -> Fields:
    """Three fields that overlap by four fifths."""
    rng = np.random.default_rng(0)
    names = ("mug", "cup", "table", "chair", "sofa")

    def about(name: str, kind: Kind = "thing") -> Property:
        return Property(KB + name, name, None, None, "voxel", kind)

    return Fields(
        [
            Field(about("inFieldOfView"), box(0), Things(np.zeros(50_000, np.int32), ("human1",))),
            Field(
                about("containsObject"),
                box(10),
                Things(rng.integers(0, 5, 50_000).astype(np.int32), names),
            ),
            Field(
                about("distanceToPerson", "number"),
                box(5),
                Numbers(rng.integers(0, 3000, 50_000) / 1024),
            ),
        ]
    )


def graph(fields: Fields) -> rdflib.Graph:
    """The same as triples."""
    triples = rdflib.Graph()
    for field in fields.fields:
        assert isinstance(field.subject, Voxels)
        objects: list[rdflib.term.Identifier]
        if isinstance(field.object, Things):
            names = [rdflib.URIRef(KB + name) for name in field.object.names]
            objects = [names[code] for code in field.object.codes.tolist()]
        else:
            assert isinstance(field.object, Numbers)
            objects = [rdflib.Literal(value) for value in field.object.values.tolist()]
        verb = rdflib.URIRef(field.property.iri)
        voxels = voxels_of_keys(field.subject.keys).tolist()
        for (x, y, z), object_ in zip(voxels, objects, strict=True):
            triples.add((rdflib.URIRef(f"urn:voxel:{x}_{y}_{z}"), verb, object_))
    return triples


def main() -> None:
    """Print the table."""
    fields = scene()
    triples = graph(fields)
    rows = []
    for job, text in QUERIES.items():

        def ask(text: str = text) -> Rows:
            answer = query(fields, PREFIX + text)
            assert isinstance(answer, Rows)
            return answer

        def ask_anew() -> Rows:
            parse_query.cache_clear()
            return ask()

        start = time.perf_counter()
        theirs = list(triples.query(PREFIX + text))
        taken = time.perf_counter() - start
        if len(theirs) != len(ask()):
            raise RuntimeError(f"rdflib has {len(theirs)} solutions, we have {len(ask())}")
        new, again = 1e3 * median_seconds(ask_anew), 1e3 * median_seconds(ask)
        rows.append(
            Row(
                f"{job}: {len(theirs):,} solutions",
                f"{again:.1f} ms, {new:.1f} ms with reading a new text",
                f"rdflib, voxel by voxel: {1e3 * taken:,.0f} ms: {1e3 * taken / new:.0f}x",
                f"at most {MILLISECONDS:g} ms",
                again <= MILLISECONDS,
            )
        )
    print_rows("Query language: fields of 50,000 statements", rows)


if __name__ == "__main__":
    main()
