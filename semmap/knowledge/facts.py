"""Facts into the tables that have columns for them, and all others as statements."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Set
from contextlib import ExitStack, contextmanager
from datetime import datetime
from functools import cache, cached_property, lru_cache
from itertools import islice
from select import select
from typing import Any, NamedTuple

import psycopg
import rdflib
from psycopg.pq import PipelineStatus

from semmap.error import Error
from semmap.knowledge.fields.properties import is_of_fields
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import COMPUTED, INFERRED_GRAPH, is_mapped
from semmap.knowledge.reasoning.runs import refresh
from semmap.knowledge.shacl import binding_shapes, check_binding
from semmap.knowledge.sparql.constants import Constants, resolve, tag_and_text
from semmap.knowledge.unknown_names import unknown_names
from semmap.knowledge.vocabulary import (
    IRI,
    KNOWLEDGE_CORE,
    PROPERTY,
    RDF,
    RDFS,
    RELATION,
    SEMMAP,
    XSD,
    decode,
    prefixes,
    short,
)
from semmap.limits import NO_CHARACTER
from semmap.query.refusal import denied

SKOLEM = "urn:semmap:blank:"  # blank nodes of updates and files get an IRI (RDF 1.1, section 3.5)

_GIVEN = """
WITH n AS MATERIALIZED (SELECT {} AS ids
    FROM (SELECT ARRAY(SELECT json_array_elements_text(%s::json)) AS texts,
                 ARRAY(SELECT json_array_elements_text(%s::json)) AS tags) given),
s AS (SELECT CASE WHEN g < 0 THEN ids[-g::integer] ELSE g END AS graph,
             CASE WHEN s < 0 THEN ids[-s::integer] ELSE s END AS subject,
             CASE WHEN p < 0 THEN ids[-p::integer] ELSE p END AS predicate,
             CASE WHEN o < 0 THEN ids[-o::integer] ELSE o END AS object
      FROM n, unnest(%s::bigint[], %s::bigint[], %s::bigint[], %s::bigint[]) given (g, s, p, o))
"""
"""Statements: of entities the numbers, of terms the places in a list, counted by -1, -2, ..."""

_STATE = (
    _GIVEN.format("term_ids(texts, tags)")
    + """
INSERT INTO triple (graph, subject, predicate, object, map_id, until)
SELECT s.*, %s::integer, %s::timestamptz FROM s
ON CONFLICT (map_id, predicate, subject, object, graph) DO UPDATE SET until = excluded.until,
    since = CASE WHEN triple.until > statement_timestamp() THEN triple.since ELSE excluded.since END
WHERE triple.until < coalesce(excluded.until, 'infinity')
"""
)
_TAKE_BACK = (
    _GIVEN.format(
        "(SELECT array_agg(term_id(text, tag) ORDER BY n) "
        "FROM unnest(texts, tags) WITH ORDINALITY t (text, tag, n))"
    )
    + """
