"""Data sets in files: tables in CSV, and resources of RDF with their values and those of parts."""

from __future__ import annotations

import csv
import io
import logging
from collections import Counter, defaultdict
from functools import partial
from pathlib import Path

import pyoxigraph
from pyoxigraph import RdfFormat
from rdflib import OWL, RDF, RDFS, BNode, Graph, Literal, URIRef
from rdflib.term import Node

from semmap.interlinking.records import InterlinkingError, Records
from semmap.limits import TEXT_BYTES

KEYS = ("id", "key", "rec_id", "uri")
"""Names of the column of keys; else the first column has them."""


def read_csv_records(path: Path) -> Records:
    """Return the rows of a CSV file; keys are in a column of `KEYS`, else in the first one."""
    rows = csv_rows(path)
    header = [name.strip() for name in rows[0]] if rows else []
    if len(header) < 2 or len(set(header)) < len(header) or not all(header):
        raise InterlinkingError(
            f"{path}: line 1: is not a header of two or more different column names: add one"
        )
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise InterlinkingError(
                f"{path}: row {number}: has {len(row)} cells, the header {len(header)}: quote "
                "commas within cells"
            )
    place = next((i for i, name in enumerate(header) if name.lower() in KEYS), 0)
    columns = {name: [row[i].strip() for row in rows[1:]] for i, name in enumerate(header)}
    keys = columns.pop(header[place])
    if "" in keys:
        raise InterlinkingError(
            f"{path}: row {keys.index('') + 2}: has no {header[place]}: add one"
        )
    return Records(
        str(path),
        keys,
        {name: [(cell,) if cell else () for cell in cells] for name, cells in columns.items()},
    )


def csv_rows(path: Path) -> list[list[str]]:
    """Return the rows of a CSV file that have a cell."""
    text = read_text(path)
    try:
        reader = csv.reader(text.splitlines(keepends=True), strict=True)
        return [row for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InterlinkingError(f"{path}: is not CSV ({error}): quote cells with commas") from error


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8; an absent, too large or badly encoded one is an error."""
    try:
        TEXT_BYTES.check(path.stat().st_size, partial(_refusal, path), "Split the file.")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InterlinkingError(
            f"{path}: cannot be read ({error.strerror}): check path and permissions"
        ) from error
    except UnicodeDecodeError as error:
        raise InterlinkingError(
            f"{path}: byte {error.start} is not UTF-8: save it as UTF-8"
        ) from error


def _refusal(path: Path, what: str, fix: str) -> InterlinkingError:
    return InterlinkingError(f"{path}: {what}. {fix}")


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

DEPTH = 3  # a value is reached over at most so many properties: has_address/street has two

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
        if format_ == "json-ld":  # rdflib would fetch a context from elsewhere
            quads = pyoxigraph.parse(text, format=RdfFormat.JSON_LD, base_iri="file:///")
            triples = (quad.triple for quad in quads)
            text = (pyoxigraph.serialize(triples, format=RdfFormat.N_TRIPLES) or b"").decode()
            format_ = "nt"
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
    return iri.rstrip("/#").replace("#", "/").rpartition("/")[2] or iri


SUFFIXES = (".csv", *FORMATS)


def read_records(path: Path, type_name: str | None = None) -> Records:
    """Return the records of a CSV or RDF file, by its suffix; of an RDF file, those of a type."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InterlinkingError(
            f"{path}: ends in {suffix or 'no suffix'}: give a file that ends in one of "
            f"{', '.join(SUFFIXES)}"
        )
    return read_csv_records(path) if suffix == ".csv" else read_rdf_records(path, type_name)
