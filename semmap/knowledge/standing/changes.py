"""What changed in a map, for standing queries: entities with their nodes, and statements."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any, NamedTuple

import psycopg
import rdflib

from semmap.knowledge.facts import Fact
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH, NODES
from semmap.knowledge.sparql.stored_terms import Term, term_of
from semmap.knowledge.triple_map import Form
from semmap.knowledge.vocabulary import encode

_OF_MAP = {form: node.prefix for form, node in NODES.items() if node.of_map}


class Changes(NamedTuple):
    """What changed."""

    entities: frozenset[int] = frozenset()  # ids of the entities of which rows of tables changed
    # the statements and inferences that were added, removed, or ended, as the table `change` has
    # them
    facts: tuple[tuple[Any, ...], ...] = ()
    removed: bool = False  # entities were deleted, and with them what was inferred about them
    # something else changed that only queries as a whole can depend on, such as a belief
    others: bool = False
    fields: bool = False  # what fields state changed
    all: bool = False  # anything may have changed

    @property
    def every_id(self) -> list[int]:
        """The ids of the changed entities, and of those in facts."""
        ends = {n for f in self.facts for n in (f[1], f[3] if f[4] is None else None)}
        return sorted(self.entities | {n for n in ends if isinstance(n, int)})


class Touched:
    """The entities and statements that changes are about."""

    def __init__(self, view: MapView, changes: Changes, answers: Answers) -> None:
        self.namespace = view.namespace
        self.ids = changes.entities
        rows = answers.names.fetchall()
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
        self.quads: dict[Fact, bool] = {}
        alive = answers.facts.fetchall() if answers.facts else ()
        for fact, (is_stated, is_inferred) in zip(changes.facts, alive, strict=True):
            quad = self._quad(fact, last)
            if quad is None:
                continue
            if fact[0] == INFERRED_GRAPH:
                self.quads[quad] = is_inferred
                quad = quad._replace(graph=None)
            self.quads[quad] = is_stated or is_inferred or self.quads.get(quad, False)

    def node(self, number: int, form: Form) -> Term:
        """Return the IRI of a node of an entity."""
        return self._iri(self.names[number], form)

    def _iri(self, name: str, form: Form) -> Term:
        return rdflib.URIRef(f"{self.namespace}{_OF_MAP[form]}{encode(name)}")

    def _quad(self, fact: tuple[Any, ...], names: Mapping[int, str]) -> Fact | None:
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
        return Fact(ends[0], rdflib.URIRef(verb), ends[1], named)


_SAME = (
    "i.predicate = f.predicate AND i.object_id IS NOT DISTINCT FROM f.object_id "
    "AND (i.object, i.tag) IS NOT DISTINCT FROM (f.object, f.tag) AND NOT i.told "
    "AND (i.object_id IS NULL OR EXISTS (SELECT FROM entity WHERE id = i.object_id)) "
    f"AND i.graph = CASE WHEN f.graph = '' THEN '{INFERRED_GRAPH}' ELSE f.graph END"
)
_INFERRED = (
    "CASE WHEN f.subject_id IS NOT NULL "
    f"THEN EXISTS (SELECT FROM inference i WHERE i.subject_id = f.subject_id AND {_SAME} "
    "AND EXISTS (SELECT FROM entity WHERE id = f.subject_id)) "
    "ELSE EXISTS (SELECT FROM inference i WHERE i.map_id = %(map)s::int AND i.subject = f.subject "
    f"AND {_SAME}) END"
)
_STATED = (
    "EXISTS (SELECT FROM triple s WHERE s.map_id = %(map)s::int "
    "AND s.predicate = term_id(f.predicate) "
    "AND s.graph = CASE WHEN f.graph = '' THEN 0 ELSE term_id(f.graph) END "
    "AND s.subject = coalesce(f.subject_id, term_id(f.subject)) "
    "AND s.object = coalesce(f.object_id, term_id(f.object, f.tag)) "
    "AND (s.until IS NULL OR s.until > statement_timestamp()))"
)
_ALIVE = (
    f"SELECT {_STATED}, {{}} "
    "FROM unnest(%(graph)s::text[], %(subject_id)s::bigint[], %(subject)s::text[], "
    "%(predicate)s::text[], %(object_id)s::bigint[], %(object)s::text[], %(tag)s::text[]) "
    "WITH ORDINALITY f (graph, subject_id, subject, predicate, object_id, object, tag, n) "
    "ORDER BY f.n"
)


_NAMES = (
    "SELECT id, name, true FROM entity "
    "WHERE id = ANY (%(ids)s::bigint[]) AND map_id = %(map)s::int "
    "UNION ALL SELECT DISTINCT entity_id, name, false FROM entity_history "
    "WHERE entity_id = ANY (%(ids)s::bigint[]) AND map_id = %(map)s::int"
)


class Answers(NamedTuple):
    """What the database was asked about changes: names of entities, and which facts hold."""

    names: psycopg.Cursor[Any]
    facts: psycopg.Cursor[Any] | None


def ask(view: MapView, changes: Changes) -> Answers:
    """Ask the names of the entities in changes, and which facts are stated and inferred now."""
    values: dict[str, Any] = {"map": view.number, "ids": changes.every_id}
    names = view.session.execute(_NAMES, values, prepare=True)
    columns: dict[str, list[Any]] = defaultdict(list)
    for graph, subject, verb, object_, tag in changes.facts:
        columns["graph"].append("" if graph == INFERRED_GRAPH else graph)
        columns["predicate"].append(verb)
        columns["tag"].append(tag)
        for side, end in (("subject", subject), ("object", object_)):
            is_entity = isinstance(end, int)
            columns[f"{side}_id"].append(end if is_entity else None)
            columns[side].append(None if is_entity else end)
    if not columns:
        return Answers(names, None)
    sql = _ALIVE.format(_INFERRED if view.inferred.properties else "false")
    facts = view.session.execute(sql.encode(), {"map": view.number, **columns}, prepare=True)
    return Answers(names, facts)
