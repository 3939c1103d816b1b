"""The whole graph of a map: what the mapping's tables have, row by row."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import pyoxigraph
import rdflib
from pyoxigraph import RdfFormat

from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import (
    INFERENCES_OF_MAP,
    INFERRED_GRAPH,
    STATEMENTS_AS_TEXTS,
    TRIPLES,
)
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.sparql.stored_terms import term_of
from semmap.knowledge.sparql.values import tag_of, text_of
from semmap.knowledge.triple_map import OWN_LETTERS, TripleMap
from semmap.knowledge.vocabulary import graph_iri, prefixes

Graph = TypeVar("Graph", bound=rdflib.Graph)


def facts(session: Session, *, inferences: bool = False) -> Iterator[tuple[Any, Any, Any, Any]]:
    """Yield subject, property, object and graph of each fact; None is the default graph."""
    more = INFERENCES_OF_MAP if inferences else ()
    return facts_of(session, (*TRIPLES, *STATEMENTS_AS_TEXTS, *more))


def facts_of(session: Session, triples: Iterable[TripleMap]) -> Iterator[tuple[Any, Any, Any, Any]]:
    """Yield the facts of triple maps."""
    view = MapView.of(session)
    parameters = {"namespace": view.namespace, "map": view.number}
    for triple in triples:
        sql = triple_query(triple)
        with session.cursor() as cursor:
            for row in cursor.execute(sql.encode(), parameters, prepare=False):
                subject = term_of(row[0], row[1])
                object_ = term_of(row[3], row[4])
                if subject is not None and object_ is not None:
                    yield (
                        subject,
                        rdflib.URIRef(row[2]),
                        object_,
                        rdflib.URIRef(graph_iri(row[5])) if row[5] else None,
                    )


def dump(session: Session, *, inferences: bool = False) -> rdflib.Dataset:
    """Return the map that a session sees with its named graphs; one has the inferences."""
    dataset = with_prefixes(rdflib.Dataset(), MapView.of(session).name)
    for subject, verb, object_, graph in facts(session, inferences=inferences):
        target = dataset.default_graph if graph is None else dataset.graph(graph)
        target.add((subject, verb, object_))
    return dataset


def with_prefixes(graph: Graph, map_name: str) -> Graph:
    """Bind the prefixes of a map in a graph; return it."""
    for prefix, space in prefixes(map_name).items():
        graph.bind(prefix, space, replace=True)
    return graph


@contextmanager
def without_warnings() -> Iterator[None]:
    """Run code of rdflib that uses what rdflib deprecated itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def has_graphs(format_: str) -> bool:
    """Return whether files of a format have named graphs."""
    return format_ in ("trig", "nquads", "json-ld")


def serialized(graph: rdflib.Graph, format_: str) -> str:
    """Return a graph as text, in a format of `RDF_FORMATS`.

    Of a dataset, formats without named graphs have the default graph and the inferences.
    """
    space = {prefix: str(iri) for prefix, iri in graph.namespaces()}
    quads: set[tuple[Any, ...]]
    with without_warnings():
        if not isinstance(graph, rdflib.Dataset):
            quads = {(*triple, None) for triple in graph}
        elif has_graphs(format_):
            default = rdflib.graph.DATASET_DEFAULT_GRAPH_ID
            quads = {(s, p, o, None if g == default else g) for s, p, o, g in graph.quads()}
        else:
            inferred = graph.graph(INFERRED_GRAPH)
            quads = {(*triple, None) for part in (graph.default_graph, inferred) for triple in part}
    in_order = sorted(
        quads, key=lambda quad: [each.n3() if each else "" for each in quad[-1:] + quad]
    )
    written = (pyoxigraph.Quad(*map(_written, quad)) for quad in in_order)
    text = pyoxigraph.serialize(written, format=RDF_FORMATS[format_], prefixes=space)
    assert text is not None
    return text.decode()


RDF_FORMATS = {
    "turtle": RdfFormat.TURTLE,
    "json-ld": RdfFormat.JSON_LD,
    "trig": RdfFormat.TRIG,
    "nt": RdfFormat.N_TRIPLES,
    "nquads": RdfFormat.N_QUADS,
    "n3": RdfFormat.N3,
    "xml": RdfFormat.RDF_XML,
}
"""By rdflib's names."""


def _written(term: Any) -> Any:
    """Return a term as pyoxigraph writes it."""
    if term is None:
        return pyoxigraph.DefaultGraph()
    if isinstance(term, rdflib.BNode):
        return pyoxigraph.BlankNode(str(term))
    if isinstance(term, rdflib.URIRef):
        return pyoxigraph.NamedNode(str(term))
    if term.language:
        return pyoxigraph.Literal(str(term), language=term.language)
    datatype = term.datatype and pyoxigraph.NamedNode(str(term.datatype))
    return pyoxigraph.Literal(str(term), datatype=datatype)


def triple_query(triple: TripleMap) -> str:
    """Return the SELECT of a triple map: texts and tags, and the graph."""
    subject, object_ = (each.placed(OWN_LETTERS) for each in (triple.subject, triple.object))
    columns = (
        text_of(subject, "%(namespace)s::text"),
        tag_of(subject),
        triple.verb(OWN_LETTERS)[0],
        text_of(object_, "%(namespace)s::text"),
        tag_of(object_),
        graph_of(triple),
    )
    tables, where = triple.tables()
    return f"SELECT {', '.join(columns)} FROM {', '.join(tables)} WHERE {' AND '.join(where)}"


def graph_of(triple: TripleMap) -> str:
    """Return the SQL of the graph of a triple map's facts; the default graph is empty."""
    if triple in STATEMENTS_AS_TEXTS:
        return "a.graph"
    return f"'{INFERRED_GRAPH}'" if triple in INFERENCES_OF_MAP else "''"
