"""The properties that an ontology declares, for maps and for queries."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from rdflib import OWL, RDF, RDFS, Graph, Namespace, URIRef
from rdflib.term import Node

from semmap.language.property import Property
from semmap.ingest.tbox import snake_case

__all__ = ["SEMMAP", "Vocabulary", "read_vocabulary"]

SEMMAP = Namespace("urn:semmap:ontology#")


class Vocabulary:
    """Properties by identifier, and by name."""

    def __init__(self, properties: Iterable[Property]) -> None:
        self.properties = tuple(properties)
        self._by_iri = {iri: p for p in self.properties for iri in (p.iri, *p.same_as)}
        self._by_name = {p.name: p for p in self.properties}

    def __getitem__(self, name: str) -> Property:
        """The property of an identifier or a name; KeyError if there is none."""
        return self._by_iri[name] if name in self._by_iri else self._by_name[name]

    def __contains__(self, name: object) -> bool:
        return name in self._by_iri or name in self._by_name


def read_vocabulary(paths: Iterable[Path]) -> Vocabulary:
    """The properties of Turtle files: object properties, datatype properties, fields of either."""
    graph = Graph()
    for path in paths:
        graph.parse(path, format="turtle")
    declared = {
        iri
        for kind in (OWL.ObjectProperty, OWL.DatatypeProperty)
        for iri in graph.subjects(RDF.type, kind)
        if isinstance(iri, URIRef)
    }
    return Vocabulary(_property(graph, iri) for iri in sorted(declared))


def _property(graph: Graph, iri: URIRef) -> Property:
    field = (iri, RDF.type, SEMMAP.FieldProperty) in graph
    number = (iri, RDF.type, OWL.DatatypeProperty) in graph
    measure = graph.value(iri, SEMMAP.measure)
    return Property(
        iri=str(iri),
        name=_local(iri),
        domain=_type(graph.value(iri, RDFS.domain)),
        range=None if number else _type(graph.value(iri, RDFS.range)),
        subject="voxel" if field else "thing",
        object="number" if number else "thing",
        same_as=tuple(sorted(str(o) for o in graph.objects(iri, OWL.equivalentProperty))),
        measure=None if measure is None else _local(measure),
    )


def _local(iri: Node) -> str:
    return re.split(r"[#/:]", str(iri))[-1]


def _type(iri: Node | None) -> str | None:
    """The name of a semantic type; the root of all is any."""
    name = None if iri is None else snake_case(_local(iri))
    return None if name == "entity" else name
