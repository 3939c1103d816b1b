"""Standing queries have the answers, and the events, that whole evaluations show: a workshop."""

from __future__ import annotations

import time
from collections.abc import Iterator

import psycopg
import pytest
import rdflib
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine

import semmap
from semmap import Database, Map
from semmap.knowledge.facts import Fact, FactWriter
from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import query
from semmap.knowledge.reasoning.runs import forget, reason
from semmap.knowledge.standing.subscriptions import Subscriptions
from semmap.knowledge.updates import update
from semmap.language.error import QueryError

LOCAL = (
    # One pattern: ground, one variable, two
    "ASK { :mia ex:looksAt :saw }",
    "ASK { :saw semmap:heldBy :bench }",
    "SELECT ?x { ?x ex:looksAt :saw }",
    "SELECT ?x ?y { ?x ex:looksAt ?y }",
    "SELECT ?x { ?x ex:looksAt ?x }",
    "SELECT ?x { ?x semmap:heldBy :bench }",
    "SELECT ?x ?y { ?x semmap:heldBy ?y }",
    "SELECT ?y { :saw semmap:heldBy ?y }",
    "SELECT ?x { :bench semmap:holds ?x }",
    "SELECT ?x { ?x semmap:placedOn ?y }",
    "SELECT ?x { ?x a semmap:Furniture }",
    "SELECT ?t { :saw a ?t }",
    "SELECT ?x { ?x a type:sawhorse }",
    'SELECT ?x { ?x prop:colour "red" }',
    "SELECT ?x ?c { ?x prop:colour ?c }",
    "SELECT ?l { :saw rdfs:label ?l }",
    'ASK { :glue rdfs:label "tool" }',
    "SELECT ?x ?y { ?x rel:beside ?y }",
    "SELECT ?z { :saw semmap:z ?z }",
    "SELECT ?s { :gate semmap:state ?s }",
    "SELECT ?x { ?x ex:age 5 }",
    "SELECT ?n { :new semmap:name ?n }",
    "SELECT ?x { ?x semmap:heldBy :new }",
    "SELECT ?x { ?x semmap:heldBy oro:bench }",
    "SELECT ?x { ?x ex:looksAt oro:new }",
    # Joins, conditions, classes
    "SELECT ?x { ?x ex:looksAt ?y . ?y a semmap:Table }",
    "SELECT ?x { ?x ex:looksAt ?y . ?y semmap:heldBy :bench }",
    "SELECT ?x ?y { ?x ex:looksAt ?y . ?y ex:looksAt ?x }",
    "SELECT ?x ?r { ?x semmap:heldBy/semmap:heldBy ?r . ?x a semmap:Object }",
    "SELECT ?x { ?x semmap:heldBy ?y . ?x prop:colour ?c FILTER(?c != 'red') }",
    "SELECT ?x ?c { ?x ex:looksAt ?y BIND(STR(?y) AS ?c) }",
    "SELECT ?x { VALUES ?y { :bench :cart } ?x semmap:heldBy ?y ; a semmap:Object }",
    "SELECT ?x { { ?x semmap:heldBy :bench } UNION { ?x ex:looksAt :bench } }",
    "SELECT ?x { ?x ex:looksAt|rel:beside :saw }",
    "SELECT ?x ?h { ?x (ex:looksAt|^rel:beside)/semmap:heldBy ?h FILTER(?h != :cart) }",
    "ASK { { ?x ex:looksAt ?y FILTER(?x = :mia) } ?y semmap:heldBy|semmap:on :bench }",
    "SELECT ?x { ?x ex:age ?n FILTER(?n > 3) }",
    # Of one shape with others
    "ASK { :glue ex:looksAt :bench }",
    "SELECT ?x { ?x semmap:heldBy :cart }",
    "SELECT ?x { ?x semmap:heldBy :hall }",
    "SELECT ?x { ?x semmap:on :cart }",
    "SELECT ?x ?y { ?x ex:looksAt ?y FILTER(?y != :saw) }",
    "SELECT ?x ?y { ?x ex:looksAt ?y FILTER(?y != :glue) }",
    "SELECT ?x { ?x ex:looksAt :saw ; semmap:heldBy :bench }",
    "SELECT ?x { ?x ex:looksAt :bench ; semmap:heldBy :bench }",
    "SELECT ?x ?y { ?x ex:looksAt ?y . ?y semmap:heldBy :cart ; a type:sawhorse }",
    "SELECT ?x ?y { ?x ex:looksAt ?y . ?y semmap:heldBy :bench ; a type:bottle }",
    "SELECT ?x { ?x ex:looksAt semmap:Table }",
    "SELECT ?x { ?x ex:looksAt type:table }",
    "SELECT ?x { ?x ex:looksAt type:sawhorse }",
    # Models
    "SELECT ?x { GRAPH :mia { ?x ex:looksAt ?y } }",
    "SELECT ?g ?y { GRAPH ?g { :mia ex:looksAt ?y } }",
    "SELECT ?p ?o { GRAPH :mia { :mia ?p ?o } }",
    "SELECT ?y { GRAPH :mia { ?x ex:looksAt ?y } ?y semmap:heldBy :bench }",
    # Space
    "SELECT ?x { ?x semmap:on :bench }",
    "SELECT ?x ?y { ?x semmap:on ?y . ?x a semmap:Object }",
    "SELECT ?y { :saw semmap:in ?y }",
    "SELECT ?x { ?x semmap:leftOf :bench ; prop:colour ?c }",
    "SELECT ?x { ?x semmap:near :cart }",
    "SELECT ?x { ?x geo:sfWithin :store }",
    "SELECT ?x { ?x geo:hasDefaultGeometry/geo:asWKT ?w FILTER(geof:sfIntersects(?w, "
    '"POLYGON((0 0, 2.2 0, 2.2 4, 0 4, 0 0))"^^geo:wktLiteral)) }',
)
"""Queries with parts that are evaluated by themselves."""

