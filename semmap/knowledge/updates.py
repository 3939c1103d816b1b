"""SPARQL 1.1 Update on a map: all requests of a text, or none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import psycopg
import rdflib

from semmap.knowledge.facts import Fact, FactWriter, RefusedError
from semmap.knowledge.map_view import MapView, Session
from semmap.knowledge.queries import errors_of, filled, limited, plain
from semmap.knowledge.vocabulary import prefixes
from semmap.language.error import QueryError
from semmap.language.parser import ParsedText, parse_sparql

__all__ = ["Changes", "update"]


@dataclass(frozen=True)
class Changes:
    """What an update changed.

    Attributes
    ----------
    added, removed : numbers of facts
    """

    added: int
    removed: int


def update(session: Session, text: str, *, seconds: float | None = None) -> Changes:
    """Carry out an update on the map that a session sees, as a whole or not at all.

    Facts that tables have columns for change these tables: a type, a label, a property, a link, a
    holder, the state of a door. All others are stored as statements. What follows from other facts,
    such as a position, is refused.

    Parameters
    ----------
    text : SPARQL 1.1 Update
    seconds : after which the server stops it; by default the limit of `semmap.limits`

    Raises
    ------
    QueryError
        The text is wrong, or the map does not allow a fact; nothing was changed.
    KnowledgeError
        It took too long; nothing was changed.

    Examples
    --------
    >>> update(session, "INSERT DATA { :cup1 prop:colour 'red' }")  # doctest: +SKIP
    Changes(added=1, removed=0)
    """
    with limited(session, seconds) as deadline:
        view = MapView.of(session)
        view.deadline = deadline
        parsed = parse_sparql(text, "update", tuple(prefixes(view.name).items()))
        added = removed = 0
        for request in parsed.requests:
            with errors_of(parsed), _refusals(parsed, request):
                more, less = _carry_out(view, request, parsed)
            added, removed = added + more, removed + less
    return Changes(added, removed)


def _carry_out(view: MapView, request: Any, parsed: ParsedText) -> tuple[int, int]:
    """Return how many facts a request added and removed."""
    name = request.name
    if name == "InsertData":
        return FactWriter(view).insert(_data(request)), 0
    if name == "DeleteData":
        return 0, FactWriter(view).delete(_data(request))
    if name == "DeleteWhere":
        pattern = _pattern_of(request)
        return 0, FactWriter(view).delete(_instances(view, [request], pattern, None))
    if name == "Modify":
        graph = request.withClause
        where = request.where
        if graph is not None:
            from rdflib.plugins.sparql.parserutils import CompValue

            where = CompValue("Graph", term=graph, p=where)
        # Both templates are filled before anything is changed.
        gone = list(_instances(view, [request.delete], where, graph))
        new = list(_instances(view, [request.insert], where, graph))
        removed = FactWriter(view).delete(gone)
        return FactWriter(view).insert(new), removed
    if name in ("Clear", "Drop"):
        return 0, _clear(view, request)
    if name == "Create":
        return 0, 0  # a graph exists where it has statements
    if name in ("Add", "Move", "Copy"):
        return _copy(view, request, name, parsed)
    raise parsed.error(f"{name} is not supported", request)


def _data(request: Any) -> Iterator[Fact]:
    """Yield the facts of INSERT DATA and DELETE DATA."""
    yield from (Fact(*map(plain, triple)) for triple in request.triples or ())
    for graph, triples in (request.quads or {}).items():
        for triple in triples:
            s, p, o = map(plain, triple)
            yield Fact(s, p, o, plain(graph))


def _pattern_of(request: Any) -> Any:
    """Return the pattern of DELETE WHERE: its own template."""
    from rdflib.plugins.sparql.parserutils import CompValue

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
    if str(graph) in ("DEFAULT", "ALL"):
        raise RefusedError(
            "the default graph is the map: delete its facts, or drop the map with semmap drop",
            Fact(plain(rdflib.URIRef("")), rdflib.URIRef(""), rdflib.URIRef("")),
        )
    return view.session.execute(
        f"DELETE FROM statement WHERE map_id = %(map)s AND {condition}",
        {"map": view.number, "graph": str(graph)},
    ).rowcount


def _copy(view: MapView, request: Any, name: str, parsed: ParsedText) -> tuple[int, int]:
    source, target = request.graph
    if "DEFAULT" in (str(source), str(target)):
        raise parsed.error("the default graph is the map: name a graph", request)
    values = {"map": view.number, "source": str(source), "target": str(target)}
    removed = 0
    if str(source) == str(target):
        return 0, 0
    if name != "Add":
        removed = view.session.execute(
            "DELETE FROM statement WHERE map_id = %(map)s AND graph = %(target)s", values
        ).rowcount
    added = view.session.execute(
        "INSERT INTO statement (map_id, graph, subject_id, subject, predicate, object_id, object, "
        "tag, until) SELECT map_id, %(target)s, subject_id, subject, predicate, object_id, object, "
        "tag, until FROM statement WHERE map_id = %(map)s AND graph = %(source)s "
        "ON CONFLICT DO NOTHING",
        values,
    ).rowcount
    if name == "Move":
        removed += view.session.execute(
            "DELETE FROM statement WHERE map_id = %(map)s AND graph = %(source)s", values
        ).rowcount
    return added, removed


class _refusals:
    """Reports what the map does not allow as an error of a text."""

    def __init__(self, parsed: ParsedText, request: Any) -> None:
        self._parsed, self._request = parsed, request

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: Any, traceback: Any) -> None:
        if isinstance(error, RefusedError):
            raise self._error(f"{error.fact.shown()}: {error.reason}") from error
        if isinstance(error, (psycopg.IntegrityError, psycopg.errors.InsufficientPrivilege)):
            lines = [error.diag.message_primary or str(error), error.diag.message_hint]
            raise self._error(". ".join(line for line in lines if line)) from error

    def _error(self, reason: str) -> QueryError:
        return self._parsed.error(reason, self._request)
