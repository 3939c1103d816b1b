"""Two other engines on the dump of the graph, and answers that can be compared."""

from __future__ import annotations

from collections import Counter
from datetime import datetime
from typing import Any

import psycopg
import pyoxigraph
import rdflib

from semmap.knowledge import Answer
from semmap.knowledge.map_view import MapView
from semmap.knowledge.vocabulary import prefixes
from semmap.knowledge.whole_graph import dump, serialized, without_warnings

NUMBERS = ("integer", "decimal", "double", "float")


class Engines:
    """rdflib and oxigraph with all facts of a map."""

    def __init__(self, session: psycopg.Connection) -> None:
        self.prefixes = prefixes(MapView.of(session).name)
        self.dataset = dump(session)
        self.store = pyoxigraph.Store()
        text = serialized(self.dataset, "nquads")
        self.store.load(text.encode(), format=pyoxigraph.RdfFormat.N_QUADS)

    def oxigraph(self, text: str) -> Any:
        """Return oxigraph's answer: a multiset of rows, or a truth value."""
        found = self.store.query(text, prefixes=self.prefixes)
        if isinstance(found, pyoxigraph.QueryBoolean):
            return bool(found)
        if isinstance(found, pyoxigraph.QueryTriples):
            return Counter(
                tuple(_oxi(t) for t in (x.subject, x.predicate, x.object)) for x in found
            )
        names = [v.value for v in found.variables]
        return Counter(
            frozenset((n, _oxi(row[n])) for n in names if row[n] is not None) for row in found
        )

    def rdflib(self, text: str) -> Any:
        """Return rdflib's answer."""
        with without_warnings():
            found = self.dataset.query(text, initNs=self.prefixes)
            list(found)
        if found.type == "ASK":
            return found.askAnswer
        if found.type in ("CONSTRUCT", "DESCRIBE"):
            return Counter(tuple(map(_key, triple)) for triple in found.graph)
        return Counter(
            frozenset((str(n), _key(t)) for n, t in row.asdict().items()) for row in found
        )


def comparable(answer: Answer) -> Any:
    """Return an answer as the engines' ones."""
    if answer.form == "ASK":
        return answer.truth
    if answer.graph is not None:
        return Counter(tuple(map(_key, triple)) for triple in answer.graph)
    return Counter(
        frozenset((n, _key(t)) for n, t in zip(answer.names, row, strict=True) if t is not None)
        for row in answer.rows
    )


def _oxi(term: Any) -> Any:
    if isinstance(term, pyoxigraph.NamedNode):
        return _key(rdflib.URIRef(term.value))
    if isinstance(term, pyoxigraph.BlankNode):
        return "blank"
    if term.language:
        return _key(rdflib.Literal(term.value, lang=term.language))
    datatype = rdflib.URIRef(term.datatype.value)
    return _key(rdflib.Literal(term.value, datatype=datatype, normalize=False))


def _key(term: Any) -> Any:
    """Return a term by value: numbers to nine digits, times as such."""
    if isinstance(term, rdflib.BNode):
        return "blank"
    if isinstance(term, rdflib.URIRef):
        return str(term)
    kind = str(term.datatype or "").rsplit("#", 1)[-1]
    if kind in NUMBERS:
        return kind, float(f"{float(term):.9g}")
    if kind == "dateTime":
        return kind, datetime.fromisoformat(str(term).replace("Z", "+00:00"))
    return ("" if kind == "string" else kind), term.language, str(term)
