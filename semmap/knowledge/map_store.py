"""The map as a store of rdflib: it reads each triple pattern by SQL, and is read-only."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Any

import rdflib
from rdflib.store import Store

from semmap.knowledge.map_view import MapView


class MapStore(Store):
    """A store for `rdflib.Dataset`."""

    context_aware = True
    graph_aware = True

    def __init__(self, view: MapView) -> None:
        super().__init__()
        self._view = view

    def triples(self, triple_pattern: tuple[Any, Any, Any], context: Any = None) -> Iterator[Any]:
        """Yield the triples that match a pattern, None for any."""
        for triple in self._view.triples(triple_pattern, _name(context)):
            yield triple, iter([context])

    def contexts(self, triple: Any = None) -> Generator[Any, None, None]:
        """Yield the named graphs."""
        rows = self._view.session.execute(
            "SELECT DISTINCT graph FROM statement WHERE map_id = %s AND graph <> ''",
            (self._view.number,),
        ).fetchall()
        chosen = self._view.chosen
        yield from (rdflib.URIRef(g) for (g,) in rows if chosen is None or g in chosen.named)

    def __len__(self, context: Any = None) -> int:
        return sum(1 for _ in self.triples((None, None, None), context))


def _name(context: Any) -> rdflib.URIRef | None:
    """Return the IRI of a named graph; None for the default graph."""
    name = getattr(context, "identifier", context)
    if not isinstance(name, rdflib.URIRef) or name == rdflib.graph.DATASET_DEFAULT_GRAPH_ID:
        return None
    return name
