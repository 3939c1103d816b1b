"""The namespaces of the map as RDF, and the prefixes that a query need not declare."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import quote, unquote

from semmap.language.terms import PAPER_NAMESPACE

SEMMAP = "urn:semmap:ontology#"
PROPERTY = "urn:semmap:property#"  # the properties that entities have as JSON: a property each
RELATION = "urn:semmap:relation#"  # the links between entities: a property for each relation
TYPE = "urn:semmap:type#"  # the semantic types that no ontology declares

GRAPH = "urn:semmap:graph:"  # the stored graphs whose names are not IRIs

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OWL = "http://www.w3.org/2002/07/owl#"
XSD = "http://www.w3.org/2001/XMLSchema#"
GEO = "http://www.opengis.net/ont/geosparql#"
SF = "http://www.opengis.net/ont/sf#"  # the classes of geometries
GEOF = "http://www.opengis.net/def/function/geosparql/"
KNOWLEDGE_CORE = ("http://kb.openrobots.org#", PAPER_NAMESPACE)
"""Namespaces whose local names stand for entities, types and properties of the map, too."""

PREFIXES: Mapping[str, str] = {
    "semmap": SEMMAP,
    "prop": PROPERTY,
    "rel": RELATION,
    "type": TYPE,
    "rdf": RDF,
    "rdfs": RDFS,
    "owl": OWL,
    "xsd": XSD,
    "skos": "http://www.w3.org/2004/02/skos/core#",
    "foaf": "http://xmlns.com/foaf/0.1/",
    "geo": GEO,
    "geof": GEOF,
    "sf": SF,
    "uom": "http://www.opengis.net/def/uom/OGC/1.0/",
    "bot": "https://w3id.org/bot#",
    "oro": KNOWLEDGE_CORE[0],
    "cora": "http://purl.org/ieee1872-owl/cora#",
}
"""Prefixes that a query need not declare; the empty one is the map's."""


IRI = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:[^\x00-\x20<>\"{}|^`\\\ud800-\udfff]*")
"""An absolute IRI, as all formats of RDF can write it."""


def encode(name: str) -> str:
    """Return a name as a part of an IRI, as the SQL function `iri_encode` does."""
    return quote(name, safe="")


def graph_iri(name: str) -> str:
    """Return the IRI of a stored graph: its name, or one made of a name that is not an IRI."""
    return name if IRI.fullmatch(name) else GRAPH + encode(name)


def graph_names(iri: str) -> list[str]:
    """Return the names under which the graph of an IRI, or of a name, may be stored."""
    name = decode(iri.removeprefix(GRAPH)) if iri.startswith(GRAPH) else None
    return [iri, name] if name and graph_iri(name) == iri else [iri]


def decode(part: str) -> str | None:
    """Return the name that a part of an IRI encodes; None where it encodes none."""
    name = unquote(part, errors="replace")
    return name if encode(name) == part else None


def map_namespace(map_name: str) -> str:
    """Return the namespace of a map's entities: urn:semmap:map:NAME#."""
    return f"urn:semmap:map:{encode(map_name)}#"


def prefixes(map_name: str) -> dict[str, str]:
    """Return all prefixes of queries on a map; the empty one is that of its entities."""
    return {**PREFIXES, "": map_namespace(map_name)}


def short(iri: str, known: Mapping[str, str]) -> str:
    """Return an IRI with the longest prefix that fits, or in angle brackets."""
    fitting = [(len(space), p, space) for p, space in known.items() if iri.startswith(space)]
    if not fitting:
        return f"<{iri}>"
    _, prefix, space = max(fitting)
    return f"{prefix}:{iri[len(space) :]}"
