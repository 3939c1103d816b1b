"""The map for programs that speak to KnowledgeCore: revise, find, subscribe (doc/api.md there)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import rdflib

from semmap.database.maps import driver_of, see_map
from semmap.knowledge.answer import Answer
from semmap.knowledge.facts import DENIED, Fact, FactWriter, refusal_text, with_consequences
from semmap.knowledge.map_view import MapView
from semmap.knowledge.patterns import ClientPattern, name_of, parse_pattern, query_text, variables
from semmap.knowledge.queries import KnowledgeError, limited_view, query
from semmap.knowledge.sparql.scope import Chosen
from semmap.knowledge.standing.subscriptions import Event, Subscriptions
from semmap.knowledge.updates import GraphChanges
from semmap.knowledge.vocabulary import OWL, RDF, RDFS, SEMMAP, encode, map_namespace
from semmap.query.map_handle import MapSource

Statements = str | Sequence[str]

METHODS = ("add", "retract", "update")


class KnowledgeClient:
    """Statements on a map, in KnowledgeCore's notation; any thread may call its methods.

    A model is a named graph: the robot's view of an agent's knowledge. Without one, statements are
    about the map itself.

    Examples
    --------
    >>> with semmap.connect() as database:  # doctest: +SKIP
    ...     kb = KnowledgeClient(database.map("house"))
    ...     kb += ["human1 looksAt book", "book rdf:type Book"]
    ...     kb.find(["who"], ["?who looksAt ?what", "?what rdf:type Book"])
    {'human1'}
    """

    def __init__(self, source: MapSource) -> None:
        self._engine = source.engine
        with source.engine.connect() as connection:
            self.map_name: str = see_map(connection, source.name)
            MapView.of(driver_of(connection))
        self._subscriptions = Subscriptions(source.engine, self.map_name)

    def __enter__(self) -> KnowledgeClient:
        """Return this; the end of the ``with`` block closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all subscriptions."""
        self._subscriptions.close()

    def revise(
        self,
        statements: Statements,
        method: str = "add",
        *,
        lifespan: float = 0,
        model: str | None = None,
    ) -> GraphChanges:
        """Change statements, all of them or none; or ValueError.

        Parameters
        ----------
        statements : those to retract may have variables and ``*``, and stand for all that match
        method : "add", "retract", or "update", which replaces the objects of functional properties
            (``PROPERTY rdf:type owl:FunctionalProperty``) and adds all others
        lifespan : seconds after which new statements end; 0 for never. A statement that is there
            without an end keeps none, and an earlier end is put off
        """
        return self.revise_models([model], statements, method, lifespan=lifespan)

    def revise_models(
        self,
        models: Sequence[str | None],
        statements: Statements,
        method: str = "add",
        *,
        lifespan: float = 0,
        unknown: bool = False,
    ) -> GraphChanges:
        """Change the statements of several models as `revise` does: of all of them, or of none.

        With `unknown`, no statement about what the map does not have is refused or makes an entity.
        """
        if method not in METHODS:
            raise KnowledgeError(f"method {method!r} is not one of {', '.join(METHODS)}")
        if not 0 <= lifespan < 1e10:
            raise KnowledgeError(f"lifespan {lifespan!r} is not a number of seconds from 0 on")
        patterns, graphs = self.parsed(statements), [self.graph_of(model) for model in models]
        if method != "retract":
            _refuse_variables(patterns)
        with self.view() as view:
            # Rows that another transaction changes are left to it.
            view.session.execute(
                "DELETE FROM triple WHERE id IN (SELECT id FROM triple WHERE map_id = %s "
                "AND until <= statement_timestamp() FOR UPDATE SKIP LOCKED)",
                (view.number,),
            )
            with _refusals(), with_consequences(view):
                writer = FactWriter(view, lifespan, unknown=unknown)
                if method == "retract":
                    gone = [f for g in graphs for p in patterns for f in _matching(view, p, g)]
                    return GraphChanges(0, writer.delete(gone))
                facts = [Fact(*pattern, graph) for graph in graphs for pattern in patterns]
                removed = 0
                if method == "update":
                    gone = [fact for new in facts for fact in _replaced(view, new)]
                    removed = writer.delete(f for f in gone if f not in facts)
                added = writer.insert(facts)
                return GraphChanges(added, removed)

    def add(
        self, statements: Statements, *, lifespan: float = 0, model: str | None = None
    ) -> GraphChanges:
        """Add statements."""
        return self.revise(statements, "add", lifespan=lifespan, model=model)

    def retract(self, statements: Statements, *, model: str | None = None) -> GraphChanges:
        """Remove statements, and all that match those with variables or ``*``."""
        return self.revise(statements, "retract", model=model)

    def update(
        self, statements: Statements, *, lifespan: float = 0, model: str | None = None
    ) -> GraphChanges:
        """Add statements; those with a functional property replace former ones."""
        return self.revise(statements, "update", lifespan=lifespan, model=model)

    def __iadd__(self, statements: Statements) -> KnowledgeClient:
        """As `update`."""
        self.update(statements)
        return self

    def __isub__(self, statements: Statements) -> KnowledgeClient:
        """As `retract`."""
        self.retract(statements)
        return self

    def find(
        self, names: Statements, patterns: Statements, *, model: str | None = None
    ) -> set[Any] | list[dict[str, Any]]:
        """Return the values of the variables of some names where all patterns match.

        Of one variable it is the set of values; of several, a dictionary for each solution. Raises
        ValueError where a pattern is malformed, or none has a variable.
        """
        wanted = [name.removeprefix("?") for name in ([names] if isinstance(names, str) else names)]
        parsed = self.parsed(patterns)
        known = variables(parsed)
        for name in wanted:
            if name not in known:
                raise KnowledgeError(
                    f"no pattern has the variable ?{name}; variables: {', '.join(known) or 'none'}"
                )
        if not wanted:
            raise KnowledgeError("no variable is named: name one, or use has() for a yes or no")
        found = self.rows(patterns, wanted, model=model)
        if len(wanted) == 1:
            return {value for (value,) in found}
        return [dict(zip(wanted, row, strict=True)) for row in found]

    def rows(
        self,
        patterns: Statements,
        names: Sequence[str],
        *,
        model: str | None = None,
        tbox: bool = True,
    ) -> list[tuple[Any, ...]]:
        """Return the values of variables in each solution of patterns, as in statements."""
        wanted = [name.removeprefix("?") for name in names]
        text = query_text(self.parsed(patterns), wanted, self.graph_of(model))
        rows = self.sparql(text, tbox=tbox).rows
        return [tuple(name_of(term, self.map_name) for term in row) for row in rows]

    def __getitem__(self, patterns: Statements) -> set[Any] | list[dict[str, Any]]:
        """As `find`, of all variables of the patterns; ``*`` stands for one without a name."""
        parsed = self.parsed(patterns)
        names = variables(parsed)
        if names:
            return self.find(names, patterns)
        starred = [term for term in parsed[0] if isinstance(term, rdflib.Variable)]
        if len(parsed) != 1 or len(starred) != 1:
            raise KnowledgeError(f"{patterns!r}: name the variables that you want, such as ?x")
        rows = self.sparql(query_text(parsed, [str(starred[0])], None)).rows
        return {name_of(term, self.map_name) for (term,) in rows}

    def has(self, patterns: Statements, *, model: str | None = None, tbox: bool = True) -> bool:
        """Return whether all patterns match together."""
        text = query_text(self.parsed(patterns), [], self.graph_of(model))
        return bool(self.sparql(text, tbox=tbox).truth)

    def __contains__(self, patterns: Statements) -> bool:
        """As `has`."""
        return self.has(patterns)

    def about(self, resource: str, *, model: str | None = None) -> list[tuple[Any, Any, Any]]:
        """Return the statements that have a resource as subject or object, sorted."""
        graph = self.graph_of(model)
        with self.view() as view:
            term = self.resource(view, resource)
            found = {*view.triples((term, None, None), graph)}
            found |= {*view.triples((None, None, term), graph)}
        named = (tuple(name_of(term, self.map_name) for term in triple) for triple in found)
        return sorted(named, key=str)

    def details(self, resource: str) -> dict[str, Any]:
        """Return name, id, type ("class", "instance" or "undecided") and classes of a resource."""
        with self.view() as view:
            term = self.resource(view, resource)
            described = {*view.triples((term, None, None))}
            used = any(True for _ in view.triples((None, rdflib.RDF.type, term)))
        values: dict[str, list[Any]] = {}
        for _, verb, value in described:
            values.setdefault(str(verb), []).append(name_of(value, self.map_name))
        classes = values.get(f"{SEMMAP}directType") or values.get(f"{RDF}type", [])
        parents = values.get(f"{RDFS}subClassOf", [])
        is_class = used or bool(parents) or "owl:Class" in classes
        attributes = (
            {"name": "Parents", "id": "superClasses", "values": sorted(parents, key=str)}
            if is_class
            else {"name": "Classes", "id": "classes", "values": sorted(classes, key=str)}
        )
        return {
            "name": next(iter(values.get(f"{RDFS}label", [])), name_of(term, self.map_name)),
            "id": name_of(term, self.map_name),
            "type": "class" if is_class else "instance" if classes else "undecided",
            "attributes": [attributes],
        }

    def sparql(self, text: str, *, model: str | None = None, tbox: bool = True) -> Answer:
        """Answer a query of SPARQL on the map, or on one model in place of it.

        Without `tbox`, triples of variables alone do not match the T-Box.
        """
        graph = self.graph_of(model)
        chosen = None if graph is None else Chosen((str(graph),))
        with self.view() as view:
            return query(view.session, text, dataset=chosen, tbox=tbox)

    def subscribe(
        self,
        patterns: Statements,
        callback: Callable[[Event], Any] | None = None,
        *,
        one_shot: bool = False,
        model: str | None = None,
    ) -> int:
        """Return the number of a subscription to the matches of patterns, all of them together.

        A match that is there already is not an event. Bindings of events are written as in
        statements.

        Parameters
        ----------
        callback : gets the events, in a thread of the client; else `events` yields them
        one_shot : end with the first match that appears; it alone is reported
        """
        parsed = self.parsed(patterns)
        text = query_text(parsed, variables(parsed), self.graph_of(model))
        named = None if callback is None else lambda event: callback(self._named(event))
        return self._subscriptions.add(text, one_shot=one_shot, callback=named)[0]

    def catch_up(self) -> None:
        """Find the events of the last change now, so that the next one cannot undo them unseen."""
        self._subscriptions.catch_up()

    def unsubscribe(self, number: int) -> None:
        """End a subscription."""
        self._subscriptions.remove(number)

    def events(self, timeout: float | None = None) -> Iterator[Event]:
        """Yield the events of subscriptions without a callback, until none comes in `timeout` s."""
        yield from map(self._named, self._subscriptions.events(timeout))

    def _named(self, event: Event) -> Event:
        terms = event.bindings.items()
        return replace(event, bindings={n: name_of(term, self.map_name) for n, term in terms})

    @contextmanager
    def view(self) -> Iterator[MapView]:
        """A transaction that sees the map."""
        with self._engine.begin() as connection:
            see_map(connection, self.map_name)
            with limited_view(driver_of(connection), None) as view:
                yield view

    def parsed(self, statements: Statements) -> list[ClientPattern]:
        """Return the terms of statements, of which there is at least one."""
        texts = [statements] if isinstance(statements, str) else list(statements)
        if not texts:
            raise KnowledgeError("there is no statement")
        return [parse_pattern(text, self.map_name) for text in texts]

    def graph_of(self, model: str | None) -> rdflib.URIRef | None:
        """Return the named graph of a model; None for the map itself."""
        if model is None:
            return None
        if not model:
            raise KnowledgeError("a model has a name: leave it out for the map itself")
        return rdflib.URIRef(f"{map_namespace(self.map_name)}{encode(model)}")

    def models(self) -> list[str]:
        """Return the models that have statements."""
        with self.view() as view:
            rows = view.session.execute(
                "SELECT text FROM term WHERE id IN (SELECT graph FROM triple WHERE map_id = %s "
                "AND graph <> 0 AND (until IS NULL OR until > statement_timestamp())) "
                "ORDER BY text",
                (view.number,),
            ).fetchall()
        return [str(name_of(rdflib.URIRef(graph), self.map_name)) for (graph,) in rows]

    def resource(self, view: MapView, name: str) -> Any:
        """Return the term of a name: an entity's, else a type's, else that of an individual."""
        subject = parse_pattern(f"{name} rdf:type *", self.map_name).subject
        type_ = parse_pattern(f"* rdf:type {name}", self.map_name).object
        constants = view.constants([subject, type_])
        if subject != type_ and constants.node(str(subject))[0] == "iri":
            stated = any(True for _ in view.triples((None, None, type_)))
            if constants.node(str(type_))[0] == "type" or stated:
                return type_
        return subject


def _refuse_variables(patterns: Sequence[ClientPattern]) -> None:
    for pattern in patterns:
        for term in pattern:
            if not isinstance(term, (rdflib.URIRef, rdflib.Literal)):
                raise KnowledgeError(
                    f"{' '.join(t.n3() for t in pattern)}: only what is retracted has "
                    "variables, *, or paths: name all three terms"
                )


def _matching(view: MapView, pattern: ClientPattern, graph: rdflib.URIRef | None) -> Iterator[Fact]:
    names = [str(t) for t in pattern if isinstance(t, (rdflib.Variable, rdflib.BNode))]
    if not isinstance(pattern.verb, (rdflib.URIRef, rdflib.Variable, rdflib.BNode)):
        raise KnowledgeError(f"{pattern.verb.n3()}: a path is not stated: name a property")
    if not names:
        yield Fact(*pattern, graph)
        return
    free = tuple(
        None if isinstance(term, (rdflib.Variable, rdflib.BNode)) else term for term in pattern
    )
    for triple in view.triples(free, graph):  # type: ignore[arg-type]
        values: dict[str, Any] = {}
        pairs = zip(pattern, triple, strict=True)
        if all(
            term == value or values.setdefault(str(term), value) == value for term, value in pairs
        ):
            yield Fact(*triple, graph)


def _replaced(view: MapView, fact: Fact) -> Iterator[Fact]:
    """Yield the facts that a new one replaces: those of a functional property."""
    functional = (fact.property, rdflib.RDF.type, rdflib.URIRef(f"{OWL}FunctionalProperty"))
    graphs = {None, fact.graph}
    if any(True for graph in graphs for _ in view.triples(functional, graph)):
        for triple in view.triples((fact.subject, fact.property, None), fact.graph):
            yield Fact(*triple, fact.graph)


@contextmanager
def _refusals() -> Iterator[None]:
    try:
        yield
    except DENIED as error:
        raise KnowledgeError(refusal_text(error)) from error