DELETE FROM triple t USING s WHERE t.map_id = %s AND t.graph = s.graph
AND t.subject = s.subject AND t.predicate = s.predicate AND t.object = s.object
"""
)

_BATCH = 10_000  # facts that are looked up and stated at once
_MANY = 1_000  # facts after which the planner learns of the tables
_FEW = 500  # IRIs of which each is looked up; of more, those that may be the map's


class Fact(NamedTuple):
    """A triple of a graph; None for the default graph."""

    subject: Any
    property: Any
    object: Any
    graph: Any = None

    def shown(self) -> str:
        """Return the triple as Turtle."""
        known = prefixes("")
        return " ".join(
            short(str(t), known) if isinstance(t, rdflib.URIRef) else t.n3() for t in self[:3]
        )


class RefusedError(Error, ValueError):
    """A fact that the map does not allow: why, and what to do."""

    def __init__(self, reason: str, fact: Fact) -> None:
        super().__init__(f"{fact.shown()}: {reason}")
        self.reason, self.fact = reason, fact


def _unwritable(term: Any) -> str | None:
    """Return why files, or the database, cannot have a term."""
    iri = getattr(term, "datatype", None) if isinstance(term, rdflib.Literal) else term
    if isinstance(iri, rdflib.URIRef) and not IRI.fullmatch(iri):
        return f"{str(iri)!r} is not an absolute IRI: correct it"
    if isinstance(term, rdflib.Literal) and (wrong := NO_CHARACTER.search(term)):
        return f"U+{ord(wrong[0]):04X} is not a character: leave it out"
    return None


_ROWS = re.compile(r"(?:UPDATE|DELETE FROM) (\w+) (?:SET .*? )?(WHERE .*)")
"""The table and condition of a statement."""

DENIED = (psycopg.IntegrityError, psycopg.errors.InsufficientPrivilege)
"""How the server refuses a change."""


def refusal_text(error: Exception) -> str:
    """Return why the map, or the server, does not allow a change."""
    if not isinstance(error, psycopg.Error):
        return str(error)
    lines = [error.diag.message_primary or str(error), error.diag.message_hint]
    return ". ".join(line for line in lines if line)


@lru_cache(maxsize=10_000)
def _is_computed(iri: str) -> bool:
    return is_of_fields(iri) or any(iri == each.property for each in COMPUTED)


_OWN = ("urn:semmap:", *KNOWLEDGE_CORE)

Stated = tuple[psycopg.Cursor[Any], list[Fact], int]
"""A command that states facts: its result, the facts if shapes bind them, and their number."""


class FactWriter:
    """Writes facts of one request; new statements end after `lifespan` seconds; 0: never.

    With `unknown`, all facts with a name that is not an entity's are statements; else some are
    refused, and a type makes the entity.
    """

    def __init__(self, view: MapView, lifespan: float = 0, *, unknown: bool = False) -> None:
        self._view = view
        self._unknown = unknown
        self._until: datetime | None = None
        if lifespan:
            end = "SELECT clock_timestamp() + make_interval(secs => %s)"
            self._until = view.value(end, lifespan)
        self._constants = Constants({})
        self._blank: dict[str, str] = {}
        self._ends: dict[Any, int] = {}  # of one command
        self._terms: dict[tuple[str, str], int] = {}
        self._known_types: set[Any] = set()
        # The IRI of a type by which queries find what other IRIs of it state.
        self._type_iri = cache(lambda name: str(view.value("SELECT type_iri(%s)", name)))

    def insert(
        self, facts: Iterable[Fact], implied: Callable[[list[Fact]], Set[Fact]] | None = None
    ) -> int:
        """Add facts; return how many are new or end later; without an end, one keeps none.

        Statements about other than the map's nodes come first: while the server has some, the next
        are read. Of the other facts, those that are `implied` are left out.
        """
        of_map: list[Fact] = []
        stated: list[Stated] = []
        rest, session = iter(facts), self._view.session
        with ExitStack() as stack:
            while some := list(islice(rest, _BATCH)):
                if len(some) == _BATCH and session.pgconn.pipeline_status == PipelineStatus.OFF:
                    stack.enter_context(session.pipeline())
                self._refuse_unwritable(some)
                some = self._resolved(some)
                foreign = {each: self._is_foreign(each) for each in {f.subject for f in some}}
                statements = []
                for fact in some:
                    iri = self._property_of(fact)
                    own = fact.graph is None and not foreign[fact.subject]
                    if own and not self._lacks_object(fact, iri):
                        of_map.append(fact)
                    else:
                        self._refuse_invisible(fact, iri)
                        statements.append((fact, iri))
                if statements:
                    stated.append(self._change_statements(statements, _STATE))
        of_map = self._resolved(of_map)
        known = implied(of_map) if implied is not None and of_map else frozenset()
        # Types first: they make the entities that other facts are about.
        new = [fact for fact in of_map if fact not in known]
        new.sort(key=lambda fact: str(fact.property) != f"{RDF}type")
        return self._counted(stated) + self._change(new, self._insert_in_table, _STATE)

    def delete(self, facts: Iterable[Fact]) -> int:
        """Remove facts; return how many there were."""
        return self._change(self._resolved(facts), self._delete_in_table, _TAKE_BACK)

    def _change(
        self, facts: list[Fact], in_table: Callable[[Fact, str], int | None], sql: str
    ) -> int:
        """Change facts in tables, and the others as statements, many in one command."""
        changed, statements = 0, list[tuple[Fact, str]]()
        for fact in facts:
            self._view.check_time()
            iri = self._property_of(fact)
            done = in_table(fact, iri)
            if done is None:
                statements.append((fact, iri))
            elif done:
                changed += done
                self._touch([fact])
        parts = (statements[i : i + _BATCH] for i in range(0, len(statements), _BATCH))
        return changed + self._counted([self._change_statements(part, sql) for part in parts])

    def _resolved(self, facts: Iterable[Fact]) -> list[Fact]:
        """Return facts without repetitions; look up what their IRIs stand for."""
        found = list(dict.fromkeys(facts))
        terms = {term for fact in found for term in fact}
        iris = {str(term) for term in terms if isinstance(term, rdflib.URIRef)}
        view = self._view
        if len(iris) > _FEW:
            iris = {iri for iri in iris if iri.startswith(_OWN) or iri in self._classes}
        self._constants = (
            resolve(view.session, iris, view.namespace, view.number) if iris else Constants({})
        )
        return found

    @staticmethod
    def _refuse_unwritable(facts: list[Fact]) -> None:
        for term in dict.fromkeys(term for fact in facts for term in fact):
            if reason := _unwritable(term):
                raise RefusedError(reason, next(fact for fact in facts if term in fact))

    @cached_property
    def _classes(self) -> frozenset[str]:
        rows = self._view.session.execute("SELECT iri FROM semantic_type WHERE iri IS NOT NULL")
        return frozenset(iri for (iri,) in rows)

    def _change_statements(self, some: list[tuple[Fact, str]], sql: str) -> Stated:
        """Send one command, the result of which is not waited for in a pipeline."""
        self._view.check_time()
        self._ends, self._terms = {}, {}
        rows = {self._quad(fact, iri) for fact, iri in some}
        columns = [f"{{{','.join(map(str, column))}}}" for column in zip(*rows, strict=True)]
        terms = [json.dumps(list(column)) for column in zip(*self._terms, strict=True)]
        values = [self._view.number, self._until] if sql is _STATE else [self._view.number]
        session = self._view.session
        cursor = session.execute(sql, [*terms, *columns, *values])
        while session.pgconn.flush():  # a pipeline sends as much as the socket takes at once
            select([], [session], [])
        return cursor, [fact for fact, _ in some] if self._is_bound else [], len(some)

    def _counted(self, stated: list[Stated]) -> int:
        """Return how many statements commands changed; keep in mind which they are about."""
        for cursor, facts, _ in stated:
            if cursor.rowcount:
                self._touch(facts)
        if sum(number for _, _, number in stated) >= _MANY:  # else it is soon enough
            self._view.session.execute("ANALYZE triple, term")  # skipped without the right
        return sum(cursor.rowcount for cursor, _, _ in stated)

    @cached_property
    def _is_bound(self) -> bool:
        return bool(binding_shapes(self._view))

    def _property_of(self, fact: Fact) -> str:
        if isinstance(fact.subject, rdflib.Literal) or not isinstance(fact.property, rdflib.URIRef):
            raise RefusedError("the subject is a literal, or the property is not an IRI", fact)
        return self._constants.property(str(fact.property))

    def _touch(self, facts: Iterable[Fact]) -> None:
        self._view.touched.update(end for fact in facts for end in (fact.subject, fact.object))

    def _insert_in_table(self, fact: Fact, iri: str) -> int | None:
        """Add a fact to the table that has columns for it; None: it is a statement."""
        if iri == f"{RDF}type" and self._type(fact) is not None:
            self._refuse_end(fact)
            return self._set_type(fact)
        if iri == f"{RDF}type":
            for sentence in unknown_names(self._view, self._constants, [fact.object]):
                raise RefusedError(sentence, fact)
        table = self._table(fact, iri)
        if table is not None:
            self._refuse_end(fact)
            values = table.values(self, fact, iri)
            return sum(self._execute(sql, values) for sql in table.insert)
        self._refuse_mapped(fact, iri)
        return None

    def _delete_in_table(self, fact: Fact, iri: str) -> int | None:
        """Remove a fact from the table that has columns for it; None: it is a statement."""
        if fact.graph is not None or self._is_foreign(fact.subject):
            return None
        if self._lacks_object(fact, iri):
            return None
        if iri == f"{RDF}type" and self._type(fact) is not None:
            return self._execute(
                "UPDATE entity SET type = NULL WHERE id = %(id)s AND type = %(type)s",
                {"id": self._entity(fact.subject), "type": self._type(fact)},
            )
        table = self._table(fact, iri)
        if table is not None:
            sql = table.delete
            return 0 if sql is None else self._execute(sql, table.values(self, fact, iri))
        self._refuse_mapped(fact, iri)
        return None

    def _table(self, fact: Fact, iri: str) -> _Table | None:
        """Return where a property is kept; None for statements, and labels of what is no entity."""
        for writes, table in _TABLES.items():
            if iri == writes or (writes.endswith("#") and iri.startswith(writes)):
                other = iri == f"{RDFS}label" and self._entity(fact.subject) is None
                return None if other else table
        return None

    def _refuse_end(self, fact: Fact) -> None:
        if self._until is not None:
            raise RefusedError(
                "the map keeps this fact in a table, where it cannot end by itself: state it "
                "without a lifespan, or in a model",
                fact,
            )

    def _refuse_mapped(self, fact: Fact, iri: str) -> None:
        if is_mapped(iri) or is_of_fields(iri):
            raise RefusedError(
                "this follows from other data of the map, and is not stated: change what it "
                "follows from, or state it in a named graph",
                fact,
            )

    def _refuse_invisible(self, fact: Fact, iri: str) -> None:
        """Raise an error where no query would see a fact about a foreign resource."""
        if fact.graph is not None:
            if str(fact.graph) == INFERRED_GRAPH:
                raise RefusedError("this graph has what follows from other facts only", fact)
        elif _is_computed(iri):
            raise RefusedError(
                "this is computed for entities of the map when a query names it, and a statement "
                "would not be seen: state it in a named graph",
                fact,
            )
        elif iri == f"{RDF}type" and fact.object not in self._known_types:
            for sentence in unknown_names(self._view, self._constants, [fact.object]):
                raise RefusedError(sentence, fact)
            self._known_types.add(fact.object)

    def _is_foreign(self, term: Any) -> bool:
        """Return whether a subject is not a node of a map, nor a name of the map's vocabulary."""
        if isinstance(term, rdflib.BNode) or term.startswith(SKOLEM):
            return True
        if self._constants.node(str(term))[0] != "iri":
            return False
        unknown = self._unknown and term.startswith(self._view.namespace)
        return unknown or not term.startswith("urn:semmap:")

    def _lacks_object(self, fact: Fact, iri: str) -> bool:
        """Return whether a statement is what a link or a placement would be without an entity."""
        table = self._table(fact, iri) if self._unknown else None
        return table in (_PLACED, _TABLES[RELATION]) and self._entity(fact.object) is None

    def _execute(self, sql: str, values: dict[str, Any]) -> int:
        session = self._view.session
        changed = max(0, session.execute(sql, values).rowcount)
        rows = None if changed else _ROWS.match(sql)
        if rows and session.execute(f"SELECT 1 FROM {rows[1]} {rows[2]}", values).fetchone():
            raise denied()
        return changed

    def _entity(self, term: Any) -> int | None:
        if not isinstance(term, rdflib.URIRef):
            return None
        form, key = self._constants.node(str(term))
        return int(key) if form == "entity" else None

    def _type(self, fact: Fact) -> str | None:
        if not isinstance(fact.object, rdflib.URIRef):
            return None
        form, key = self._constants.node(str(fact.object), as_type=True)
        return str(key) if form == "type" else None

    def _iri(self, term: Any) -> str:
        if isinstance(term, rdflib.BNode):
            from uuid import uuid4

            return self._blank.setdefault(str(term), f"{SKOLEM}{uuid4()}")
        form, key = self._constants.node(str(term))
        return self._type_iri(str(key)) if form == "type" else str(term)

    def _quad(self, fact: Fact, iri: str) -> tuple[int, int, int, int]:
        """Return graph, subject, property and object, as `_GIVEN` has them."""
        type_ = self._type(fact) if iri == f"{RDF}type" else None
        return (
            0 if fact.graph is None else self._place(str(fact.graph)),
            self._end(fact.subject),
            self._place(iri),
            self._end(fact.object) if type_ is None else self._place(self._type_iri(type_)),
        )

    def _end(self, term: Any) -> int:
        """Return the number of an entity, or the place of a term."""
        found = self._ends.get(term)
        if found is None:
            found = self._entity(term)
            if found is None and isinstance(term, rdflib.Literal):
                found = self._place(*tag_and_text(term))
            elif found is None:
                found = self._place(self._iri(term))
            self._ends[term] = found
        return found

    def _place(self, text: str, tag: str = "I") -> int:
        return self._terms.setdefault((text, tag), -len(self._terms) - 1)

    def _known(self, term: Any, fact: Fact) -> int:
        entity = self._entity(term)
        if entity is None:
            raise RefusedError(
                f"{term.n3()} is not an entity of the map {self._view.name}: give it a type first, "
                f"such as <{self._view.namespace}NAME> a semmap:Cup",
                fact,
            )
        return entity

    def _set_type(self, fact: Fact) -> int:
        type_, entity = self._type(fact), self._entity(fact.subject)
        if entity is not None:
            row = self._view.session.execute(
                "SELECT EXISTS (SELECT FROM object_type WHERE id = e.id AND type = %(type)s), "
                "fits_kind(%(type)s, e.kind), e.kind FROM entity e WHERE e.id = %(id)s",
                {"id": entity, "type": type_},
            ).fetchone()
            assert row is not None
            if row[0]:
                return 0  # it has the type, or one that it subsumes
            if not row[1]:
                raise RefusedError(
                    f"{type_} is not a type for an entity of the kind {row[2]}", fact
                )
            return self._execute(
                "UPDATE entity SET type = %(type)s WHERE id = %(id)s",
                {"id": entity, "type": type_},
            )
        iri, space = str(fact.subject), self._view.namespace
        name = decode(iri[len(space) :]) if iri.startswith(space) else None
        if not name:
            raise RefusedError(
                f"an entity of the map {self._view.name} has an IRI in <{space}>", fact
            )
        row = self._view.session.execute(
            "INSERT INTO entity (map_id, kind, name, type) SELECT %(map)s, c.super, %(name)s, "
            "%(type)s FROM type_closure c WHERE c.sub = %(type)s AND c.super IN ('room', 'object', "
            "'region', 'agent', 'storey') ORDER BY c.super LIMIT 1 RETURNING id",
            {"map": self._view.number, "name": name, "type": type_},
        ).fetchone()
        if row is None:
            raise RefusedError(
                f"{type_} is not a type of rooms, objects, regions, agents or storeys", fact
            )
        self._constants = self._constants.with_entity(iri, int(row[0]))
        return 1

    def _label(self, fact: Fact, iri: str) -> dict[str, Any]:
        return {"id": self._entity(fact.subject), "text": str(fact.object)}

    def _property(self, fact: Fact, iri: str) -> dict[str, Any]:
        key = decode(iri[len(PROPERTY) :])
        if not key:
            raise RefusedError("this is not the name of a property: percent-encode it", fact)
        return {
            "id": self._known(fact.subject, fact),
            "key": key,
            "value": json.dumps(self._json(fact)),
        }

    def _json(self, fact: Fact) -> Any:
        term = fact.object
        if not isinstance(term, rdflib.Literal) or term.language:
            raise RefusedError("a property is a string, number, boolean or JSON", fact)
        text, tag = tag_and_text(term)
        try:
            if tag == f"{XSD}string":
                return text
            if tag == f"{XSD}boolean":
                return {"true": True, "1": True, "false": False, "0": False}[text]
            if tag == f"{XSD}integer":
                return int(text)
            if tag in (f"{XSD}decimal", f"{XSD}double"):
                return json.loads(json.dumps(float(text), allow_nan=False))
            if tag == f"{RDF}JSON":
                return json.loads(text)
        except (ValueError, KeyError) as error:
            raise RefusedError(f"{text!r} is not valid for its datatype", fact) from error
        raise RefusedError("a property is a string, number, boolean or JSON", fact)

    def _link(self, fact: Fact, iri: str) -> dict[str, Any]:
        relation = decode(iri[len(RELATION) :])
        if not relation:
            raise RefusedError("this is not the name of a relation: percent-encode it", fact)
        a, b = self._known(fact.subject, fact), self._known(fact.object, fact)
        return {"a": a, "relation": relation, "b": b}

    def _placed(self, fact: Fact, iri: str) -> dict[str, Any]:
        return {
            "thing": self._known(fact.subject, fact),
            "holder": self._known(fact.object, fact),
            "how": "on" if iri.endswith("On") else "in",
            "either": iri.endswith("heldBy"),
        }

    def _state(self, fact: Fact, iri: str) -> dict[str, Any]:
        return {"id": self._known(fact.subject, fact), "state": str(fact.object)}


