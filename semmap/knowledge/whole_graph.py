"""The whole graph of a map: what the mapping's tables have, row by row."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any, TypeVar

import rdflib
from rdflib.plugins.serializers.trig import TrigSerializer
from rdflib.plugins.serializers.turtle import TurtleSerializer

from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERENCES, INFERRED_GRAPH, STATEMENTS, TRIPLES
from semmap.knowledge.sparql.kept_queries import Session, term_of
from semmap.knowledge.sparql.values import tag_of, text_of
from semmap.knowledge.triple_map import OWN_LETTERS, TripleMap
from semmap.knowledge.vocabulary import graph_iri, prefixes

Graph = TypeVar("Graph", bound=rdflib.Graph)


def facts(session: Session, *, inferences: bool = False) -> Iterator[tuple[Any, Any, Any, Any]]:
    """Yield subject, property, object and graph of each fact; None is the default graph."""
    view = MapView.of(session)
    parameters = {"namespace": view.namespace, "map": view.number}
    for triple in (*TRIPLES, *STATEMENTS, *(INFERENCES if inferences else ())):
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
    """Return a graph as text, in a format by rdflib's name.

    Of a dataset, Turtle and N-Triples have the default graph and the inferences, without other
    named graphs.
    """
    if isinstance(graph, rdflib.Dataset) and not has_graphs(format_):
        for triple in graph.graph(INFERRED_GRAPH):
            graph.default_graph.add(triple)
        graph = graph.default_graph
    with without_warnings():
        exact = _EXACT.get(format_)
        if exact is None:
            return str(graph.serialize(format=format_))
        text = BytesIO()
        exact(graph).serialize(text, encoding="utf-8")
        return text.getvalue().decode()


class _Exact:
    """Writes doubles as they are: rdflib rounds them to seven digits."""

    def label(self, node: Any, position: int) -> str:
        """Return a term as Turtle."""
        if isinstance(node, rdflib.Literal) and node.datatype == rdflib.XSD.double:
            return str(node.n3(self.store.namespace_manager))  # type: ignore[attr-defined]
        return str(super().label(node, position))  # type: ignore[misc]


class _ExactTurtle(_Exact, TurtleSerializer):
    pass


class _ExactTrig(_Exact, TrigSerializer):
    pass


_EXACT: dict[str, Any] = {"turtle": _ExactTurtle, "trig": _ExactTrig}


def triple_query(triple: TripleMap) -> str:
    """Return the SELECT of a triple map: texts and tags, and the graph."""
    subject, object_ = (each.placed(OWN_LETTERS) for each in (triple.subject, triple.object))
    inferred = f"'{INFERRED_GRAPH}'" if triple in INFERENCES else "''"
    columns = (
        text_of(subject, "%(namespace)s::text"),
        tag_of(subject),
        triple.verb(OWN_LETTERS)[0],
        text_of(object_, "%(namespace)s::text"),
        tag_of(object_),
        "a.graph" if triple in STATEMENTS else inferred,
    )
    tables, where = triple.tables()
    return f"SELECT {', '.join(columns)} FROM {', '.join(tables)} WHERE {' AND '.join(where)}"
