"""What changed in a map, for standing queries: entities with their nodes, and statements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import rdflib

from semmap.knowledge.map_view import MapView, Term, term_of
from semmap.knowledge.mapping import NODES
from semmap.knowledge.standing.parts import Quad
from semmap.knowledge.triple_map import Form
from semmap.knowledge.vocabulary import encode

__all__ = ["Changes", "Touched"]

_OF_MAP = {form: node.prefix for form, node in NODES.items() if node.of_map}


class Changes(NamedTuple):
    """What changed.

    Attributes
    ----------
    entities : ids of the entities of which rows of tables changed
    facts : the statements that were added, removed, or ended, as the table `change` has them
    others : something else changed that only queries as a whole can depend on, such as a belief
    all : anything may have changed
    """

    entities: frozenset[int] = frozenset()
    facts: tuple[tuple[Any, ...], ...] = ()
    others: bool = False
    all: bool = False


class Touched:
    """The entities and statements that changes are about.

    Attributes
    ----------
    ids : of the changed entities
    names : of the entities that there are, by id: the changed ones, and those of statements
    every_name : names that changed entities have or had
    renamed : ids of changed entities that had another name
    changed : the nodes of changed entities, with their forms; under former names, too
    nodes : the nodes that there are, with form and id
    quads : the statements, and whether they hold now
    """

    def __init__(self, view: MapView, changes: Changes) -> None:
        self._namespace = view.namespace
        self.ids = changes.entities
        numbers = {n for f in changes.facts for n in (f[1], f[3] if f[4] is None else None)}
        every = sorted(self.ids | {n for n in numbers if isinstance(n, int)})
        rows = view.session.execute(
            "SELECT id, name, true FROM entity WHERE id = ANY (%(ids)s) AND map_id = %(map)s "
            "UNION ALL SELECT DISTINCT entity_id, name, false FROM entity_history "
            "WHERE entity_id = ANY (%(ids)s) AND map_id = %(map)s",
            {"ids": every, "map": view.number},
        ).fetchall()
        self.names: dict[int, str] = {number: name for number, name, now in rows if now}
        former = {(number, name) for number, name, now in rows if not now}
        former -= set(self.names.items())
        self.every_name = {name for number, name, _ in rows if number in self.ids}
        self.renamed = {n for n, _ in former if n in self.names and n in self.ids}
        self.changed: dict[Term, Form] = {}
        self.nodes: dict[Term, tuple[Form, int]] = {}
        for number, name in {*former, *self.names.items()}:
            for form in _OF_MAP:
                node = self._iri(name, form)
                if number in self.ids:
                    self.changed[node] = form
                if self.names.get(number) == name:
                    self.nodes[node] = (form, number)
        last = {**dict(former), **self.names}
        self.quads: dict[Quad, bool] = {}
        for fact, alive in zip(changes.facts, _alive(view, changes.facts), strict=True):
            quad = self._quad(fact, last)
            if quad is not None:
                self.quads[quad] = alive or self.quads.get(quad, False)

    def node(self, number: int, form: Form) -> Term:
        """Return the IRI of a node of an entity."""
        return self._iri(self.names[number], form)

    def _iri(self, name: str, form: Form) -> Term:
        return rdflib.URIRef(f"{self._namespace}{_OF_MAP[form]}{encode(name)}")

    def _quad(self, fact: tuple[Any, ...], names: Mapping[int, str]) -> Quad | None:
        graph, subject, verb, object_, tag = fact
        ends: list[Any] = []
        for end, kind in ((subject, "I"), (object_, tag)):
            if isinstance(end, int):
                if end not in names:
                    return None  # neither the entity nor its history is kept
                ends.append(self._iri(names[end], "entity"))
            else:
                ends.append(term_of(end, kind))
        named = rdflib.URIRef(graph) if graph else None
        return Quad(ends[0], rdflib.URIRef(verb), ends[1], named)


def _alive(view: MapView, facts: Iterable[tuple[Any, ...]]) -> list[bool]:
    """Return which statements hold now."""
    columns: list[list[Any]] = [[], [], [], [], [], [], []]
    for graph, subject, verb, object_, tag in facts:
        ids = [end if isinstance(end, int) else None for end in (subject, object_)]
        texts = [None if isinstance(end, int) else end for end in (subject, object_)]
        for column, value in zip(
            columns, (graph, verb, ids[0], texts[0], ids[1], texts[1], tag), strict=True
        ):
            column.append(value)
    if not columns[0]:
        return []
    rows = view.session.execute(
        "SELECT EXISTS (SELECT FROM statement s WHERE s.map_id = %s AND s.predicate = f.verb "
        "AND s.graph = f.graph AND coalesce(s.subject_id, 0) = coalesce(f.subject_id, 0) "
        "AND coalesce(s.subject, '') = coalesce(f.subject, '') "
        "AND coalesce(s.object_id, 0) = coalesce(f.object_id, 0) "
        "AND md5(coalesce(s.object, '')) = md5(coalesce(f.object, '')) "
        "AND coalesce(s.tag, '') = coalesce(f.tag, '') "
        "AND (s.until IS NULL OR s.until > statement_timestamp())) "
        "FROM unnest(%s::text[], %s::text[], %s::bigint[], %s::text[], %s::bigint[], %s::text[], "
        "%s::text[]) WITH ORDINALITY "
        "f (graph, verb, subject_id, subject, object_id, object, tag, n) ORDER BY f.n",
        (view.number, *columns),
    ).fetchall()
    return [bool(row[0]) for row in rows]
