"""Data sets in RDF files: resources with their values, also those of their parts."""

from __future__ import annotations

import io
import logging
from collections import Counter, defaultdict
from pathlib import Path

from rdflib import OWL, RDF, RDFS, BNode, Graph, Literal, URIRef
from rdflib.term import Node

from semmap.interlinking.error import InterlinkingError
from semmap.interlinking.files import read_text
from semmap.interlinking.records import Records

FORMATS = {
    ".rdf": "xml",
    ".owl": "xml",
    ".xml": "xml",
    ".ttl": "turtle",
    ".nt": "nt",
    ".n3": "n3",
    ".jsonld": "json-ld",
}
"""Formats of rdflib by the suffix of a file."""

DEPTH = 3
"""A value is reached over at most so many properties: has_address/street has two."""

SCHEMA = {str(namespace) for namespace in (OWL, RDF, RDFS)}


def read_rdf_records(path: Path, type_name: str | None = None) -> Records:
    """Return the resources that an RDF file describes as records; only those of a type, if given.

    A resource is part of another one, and no record, if a resource of another type refers to it:
    the address of a person. Its values are values of the person, ``has_address/street``. The type
    is an IRI, or the last part of one.
    """
    graph = _parse(path)
    types: dict[Node, set[str]] = defaultdict(set)
    for subject, _, kind in graph.triples((None, RDF.type, None)):
        types[subject].add(str(kind))
    described = {
        s
        for s in graph.subjects(unique=True)
        if not any(t.startswith(tuple(SCHEMA)) and t != str(OWL.NamedIndividual) for t in types[s])
    }
    parts = {
        o
        for s, _, o in graph
        if o in described and s in described and o != s and types[s] != types[o]
    }
    records = sorted(described - parts, key=str)
    if type_name is not None:
        wanted = [s for s in sorted(described, key=str) if _has_type(types[s], type_name)]
        if not wanted:
            known = Counter(_local(t) for s in described for t in types[s]).most_common(8)
            raise InterlinkingError(
                f"{path}: describes no {type_name}: its types are {', '.join(t for t, _ in known)}"
            )
        records = wanted
    records = [s for s in records if isinstance(s, URIRef)] or records
    if not records:
        raise InterlinkingError(f"{path}: describes no resource: is it an ontology without data?")
    values = [_values(graph, s, described) for s in records]
    names = sorted({name for of in values for name in of})
    return Records(
        str(path),
        [str(s) for s in records],
        {n: [tuple(of.get(n, ())) for of in values] for n in names},
    )


def _parse(path: Path) -> Graph:
    text = read_text(path)
    logging.getLogger("rdflib.term").setLevel(logging.ERROR)  # values that are not of their type
    try:
        format_ = FORMATS[path.suffix.lower()]
        return Graph().parse(io.BytesIO(text.encode()), format=format_, publicID="file:///")
    except Exception as error:  # rdflib's parsers raise anything, assertions too, on broken text
        raise InterlinkingError(
            f"{path}: is not RDF in the format of its suffix ({str(error).splitlines()[0][:200]})"
        ) from error


def _has_type(types: set[str], name: str) -> bool:
    return any(name in (t, _local(t)) for t in types)


def _values(
    graph: Graph,
    subject: Node,
    described: set[Node],
    prefix: str = "",
    seen: frozenset[Node] = frozenset(),
) -> dict[str, list[str]]:
    """The values of a resource by the path of properties to them."""
    found: dict[str, list[str]] = defaultdict(list)
    for property_, value in sorted(graph.predicate_objects(subject), key=str):
        if property_ == RDF.type:
            continue
        name = prefix + _local(str(property_))
        if isinstance(value, Literal):
            found[name].append(str(value))
        elif value in described and value not in seen | {subject} and name.count("/") < DEPTH - 1:
            inner = _values(graph, value, described, name + "/", seen | {subject})
            for path, values in inner.items():
                found[path] += values
        elif not isinstance(value, BNode):
            found[name].append(_local(str(value)))
    return found


def _local(iri: str) -> str:
    """The last part of an IRI."""
    return iri.rstrip("/#").replace("#", "/").rpartition("/")[2] or iri