WHOLE = (
    'SELECT ?x { ?x rdfs:label "tool" }',
    "SELECT ?h (COUNT(?x) AS ?n) { ?x semmap:heldBy ?h } GROUP BY ?h",
    "SELECT (COUNT(?x) AS ?n) { ?x ex:looksAt ?y }",
    "SELECT ?x { ?x semmap:heldBy+ :hall }",
    "SELECT ?x { ?x ex:looksAt+ :saw }",
    "SELECT ?x ?y { ?x semmap:heldBy :bench OPTIONAL { ?y ex:looksAt ?x } }",
    "SELECT ?x { ?x semmap:heldBy :bench MINUS { ?y ex:looksAt ?x } }",
    "SELECT ?x { ?x semmap:heldBy ?y FILTER NOT EXISTS { ?x prop:colour ?c } }",
    "SELECT ?p ?o { :saw ?p ?o }",
    "SELECT ?x { ?x semmap:name ?n } ORDER BY ?n LIMIT 3",
    "SELECT ?x ?h { ?x semmap:hasFormerPlacement/semmap:formerHolder ?h }",
    "ASK { ?x ex:looksAt ?y MINUS { ?x prop:colour ?c } }",
    "SELECT ?x { ?x !(rdf:type|semmap:heldBy) :saw }",
)
"""Queries that are evaluated as a whole."""

AXIOMS = """INSERT DATA {
    semmap:Furniture rdfs:subClassOf ex:Heavy . ex:Heavy rdfs:subClassOf ex:Solid .
    ex:looksAt rdfs:range ex:Seen ; owl:inverseOf ex:seenBy . ex:age rdfs:domain semmap:Tool .
    ex:near a owl:SymmetricProperty, owl:TransitiveProperty . ex:Seen owl:disjointWith ex:Heavy .
    rel:beside rdfs:subPropertyOf ex:near . semmap:placedOn rdfs:subPropertyOf ex:near
}"""
INFERRED = (
    "SELECT ?x { ?x a ex:Solid }",
    "ASK { :saw a ex:Seen }",
    "SELECT ?t { :cart a ?t }",
    "SELECT ?x { ?x a semmap:Tool }",
    "SELECT ?x ?y { ?x ex:seenBy ?y }",
    "SELECT ?x { :saw ex:near ?x }",
    "ASK { :glue ex:near :saw }",
    "SELECT ?x ?y { ?x ex:near ?y . ?y a ex:Heavy }",
    "SELECT ?x { ?x ex:seenBy :mia ; semmap:heldBy :bench }",
    "SELECT ?x { ?x a ex:Seen, semmap:Furniture }",
    "SELECT ?x ?y { ?x ex:near ?y FILTER(?y != :bench) }",
    "SELECT ?x ?p { GRAPH <urn:semmap:inferred> { ?x ?p :saw } }",
    "SELECT ?g ?x { GRAPH ?g { ?x a ex:Seen } }",
    "SELECT ?x { ?x ex:looksAt ?y . ?y a ex:Seen }",
    "SELECT ?x ?why { ?x semmap:contradiction ?why }",
    # As a whole
    "SELECT (COUNT(?x) AS ?n) { ?x a ex:Solid }",
    "SELECT ?x { ?x semmap:heldBy ?y MINUS { ?x a ex:Seen } }",
    "SELECT ?x { ?x ex:near+ :bench }",
    "SELECT ?x FROM <urn:semmap:inferred> { ?x a ex:Seen }",
)
"""Queries of which inferences are answers, too."""

