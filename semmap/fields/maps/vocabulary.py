"""The properties that an ontology declares, for maps and for queries."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from rdflib import OWL, RDF, RDFS, Graph, Namespace, URIRef
from rdflib.term import Node

from semmap.language.schema import Property
from semmap.snake_case import local_name, snake_case

SEMMAP = Namespace("urn:semmap:ontology#")


class Properties(Protocol):
    """Properties by IRI or name: a `Vocabulary`, or what stands for one."""

    def __getitem__(self, name: str) -> Property:
        """Return the property of an IRI or a name."""
        ...

    def __contains__(self, name: object) -> bool:
        """Return whether there is a property of an IRI or a name."""
        ...


class Vocabulary:
    """Properties by IRI and by name."""

    def __init__(self, properties: Iterable[Property]) -> None:
        self.properties = tuple(properties)
        self._by_iri = {iri: p for p in self.properties for iri in (p.iri, *p.same_as)}
        self._by_name = {p.name: p for p in self.properties}

    def __getitem__(self, name: str) -> Property:
        return self._by_iri[name] if name in self._by_iri else self._by_name[name]

    def __contains__(self, name: object) -> bool:
        return name in self._by_iri or name in self._by_name


def read_vocabulary(paths: Iterable[Path]) -> Vocabulary:
    """Return the object and datatype properties that Turtle files declare.

    Those that are of the class `FieldProperty`, too, are properties of voxels.
    """
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
        name=local_name(str(iri)),
        domain=_type(graph.value(iri, RDFS.domain)),
        range=None if number else _type(graph.value(iri, RDFS.range)),
        subject="voxel" if field else "entity",
        object="number" if number else "entity",
        same_as=tuple(sorted(str(o) for o in graph.objects(iri, OWL.equivalentProperty))),
        measure=None if measure is None else local_name(str(measure)),
    )


def _type(iri: Node | None) -> str | None:
    """Return the name of a semantic type; None for the root, which is any type."""
    name = None if iri is None else snake_case(local_name(str(iri)))
    return None if name == "entity" else name
