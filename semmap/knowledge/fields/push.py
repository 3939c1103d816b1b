"""Relations of fields as facts, and what each agent knows of what it sees.

Relations that the user names are pushed as statements, so that standing queries see them; others
are pulled. Source: "VDB-based Spatially Grounded Semantics for Interactive Robots", section VI.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import rdflib
from sqlalchemy import Engine

from semmap.database.maps import driver_of, see_map
from semmap.knowledge.facts import Fact, FactWriter
from semmap.knowledge.fields.properties import is_of_fields
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import is_mapped
from semmap.knowledge.patterns import parse_pattern
from semmap.knowledge.sparql.constants import Constants
from semmap.knowledge.vocabulary import KNOWLEDGE_CORE, RDF, RDFS, SEMMAP, TYPE, encode
from semmap.query.change_feed import ChangeFeed

LIFESPAN = 30.0
"""Seconds after which pushed facts end where the program that pushes them was killed."""

SEES = "sees"

LEARNT = (
    f"{RDF}type",
    f"{RDFS}label",
    f"{SEMMAP}heldBy",
    f"{KNOWLEDGE_CORE[0]}isOn",
    f"{KNOWLEDGE_CORE[0]}isIn",
)
"""The properties that an agent learns of what it sees."""

Relation = tuple[str, str, str]
"""Relation, subject and object, as the service of fields names them."""


def read_pushed(lines: Iterable[str], map_name: str) -> dict[str, rdflib.URIRef]:
    """Return the property of each relation, from RELATION=PROPERTY; or ValueError."""
    found = {}
    for line in lines:
        relation, _, written = line.partition("=")
        if not relation or not written:
            raise ValueError(f"{line!r}: write RELATION=PROPERTY, such as sees=looksAt")
        try:
            verb = parse_pattern(f"someone {written} something", map_name).verb
        except ValueError as error:
            raise ValueError(f"{line!r}: {written!r} is not a property") from error
        if not isinstance(verb, rdflib.URIRef):
            raise ValueError(f"{line!r}: {written} is not a property")
        own = Constants({}).property(str(verb))
        if is_mapped(own) or is_of_fields(own):
            raise ValueError(
                f"{line!r}: {written} is computed when a query names it: push it by another "
                "property, such as looksAt"
            )
        found[relation] = verb
    return found


class FieldPush:
    """Writes relations that begin and end; with perspectives, what an agent sees into its model."""

    def __init__(
        self,
        engine: Engine,
        map_name: str,
        pushed: Mapping[str, rdflib.URIRef],
        *,
        perspectives: bool = False,
    ) -> None:
        self._engine, self._map_name = engine, map_name
        self._pushed, self._perspectives = pushed, perspectives
        self._followed = {*pushed, *([SEES] if perspectives else [])}
        self._true: set[Relation] = set()
        self._feed = ChangeFeed(engine, map_name, durable=False)
        self._renewal = 0.0

    def follow(self, messages: Iterable[Mapping[str, Any]], stop: threading.Event) -> None:
        """Write what the messages of the service report, until they or the program end."""
        waiting: queue.SimpleQueue[Mapping[str, Any] | None] = queue.SimpleQueue()

        def read() -> None:
            for message in messages:
                waiting.put(message)
            waiting.put(None)

        threading.Thread(target=read, daemon=True).start()
        held: list[Relation] = []
        try:
            while not stop.is_set():
                try:
                    message = waiting.get(timeout=0.2)
                except queue.Empty:
                    self.catch_up()
                    continue
                if message is None or "over" in message:
                    return
                if message.get("held") is False:
                    self.begin(held)
                else:
                    relation = (message["relation"], message["subject"], message["object"])
                    if "held" in message:
                        held.append(relation)
                    elif message["event"] == "begin":
                        self.begin([relation])
                    else:
                        self.end([relation])
        finally:
            self.end([each for each in self._true if each[0] in self._pushed])

    def begin(self, relations: Iterable[Relation]) -> None:
        """Write relations that are true from now on."""
        new = [e for e in relations if e[0] in self._followed and e not in self._true]
        self._true.update(new)
        with self._view() as view:
            self._write(view, new)
            for relation, agent, thing in new:
                if relation == SEES and self._perspectives:
                    self._learn(view, agent, thing)

    def end(self, relations: Iterable[Relation]) -> None:
        """Remove relations that are true no more; what an agent has learnt stays."""
        gone = [each for each in relations if each in self._true]
        self._true.difference_update(gone)
        with self._view() as view:
            facts = [self._fact(view, each) for each in gone if each[0] in self._pushed]
            FactWriter(view).delete(facts)

    def catch_up(self) -> None:
        """Let agents learn what changed of what they see, and renew the facts before they end."""
        seen = [each for each in self._true if each[0] == SEES and self._perspectives]
        if seen:
            with self._feed.look() as look:
                changed = look.changed
            self._feed.take_in(look)
            if changed is None or changed:
                with self._view() as view:
                    for _, agent, thing in seen:
                        self._learn(view, agent, thing)
        if time.monotonic() > self._renewal:
            with self._view() as view:
                self._write(view, self._true)
            self._renewal = time.monotonic() + LIFESPAN / 3

    def _write(self, view: MapView, relations: Iterable[Relation]) -> None:
        facts = [self._fact(view, each) for each in relations if each[0] in self._pushed]
        if facts:
            FactWriter(view, LIFESPAN).insert(facts)

    def _fact(self, view: MapView, relation: Relation) -> Fact:
        name, subject, object_ = relation
        return Fact(_entity(view, subject), self._pushed[name], _entity(view, object_))

    def _learn(self, view: MapView, agent: str, thing: str) -> None:
        """Put what is true of an entity into the model of an agent, in place of what was."""
        node, model = _entity(view, thing), _entity(view, agent)
        now: set[Fact] = set()
        known: set[Fact] = set()
        for iri in LEARNT:
            verb = rdflib.URIRef(iri)
            for found, graph in ((now, None), (known, model)):
                for _, _, value in view.triples((node, verb, None), graph):
                    if iri != f"{RDF}type" or str(value).startswith((SEMMAP, TYPE)):
                        found.add(Fact(node, verb, value, model))
        writer = FactWriter(view)
        writer.delete(known - now)
        writer.insert(now - known)

    @contextmanager
    def _view(self) -> Iterator[MapView]:
        with self._engine.begin() as connection:
            see_map(connection, self._map_name)
            yield MapView.of(driver_of(connection))


def _entity(view: MapView, name: str) -> rdflib.URIRef:
    return rdflib.URIRef(f"{view.namespace}{encode(name)}")