class _Table(NamedTuple):
    """Where facts are kept: their values, what adds them, and what removes one, if anything can."""

    values: Callable[[FactWriter, Fact, str], dict[str, Any]]
    insert: tuple[str, ...]
    delete: str | None


_PLACED = _Table(
    FactWriter._placed,
    (
        "INSERT INTO placement (entity_id, holder_id, relation) SELECT %(thing)s, %(holder)s, "
        "%(how)s WHERE NOT EXISTS (SELECT FROM placement WHERE entity_id = %(thing)s)",
        # Where it is, on or in another.
        "SELECT put(%(thing)s, %(holder)s, %(how)s) WHERE NOT EXISTS (SELECT FROM placement "
        "WHERE entity_id = %(thing)s AND holder_id = %(holder)s "
        "AND (%(either)s OR relation = %(how)s))",
    ),
    "SELECT put(entity_id, NULL) FROM placement "
    "WHERE entity_id = %(thing)s AND holder_id = %(holder)s",
)

_TABLES: dict[str, _Table] = {
    f"{RDFS}label": _Table(
        FactWriter._label,
        (
            "UPDATE entity SET label = %(text)s WHERE id = %(id)s "
            "AND label IS DISTINCT FROM %(text)s",
        ),
        "UPDATE entity SET label = NULL WHERE id = %(id)s AND label = %(text)s",
    ),
    PROPERTY: _Table(
        FactWriter._property,
        (
            "UPDATE entity SET properties = jsonb_set(properties, ARRAY[%(key)s], %(value)s::jsonb)"
            " WHERE id = %(id)s AND properties -> %(key)s IS DISTINCT FROM %(value)s::jsonb",
        ),
        "UPDATE entity SET properties = properties - %(key)s "
        "WHERE id = %(id)s AND properties -> %(key)s = %(value)s::jsonb",
    ),
    RELATION: _Table(
        FactWriter._link,
        (
            "INSERT INTO link (from_id, relation, to_id) VALUES (%(a)s, %(relation)s, %(b)s) "
            "ON CONFLICT DO NOTHING",
        ),
        "DELETE FROM link WHERE (from_id, relation, to_id) = (%(a)s, %(relation)s, %(b)s)",
    ),
    **dict.fromkeys(
        (
            f"{SEMMAP}heldBy",
            f"{SEMMAP}placedOn",
            f"{SEMMAP}placedIn",
            "http://kb.openrobots.org#isOn",
            "http://kb.openrobots.org#isIn",
        ),
        _PLACED,
    ),
    f"{SEMMAP}state": _Table(
        FactWriter._state,
        (
            "UPDATE connector SET state = %(state)s WHERE entity_id = %(id)s "
            "AND state IS DISTINCT FROM %(state)s",
        ),
        None,  # a connector always has a state: an insertion replaces it
    ),
}
"""By the property; "#" at the end: all of a namespace."""


@contextmanager
def with_consequences(view: MapView) -> Iterator[None]:
    """Run a change of facts; infer what follows. BrokenShapeError: shapes forbid it, undo it."""
    since = view.value("SELECT coalesce(max(id), 0) FROM change")
    yield
    view.chosen = None
    if refresh(view) is not None:
        view.inferred = MapView.of(view.session).inferred
    check_binding(view, since)