PREFIX = "PREFIX ex: <http://example.org/> "
ENDS = (":mia", ":saw", ":glue", ":bench", ":cart", ":new", "ex:moon")


def spoken(words: str) -> st.SearchStrategy[str]:
    """Updates of SPARQL, with ENDS for {a} and {b}."""
    end = st.sampled_from(ENDS)
    return st.builds(lambda a, b: PREFIX + words.format(a=a, b=b), end, end)


CHANGES = st.one_of(
    spoken("INSERT DATA {{ {a} ex:looksAt {b} }}"),
    spoken("DELETE DATA {{ {a} ex:looksAt {b} }}"),
    spoken("DELETE WHERE {{ {a} ex:looksAt ?y }}"),
    spoken("INSERT DATA {{ GRAPH :mia {{ {a} ex:looksAt {b} }} }}"),
    spoken("DELETE WHERE {{ GRAPH :mia {{ ?x ?p ?y }} }}"),
    spoken("INSERT DATA {{ {a} ex:age 5, 2 }}"),
    spoken("DELETE WHERE {{ ?x ex:age 5 }}"),
    spoken('INSERT DATA {{ {a} rdfs:label "tool" }}'),
    spoken("DELETE WHERE {{ {a} rdfs:label ?l }}"),
    st.sampled_from(
        [
            PREFIX + each
            for each in (
                'INSERT DATA { :saw prop:colour "red" }',
                'INSERT DATA { :saw prop:colour "blue" }',
                'INSERT DATA { :glue prop:colour "red" }',
                "DELETE WHERE { :saw prop:colour ?c }",
                "INSERT DATA { :saw rel:beside :glue }",
                "DELETE WHERE { ?x rel:beside ?y }",
                "INSERT DATA { :glue semmap:placedOn :saw }",
                "INSERT DATA { :gate semmap:state 'closed' }",
                "INSERT DATA { :gate semmap:state 'open' }",
                "INSERT DATA { :cart a semmap:Chair }",
                "INSERT DATA { :cart a semmap:Table }",
                "INSERT DATA { :new a semmap:Cup }",
                "INSERT DATA { :mia ex:looksAt semmap:Table, type:sawhorse }",
                "DELETE WHERE { ?x ex:looksAt type:table }",
                "INSERT DATA { ex:moon a semmap:Table ; semmap:heldBy :bench, ex:sky }",
                "INSERT DATA { ex:moon prop:colour 'red' ; rel:beside :saw ; semmap:z 0.8 }",
                "DELETE WHERE { ex:moon semmap:heldBy ?y ; rel:beside ?z }",
                "DELETE WHERE { ex:moon a ?t }",
            )
        ]
    ),
    st.sampled_from(
        [
            "SELECT move_to(entity_id('{}'), {}, {}, {})".format(*each)
            for each in (
                ("saw", 2, 2, 0.8),
                ("saw", 7, 2, 0),
                ("saw", 2, 2.3, 0.8),
                ("glue", 2.2, 2, 0.8),
                ("glue", 8, 1, 0.4),
                ("bench", 3, 3, 0),
                ("bench", 2, 2, 0),
                ("cart", 2, 3.2, 0),
                ("cart", 8, 1, 0),
                ("mia", 1, 1, 0),
                ("mia", 7, 3, 0),
            )
        ]
    ),
    st.sampled_from(
        [
            "SELECT put(entity_id('glue'), entity_id('hall'))",
            "UPDATE entity SET name = 'new' WHERE name = 'glue'",
            "UPDATE entity SET name = 'glue' WHERE name = 'new' AND type = 'bottle'",
            "DELETE FROM entity WHERE name IN ('new', 'glue')",
            "UPDATE entity SET front = front + 1 WHERE name = 'bench'",
            "UPDATE statement SET object = '7' WHERE object = '5'",
            "brief",
            "pause",
        ]
    ),
)
THOUGHTS = st.one_of(
    CHANGES,
    spoken("INSERT DATA {{ {a} ex:near {b} }}"),
    spoken("DELETE DATA {{ {a} ex:near {b} }}"),
    spoken("INSERT DATA {{ {a} ex:seenBy {b} }}"),
    st.sampled_from(
        [
            "reason",
            "reason",
            "forget",
            PREFIX + "DELETE DATA { ex:Heavy rdfs:subClassOf ex:Solid }",
            PREFIX + "INSERT DATA { ex:Heavy rdfs:subClassOf ex:Solid }",
            PREFIX + "INSERT DATA { ex:age rdfs:range ex:Solid . ex:near rdfs:domain ex:Seen }",
            PREFIX + "DELETE DATA { ex:near rdfs:domain ex:Seen }",
        ]
    ),
)
"""Changes of a map that is reasoned about."""


