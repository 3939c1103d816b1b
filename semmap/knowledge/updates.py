"""SPARQL 1.1 Update on a map: all requests of a text, or none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import rdflib
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.facts import (
    DENIED,
    Fact,
    FactWriter,
    RefusedError,
    refusal_text,
    with_consequences,
)
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH
from semmap.knowledge.queries import errors_of, filled, limited_view, plain
from semmap.knowledge.shacl import BrokenShapeError
from semmap.knowledge.sparql.expressions import UntranslatedError
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.sparql.scope import NOTHING_INFERRED, Chosen
from semmap.knowledge.vocabulary import graph_names
from semmap.language.parser import ParsedText


@dataclass(frozen=True)
class GraphChanges:
    """How many facts an update added and removed."""

    added: int
    removed: int


def update(
    session: Session,
    text: str,
    *,
    seconds: float | None = None,
    dataset: Chosen | None = None,
) -> GraphChanges:
    """Carry out an update on the map that a session sees, as a whole or not at all.

    Facts that tables have columns for change these tables: a type, a label, a property, a link, a
    holder, the state of a door. All others are stored as statements. What follows from other facts
    is refused: QueryError, as for shapes that bind the map; KnowledgeError after `seconds`.
    `dataset` has the graphs that patterns read, as USING and USING NAMED choose them.
    """
    with limited_view(session, seconds) as view:
        parsed = view.parsed(text, "update")
        for request in parsed.requests if dataset is not None else ():
            if request.using or request.withClause is not None:
                raise parsed.error("graphs are chosen twice: leave USING and WITH out", 0)
        added = removed = 0
        with _refusals(parsed, 0), with_consequences(view):
            for request in parsed.requests:
                with errors_of(parsed), _refusals(parsed, request):
                    more, less = _carried_out(view, request, dataset)
                added, removed = added + more, removed + less
    return GraphChanges(added, removed)


def _carried_out(view: MapView, request: Any, dataset: Chosen | None) -> tuple[int, int]:
    """Return how many facts a request added and removed; SILENT ones may do nothing."""
    try:
        with view.session.transaction():
            return _carry_out(view, request, dataset)
    except RefusedError:
        if request.silent is None:
            raise
        return 0, 0


def _carry_out(view: MapView, request: Any, dataset: Chosen | None) -> tuple[int, int]:
    name = request.name
    if name == "InsertData":
        return FactWriter(view).insert(_data(request)), 0
    if name == "DeleteData":
        return 0, FactWriter(view).delete(_data(request))
    if name in ("DeleteWhere", "Modify"):
        graph, delete, where = request.withClause, request.delete, request.where
        if name == "DeleteWhere":
            delete, where = request, _pattern_of(request)
        view.chosen = dataset or Chosen.by(request.using)
        if graph is not None and view.chosen is None:  # USING says more (Update, section 3.1.3)
            where = CompValue("Graph", term=graph, p=where)
        # Both templates are filled before anything is changed.
        gone = list(_instances(view, delete, where, graph))
        new = list(_instances(view, request.insert, where, graph))
        view.chosen = None
        removed = FactWriter(view).delete(gone)
        return FactWriter(view).insert(new), removed
    if name in ("Clear", "Drop"):
        return 0, _clear(view, str(request.graphiri))
    if name in ("Create", "Load"):
        return 0, 0  # a graph exists where it has statements; LOAD is SILENT
    assert name in ("Add", "Move", "Copy"), name
    source, target = map(str, request.graph)
    return _copy(view, source, target, name)


def _quads(template: Any, graph: Any = None) -> list[tuple[Any, list[Any]]]:
    """Return the triples of a template by graph; those without one are in the graph given."""
    named = [(name, list(triples)) for name, triples in (template.quads or {}).items()]
    return [(graph, list(template.triples or ())), *named]


def _data(request: Any) -> Iterator[Fact]:
    for graph, triples in _quads(request):
        for triple in triples:
            s, p, o = map(plain, triple)
            yield Fact(s, p, o, None if graph is None else plain(graph))


def _pattern_of(request: Any) -> Any:
    """Return the pattern of DELETE WHERE: its own template."""
    (_, triples), *quads = _quads(request)
    pattern: Any = CompValue("BGP", triples=triples)
    for graph, inner in quads:
        named = CompValue("Graph", term=graph, p=CompValue("BGP", triples=inner))
        pattern = CompValue("Join", p1=pattern, p2=named)
    return pattern


def _instances(view: MapView, template: Any, where: Any, graph: Any) -> Iterator[Fact]:
    quads = _quads(template, graph) if template else []
    terms = (term for name, triples in quads for term in (name, *chain.from_iterable(triples)))
    names = sorted({str(term) for term in terms if isinstance(term, rdflib.Variable)})
    for row in view.run(view.statement(where, names)) if quads else ():
        solution = dict(zip(names, row, strict=True))
        for name, triples in quads:
            target = solution.get(str(name)) if isinstance(name, rdflib.Variable) else name
            for s, p, o in filled(triples, solution):
                if name is None or target is not None:
                    yield Fact(s, p, o, None if target is None else plain(target))


def _clear(view: MapView, graph: str) -> int:
    conditions = {"NAMED": "graph <> 0", "ALL": "true", "DEFAULT": "graph = 0"}
    named = "graph IN (SELECT term_id(n) FROM unnest(%(graphs)s::text[]) n)"
    removed = view.session.execute(
        f"DELETE FROM triple WHERE map_id = %(map)s AND {conditions.get(graph, named)}".encode(),
        {"map": view.number, "graphs": graph_names(graph)},
    ).rowcount
    if graph in ("DEFAULT", "ALL"):
        # Has the default graph more than statements, now that these are gone?
        for triple in view.run(view.statement(_EVERYTHING, "spo", limit=1)):
            raise RefusedError(
                "the default graph is the map: delete facts of it, or drop the map with semmap "
                "drop",
                Fact(*triple),
            )
    return removed


_EVERYTHING = CompValue("BGP", triples=[tuple(map(rdflib.Variable, "spo"))])


def _refuse_ends(view: MapView, graph: str, facts: list[Fact]) -> None:
    """Raise an error where a statement of a graph has a lifespan: a copy of it would not end."""
    ending = (
        "SELECT true FROM statement "
        "WHERE map_id = %s AND graph = %s AND until > statement_timestamp() LIMIT 1"
    )
    if view.value(ending, view.number, graph):
        raise RefusedError("statements with a lifespan are not copied: state them again", facts[0])


def _copy(view: MapView, source: str, target: str, name: str) -> tuple[int, int]:
    """Copy the facts of a graph to another, which loses its own unless they are added."""
    if source == target:
        return 0, 0
    pattern: Any = _EVERYTHING
    if source != "DEFAULT":
        pattern = CompValue("Graph", term=rdflib.URIRef(source), p=pattern)
    graph = None if target == "DEFAULT" else rdflib.URIRef(target)
    told = view if source == INFERRED_GRAPH else replace(view, inferred=NOTHING_INFERRED)
    copied = [Fact(s, p, o, graph) for s, p, o in told.run(told.statement(pattern, "spo"))]
    _refuse_ends(view, "" if source == "DEFAULT" else source, copied)
    removed = 0 if name == "Add" else _clear(view, target)
    added = FactWriter(view).insert(copied)
    if name == "Move":
        removed += _clear(view, source)
    return added, removed


@contextmanager
def _refusals(parsed: ParsedText, at: Any) -> Iterator[None]:
    """Report what the map does not allow as an error of a text."""
    try:
        yield
    except UntranslatedError as error:
        reason = f"{error}, which updates need: write it otherwise"
        raise parsed.error(reason, at) from error
    except (RefusedError, BrokenShapeError, *DENIED) as error:
        raise parsed.error(refusal_text(error), at) from error
