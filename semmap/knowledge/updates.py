"""SPARQL 1.1 Update on a map: all requests of a text, or none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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
from semmap.knowledge.queries import errors_of, filled, limited, plain
from semmap.knowledge.shacl import BrokenShapeError
from semmap.knowledge.sparql.expressions import UntranslatedError
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.sparql.scope import Chosen
from semmap.knowledge.vocabulary import prefixes
from semmap.language.parser import ParsedText, parse_sparql


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
    with limited(session, seconds) as deadline:
        view = MapView.of(session)
        view.deadline = deadline
        parsed = parse_sparql(text, "update", tuple(prefixes(view.name).items()))
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
    """Return how many facts a request added and removed."""
    name = request.name
    if name == "InsertData":
        return FactWriter(view).insert(_data(request)), 0
    if name == "DeleteData":
        return 0, FactWriter(view).delete(_data(request))
    if name == "DeleteWhere":
        pattern = _pattern_of(request)
        view.chosen = dataset
        gone = list(_instances(view, [request], pattern, None))
        view.chosen = None
        return 0, FactWriter(view).delete(gone)
    if name == "Modify":
        graph = request.withClause
        where = request.where
        view.chosen = dataset or Chosen.by(
            request.using
        )  # more than WITH says (Update, section 3.1.3)
        if graph is not None and view.chosen is None:
            where = CompValue("Graph", term=graph, p=where)
        # Both templates are filled before anything is changed.
        gone = list(_instances(view, [request.delete], where, graph))
        new = list(_instances(view, [request.insert], where, graph))
        view.chosen = None
        removed = FactWriter(view).delete(gone)
        return FactWriter(view).insert(new), removed
    if name in ("Clear", "Drop"):
        return 0, _clear(view, request)
    if name == "Create":
        return 0, 0  # a graph exists where it has statements
    if name == "Load":
        return 0, 0  # only with SILENT
    assert name in ("Add", "Move", "Copy"), name
    source, target = map(_graph_of, request.graph)
    return _copy(view, source, target, name)


def _data(request: Any) -> Iterator[Fact]:
    """Yield the facts of INSERT DATA and DELETE DATA."""
    yield from (Fact(*map(plain, triple)) for triple in request.triples or ())
    for graph, triples in (request.quads or {}).items():
        for triple in triples:
            s, p, o = map(plain, triple)
            yield Fact(s, p, o, plain(graph))


def _pattern_of(request: Any) -> Any:
    """Return the pattern of DELETE WHERE: its own template."""
    pattern: Any = CompValue("BGP", triples=list(request.triples or ()))
    for graph, triples in (request.quads or {}).items():
        named = CompValue("Graph", term=graph, p=CompValue("BGP", triples=list(triples)))
        pattern = CompValue("Join", p1=pattern, p2=named)
    return pattern


def _instances(view: MapView, templates: Iterable[Any], where: Any, graph: Any) -> Iterator[Fact]:
    """Yield the facts of templates for each solution of a pattern."""
    for template in templates:
        if not template:
            continue
        quads: list[tuple[Any, list[Any]]] = [(graph, list(template.triples or ()))]
        quads += [(name, list(triples)) for name, triples in (template.quads or {}).items()]
        names = sorted(
            {
                str(term)
                for name, triples in quads
                for term in [name, *(t for triple in triples for t in triple)]
                if isinstance(term, rdflib.Variable)
            }
        )
        for row in view.run(view.statement(where, names)):
            solution = dict(zip(names, row, strict=True))
            for name, triples in quads:
                target = solution.get(str(name)) if isinstance(name, rdflib.Variable) else name
                for triple in filled(triples, solution):
                    if name is None or target is not None:
                        s, p, o = triple
                        yield Fact(s, p, o, None if target is None else plain(target))


def _clear(view: MapView, request: Any) -> int:
    graph = request.graphiri
    conditions = {"NAMED": "graph <> ''", "ALL": "true", "DEFAULT": "graph = ''"}
    condition = conditions.get(str(graph), "graph = %(graph)s")
    removed = view.session.execute(
        f"DELETE FROM statement WHERE map_id = %(map)s AND {condition}",
        {"map": view.number, "graph": str(graph)},
    ).rowcount
    if str(graph) in ("DEFAULT", "ALL"):
        _refuse_to_clear_map(view)
    return removed


def _refuse_to_clear_map(view: MapView) -> None:
    """Raise an error where the default graph has more than statements, after these are gone."""
    pattern = CompValue("BGP", triples=[tuple(map(rdflib.Variable, "spo"))])
    for triple in view.run(view.statement(pattern, "spo", limit=1)):
        raise RefusedError(
            "the default graph is the map: delete facts of it, or drop the map with semmap drop",
            Fact(*triple),
        )


def _refuse_ends(view: MapView, graph: Any, facts: list[Fact]) -> None:
    """Raise an error where a statement of a graph has a lifespan: a copy of it would not end."""
    row = view.session.execute(
        "SELECT FROM statement WHERE map_id = %s AND graph = %s AND until > statement_timestamp()",
        (view.number, str(graph or "")),
    ).fetchone()
    if row is not None:
        raise RefusedError("statements with a lifespan are not copied: state them again", facts[0])


def _graph_of(name: Any) -> rdflib.URIRef | None:
    """Return the IRI of a graph; None for the default graph."""
    return None if str(name) == "DEFAULT" else rdflib.URIRef(str(name))


def _copy(
    view: MapView, source: rdflib.URIRef | None, target: rdflib.URIRef | None, name: str
) -> tuple[int, int]:
    """Copy the facts of a graph to another, which loses its own unless they are added."""
    if source == target:
        return 0, 0
    pattern: Any = CompValue("BGP", triples=[tuple(map(rdflib.Variable, "spo"))])
    if source is not None:
        pattern = CompValue("Graph", term=source, p=pattern)
    found = view.run(view.statement(pattern, "spo"))
    copied = [Fact(s, p, o, target) for s, p, o in found]
    _refuse_ends(view, source, copied)
    removed = 0
    if name != "Add":
        removed = _clear(view, CompValue("Clear", graphiri="DEFAULT" if target is None else target))
    added = FactWriter(view).insert(copied)
    if name == "Move":
        gone = CompValue("Clear", graphiri="DEFAULT" if source is None else source)
        removed += _clear(view, gone)
    return added, removed


@contextmanager
def _refusals(parsed: ParsedText, at: Any) -> Iterator[None]:
    """Report what the map does not allow as an error of a text."""
    try:
        yield
    except UntranslatedError as error:
        reason = f"{error.reason}, which updates need: write it otherwise"
        raise parsed.error(reason, at) from error
    except (RefusedError, BrokenShapeError, *DENIED) as error:
        raise parsed.error(refusal_text(error), at) from error