@pytest.fixture(scope="module")
def workshop(module_engine: Engine) -> Iterator[Map]:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        make_workshop(database, "workshop")
        yield database.map("workshop")


def make_workshop(database: Database, name: str) -> Map:
    made = database.create_map(name)
    made.add_room("hall", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3)
    made.add_room("store", [(5.2, 0), (9, 0), (9, 4), (5.2, 4)], floor=0, ceiling=3)
    made.add_door("gate", "hall", "store", [(5.1, 1), (5.1, 2)])
    made.add_object("bench", type="table", size=(1.4, 0.8, 0.8), pose=(2, 2, 0))
    made.add_object("cart", type="table", size=(0.8, 0.6, 0.4), pose=(8, 1, 0))
    made.add_object("saw", type="sawhorse", define=True, size=(0.3, 0.1, 0.1), pose=(2, 2, 0.8))
    made.add_object("glue", type="bottle", size=(0.1, 0.1, 0.2), pose=(8, 1, 0.4))
    made.add_agent("mia", type="person", size=(0.5, 0.5, 1.7), pose=(1, 1, 0))
    return made


few = settings(
    max_examples=5,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
"""Each example evaluates all queries as a whole after each change."""


def transactions_of(
    changes: st.SearchStrategy[str],
) -> st.SearchStrategy[list[list[str]]]:
    return st.lists(st.lists(changes, min_size=1, max_size=3), min_size=1, max_size=6)


class Watched:
    """Standing queries without a thread, beside whole evaluations of the same queries."""

    def __init__(self, made: Map, texts: tuple[str, ...]) -> None:
        self.session = made.connection
        self.standing = Subscriptions(made.database.engine, made.name)
        self.standing._follow = lambda: None  # type: ignore[method-assign]
        self.rows: dict[int, set[tuple[object, ...]]] = {}
        self.texts: dict[int, str] = {}
        self.history: list[str] = []
        for each in texts:
            number, _ = self.standing.add(PREFIX + each)
            self.texts[number] = PREFIX + each
            self.rows[number] = self.evaluated(PREFIX + each)

    def evaluated(self, text: str) -> set[tuple[object, ...]]:
        answer = query(self.session, text)
        if answer.form == "ASK":
            return {()} if answer.truth else set()
        names = answer.names
        return {
            tuple((n, t) for n, t in zip(names, row, strict=True) if t is not None)
            for row in answer.rows
        }

    def follow(self) -> None:
        """Apply the events since the last call; each must change the rows."""
        self.standing._wake(None)
        while not self.standing._events.empty():
            event = self.standing._events.get()
            assert not isinstance(event, Exception | None), event
            row, rows = tuple(event.bindings.items()), self.rows[event.subscription]
            assert (row in rows) == (event.what == "disappeared"), (event, self.texts)
            (rows.discard if event.what == "disappeared" else rows.add)(row)

    def differing(self) -> list[tuple[str, object, object]]:
        found = [
            (self.texts[n], self.evaluated(self.texts[n]), rows) for n, rows in self.rows.items()
        ]
        return [(text, now - rows, rows - now) for text, now, rows in found if now != rows]

    def change(self, change: str) -> None:
        try:
            if change == "pause":
                time.sleep(0.03)
            elif change == "reason":
                reason(self.session)
            elif change == "forget":
                forget(self.session)
            elif change == "brief":
                with self.session.transaction():
                    view = MapView.of(self.session)
                    brief = Fact(
                        rdflib.URIRef(view.namespace + "mia"),
                        rdflib.URIRef("http://example.org/looksAt"),
                        rdflib.URIRef(view.namespace + "saw"),
                    )
                    FactWriter(view, 0.02).insert([brief])
            elif change.startswith(PREFIX):
                update(self.session, change)
            else:
                self.session.execute(change)
        except (ValueError, psycopg.IntegrityError):
            pass  # refused: nothing changed
        finally:
            if not self.session.autocommit:
                self.session.commit()

    def check(self, changes: list[str]) -> None:
        for change in changes:
            self.change(change)
        self.follow()
        if self.differing():
            self.follow()  # a statement may have ended between the two
        found, self.history = self.differing(), [*self.history, *changes]
        if found:
            for number, text in self.texts.items():  # so that other examples begin as this one
                self.rows[number] = self.evaluated(text)
            self.standing._queries.update_all(MapView.of(self.session))
        assert not found, (found, self.history[-12:])


@pytest.fixture(scope="module")
def watched(workshop: Map) -> Iterator[Watched]:
    made = Watched(workshop, LOCAL + WHOLE)
    with made.standing:
        yield made


def test_queries_of_one_shape_are_translated_once(watched: Watched) -> None:
    of = {q.text.removeprefix(PREFIX): q.parts for q in watched.standing._queries.queries.values()}
    twins = ("SELECT ?x { ?x semmap:heldBy :cart }", "SELECT ?x { ?x semmap:heldBy :hall }")
    (a,), (b,) = (of[text] for text in twins)
    assert a.statements is b.statements
    assert a.patterns[0].terms != b.patterns[0].terms


def test_statements_about_types_are_answers(workshop: Map) -> None:
    update(workshop.connection, PREFIX + "INSERT DATA { :saw ex:meant semmap:Table, type:a }")
    with Subscriptions(workshop.database.engine, workshop.name) as standing:
        types = ("semmap:Table", "type:a", "semmap:Chair", "type:b")
        texts = [PREFIX + f"SELECT ?x {{ ?x ex:meant {each} }}" for each in types]
        assert [count for _, count in standing.add_all(texts)] == [1, 1, 0, 0]


FOREIGN = (
    "INSERT DATA { ex:moon semmap:heldBy :bench }",
    "INSERT DATA { ex:moon prop:colour 'red' ; rel:beside :saw }",
    "INSERT DATA { ex:moon a semmap:Table, type:sawhorse ; ex:looksAt :saw, ex:moon }",
    "SELECT put(entity_id('glue'), entity_id('bench'))",
    "INSERT DATA { :mia ex:looksAt ex:moon . ex:moon semmap:heldBy :cart ; semmap:state 'open' }",
    "DELETE WHERE { ex:moon semmap:heldBy ?y }",
    "DELETE WHERE { ex:moon ?p ?o }",
)


SHAPES = (
    "INSERT DATA { ex:lawn geo:hasGeometry ex:g . ex:g geo:asWKT 'POLYGON((0 0, 4 0, 4 4, 0 0))'"
    "^^geo:wktLiteral }",
    "SELECT move_to(entity_id('bench'), 7, 2, 0)",
    "SELECT move_to(entity_id('bench'), 3, 1, 0)",
    "INSERT DATA { GRAPH ex:plan { ex:p geo:asWKT 'POINT(1 1)'^^geo:wktLiteral } }",
    "DELETE DATA { ex:lawn geo:hasGeometry ex:g }",
    "DELETE WHERE { ?x geo:asWKT ?w }",
)


RELATED = (
    "SELECT ?x ?y { ?x geo:sfIntersects ?y }",
    "SELECT ?x { ?x geo:sfContains :bench }",
    "SELECT ?g ?x { GRAPH ?g { ?x geo:sfEquals ?x } }",
)


@pytest.mark.parametrize(
    ("name", "queries", "changes"),
    [("another", LOCAL + WHOLE, FOREIGN), ("shapes", RELATED, SHAPES)],
)
def test_facts_about_foreign_resources_are_events(
    module_engine: Engine, name: str, queries: tuple[str, ...], changes: tuple[str, ...]
) -> None:
    url = module_engine.url.render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        made = Watched(make_workshop(database, name), queries)
        with made.standing:
            for change in changes:
                made.check([PREFIX + change if "{" in change else change])


def test_a_query_that_fails_ends_by_itself(workshop: Map) -> None:
    session = workshop.connection
    failing = PREFIX + "SELECT (COUNT(*) AS ?all) { ?x ex:like ?y FILTER(REGEX(STR(?y), '(')) }"
    with Subscriptions(workshop.database.engine, workshop.name) as standing:
        standing._follow = lambda: None  # type: ignore[method-assign]
        standing.add_all([failing, PREFIX + "SELECT ?x { ?x ex:like ?y FILTER(?y != 'a') }"])
        update(session, PREFIX + "INSERT DATA { ex:moon ex:like 1.7e308 . ex:sun ex:like 1.6e308 }")
        standing._wake(None)
        events = [standing._events.get_nowait() for _ in range(3)]
        assert sorted(type(event).__name__ for event in events) == ["Event", "Event", "QueryError"]
        update(session, PREFIX + "DELETE WHERE { ex:moon ex:like ?y }")
        standing._wake(None)
        assert standing._events.get_nowait().what == "disappeared"  # type: ignore[union-attr]
        assert standing._events.empty()


def test_subscriptions_are_made_all_or_none(workshop: Map) -> None:
    good = PREFIX + "SELECT ?x { ?x ex:like :saw }"
    with Subscriptions(workshop.database.engine, workshop.name) as standing:
        with pytest.raises(ValueError, match="DESCRIBE"):
            standing.add_all([good, "DESCRIBE :saw"])
        with pytest.raises(QueryError, match="line 1"):
            standing.add_all([good, "SELECT ?x { ?x semmap:heldBy :saw"])
        assert not standing._queries.queries
        assert standing.add_all([good, good]) == [(1, 0), (2, 0)]


def test_events_arrive_after_all_connections_were_lost(workshop: Map) -> None:
    session = workshop.connection
    (others,) = session.execute("SELECT array_agg(pid) FROM pg_stat_activity").fetchone()
    with Subscriptions(workshop.database.engine, workshop.name) as standing:
        standing.add(PREFIX + "SELECT ?x { ?x ex:like :saw }")
        for change, what in (("INSERT", "appeared"), ("DELETE", "disappeared")):
            session.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE pid <> ALL (%s) AND datname = current_database()",
                (others,),
            )
            update(session, f"{PREFIX} {change} DATA {{ :mia ex:like :saw }}")
            assert next(standing.events(timeout=20)).what == what


def test_which_queries_have_parts(watched: Watched) -> None:
    found = {
        query.text.removeprefix(PREFIX): bool(query.parts[0].patterns)
        for query in watched.standing._queries.queries.values()
    }
    assert found == dict.fromkeys(LOCAL, True) | dict.fromkeys(WHOLE, False)


@few
@given(transactions=transactions_of(CHANGES))
def test_events_are_the_differences_of_whole_evaluations(
    watched: Watched, transactions: list[list[str]]
) -> None:
    for changes in transactions:
        watched.check(changes)


@pytest.fixture(scope="module")
def thinking(workshop: Map) -> Iterator[Watched]:
    """A second workshop, which is reasoned about."""
    made = make_workshop(workshop.database, "thinking")
    session = made.connection
    update(session, PREFIX + AXIOMS)
    reason(session)
    watched = Watched(made, LOCAL[::4] + INFERRED)
    with watched.standing:
        yield watched


def test_inferences_are_answers(thinking: Watched) -> None:
    number = {text.removeprefix(PREFIX): n for n, text in thinking.texts.items()}
    seen = number["ASK { :saw a ex:Seen }"]
    for change, now in (("INSERT", {()}), ("DELETE", set())):
        thinking.check([f"{PREFIX} {change} DATA {{ :mia ex:looksAt :saw }}"])
        assert thinking.rows[seen] == now
    heavy = number["SELECT ?x { ?x a ex:Solid }"]
    before = len(thinking.rows[heavy])
    thinking.check(["UPDATE entity SET type = 'table' WHERE name = 'glue'"])
    assert len(thinking.rows[heavy]) == before, "nothing was inferred yet"
    thinking.check(["reason"])
    assert len(thinking.rows[heavy]) == before + 1
    thinking.check(["UPDATE entity SET type = 'bottle' WHERE name = 'glue'", "reason"])
    assert len(thinking.rows[heavy]) == before
    thinking.check([PREFIX + "INSERT DATA { :desk a semmap:Desk }"])
    assert len(thinking.rows[heavy]) == before + 1
    thinking.check(["DELETE FROM entity WHERE name = 'desk'"])
    assert len(thinking.rows[heavy]) == before, "it is gone before the reasoner runs"
    assert () not in thinking.evaluated(thinking.texts[heavy])


@few
@given(transactions=transactions_of(THOUGHTS))
def test_events_of_inferences_are_the_differences_of_whole_evaluations(
    thinking: Watched, transactions: list[list[str]]
) -> None:
    for changes in transactions:
        thinking.check(changes)
