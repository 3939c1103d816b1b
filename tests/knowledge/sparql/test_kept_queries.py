"""A query that was asked before has the answer of the map as it is now."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import psycopg
import pytest

from semmap import Map
from semmap.database.maps import see_map
from semmap.knowledge import Answer, KnowledgeError, queries
from semmap.knowledge.queries import query
from semmap.knowledge.reasoning.runs import forget, reason
from semmap.knowledge.sparql import kept_queries
from semmap.knowledge.updates import update
from semmap.limits import QUERY_ROWS
from tests.knowledge.test_query import EX, QUERIES

CUPS = "SELECT ?x ?h { ?x a semmap:Cup ; semmap:heldBy ?h }"


@pytest.fixture(autouse=True)
def kept_whatever_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a busy machine keep queries, too."""
    for name in ("SHORT", "STOPPED", "SLOWER"):
        monkeypatch.setattr(kept_queries, name, 60)


@pytest.fixture
def attic(loft_map: Map) -> Iterator[Map]:
    """A map that a test may change."""
    made = loft_map.database.create_map("attic")
    made.add_room("attic", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3)
    made.add_object("table", type="table", size=(1, 1, 1), pose=(1, 1, 0))
    made.add_object("cup", type="cup", size=(0.1, 0.1, 0.1), on="table")
    yield made
    loft_map.database.drop_map("attic")


def again(session: psycopg.Connection, text: str) -> Answer | None:
    """Return the kept query's answer; None if it has to be translated again."""
    found: Answer | None = queries.KEPT.ask(session, (text, QUERY_ROWS.value, True, None, True), 60)
    return found


def names(answer: Answer) -> set[str]:
    """Return the local names of the first variable's values."""
    return {str(row[0]).rpartition("#")[2] for row in answer.rows}


def test_kept_queries_answer_as_new_ones(loft: psycopg.Connection) -> None:
    kept = 0
    for text in QUERIES:
        once, found = query(loft, EX + text), again(loft, EX + text)
        if found is not None:
            kept += 1
            assert (found.names, found.truth) == (once.names, once.truth)
            assert Counter(found.rows) == Counter(once.rows), text
            assert found.explanation == once.explanation
    assert kept > 0.9 * len(QUERIES)


def test_queries_that_differ_in_an_entity_share_a_plan(loft: psycopg.Connection) -> None:
    def plans() -> int:
        row = loft.execute(
            "SELECT count(*) FROM pg_prepared_statements WHERE name LIKE 'semmap%'"
        ).fetchone()
        assert row is not None
        return int(row[0])

    counts = []
    for name in ("table", "sofa", "studio"):
        text = f"SELECT ?x {{ ?x semmap:heldBy :{name} ; semmap:directType ?shared }}"
        query(loft, text)
        assert again(loft, text) is not None
        counts.append(plans())
    assert counts[0] == counts[1] == counts[2]


def test_another_map(attic: Map, loft_map: Map) -> None:
    text = "SELECT ?x { ?x a semmap:Table FILTER EXISTS { :table semmap:kind ?kind } }"
    session = attic.connection
    for _ in range(3):
        see_map(session, attic.name, lasting=True)
        assert names(query(session, text)) == {"table"}
        see_map(session, loft_map.name, lasting=True)
        of_loft = query(session, text)
        assert len(of_loft.rows) == 1
        assert "map:loft#" in str(of_loft.rows[0][0])
    see_map(session, attic.name, lasting=True)
    assert again(session, text) is None  # it was the loft's
    session.execute("SELECT set_config('semmap.map', 'no such map', false)")
    with pytest.raises(LookupError, match="no such map"):
        query(session, text)
    session.execute("SELECT set_config('semmap.map', 'attic', false)")


def test_entities_come_and_go(attic: Map) -> None:
    session = attic.connection
    text = "SELECT ?k { :lamp semmap:kind ?k }"
    for _ in range(2):
        assert query(session, text).rows == ()
    attic.add_object("lamp", type="stove", size=(0.2, 0.2, 1), pose=(3, 3, 0))
    assert again(session, text) is None
    assert len(query(session, text).rows) == 1
    assert again(session, text) is not None
    with attic.transaction() as transaction:
        attic.connection.execute("UPDATE entity SET name = 'torch' WHERE name = 'lamp'")
        assert query(session, text).rows == ()
        raise psycopg.Rollback(transaction)
    assert len(query(session, text).rows) == 1
    session.execute("UPDATE entity SET name = 'torch' WHERE name = 'lamp'")
    assert query(session, text).rows == ()


def test_a_map_is_made_again(attic: Map, loft_map: Map) -> None:
    text = "SELECT ?x { ?x semmap:heldBy :attic }"
    assert names(query(attic.connection, text)) == {"table"}
    assert names(query(attic.connection, text)) == {"table"}
    loft_map.database.drop_map("attic")
    new = loft_map.database.create_map("attic")
    new.add_room("attic", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3)
    new.add_object("chest", type="sofa", size=(1, 1, 1), pose=(1, 1, 0))
    assert names(query(new.connection, text)) == {"chest"}


def test_the_ontology_changes(attic: Map) -> None:
    session = attic.connection
    text = "PREFIX ex: <http://example.org/kept/> SELECT ?x { ?x a ex:Vessel }"
    try:
        for _ in range(2):
            assert query(session, text).rows == ()
        session.execute(
            "INSERT INTO semantic_type (name, iri) VALUES ('vessel', 'http://example.org/kept/Vessel')"
        )
        assert query(session, text).rows == ()
        session.execute("INSERT INTO type_parent (type, parent) VALUES ('cup', 'vessel')")
        assert names(query(session, text)) == {"cup"}
        assert again(session, text) is not None
        session.execute("UPDATE semantic_type SET iri = NULL WHERE name = 'vessel'")
        assert again(session, text) is None
        assert query(session, text).rows == ()
    finally:
        session.execute("DELETE FROM semantic_type WHERE name = 'vessel'")


def test_statements_come_and_go(attic: Map) -> None:
    session = attic.connection
    texts = ("SELECT ?x { ?x rdfs:label 'mine' }", "SELECT ?x { :cup oro:isNear|rdfs:seeAlso ?x }")
    for text in texts:
        assert query(session, text).rows == query(session, text).rows == ()
        assert again(session, text) is not None
        assert "statement" not in query(session, text).explanation[0]
    update(session, "INSERT DATA { oro:thing rdfs:label 'mine' . :cup rdfs:seeAlso oro:thing }")
    for text in texts:
        assert again(session, text) is None
        assert names(query(session, text)) == {"thing"}
    update(
        session,
        "DELETE { :cup rdfs:seeAlso ?o } INSERT { :cup oro:isNear ?o } "
        "WHERE { :cup rdfs:seeAlso ?o }",
    )
    assert names(query(session, texts[1])) == {"thing"}


def test_inferences_come_and_go(attic: Map) -> None:
    session = attic.connection
    text = "SELECT ?x { ?x a oro:Fragile }"
    assert query(session, text).rows == query(session, text).rows == ()
    update(session, "INSERT DATA { semmap:Cup rdfs:subClassOf oro:Fragile }")
    assert query(session, text).rows == ()
    reason(session)
    assert names(query(session, text)) == {"cup"}
    assert again(session, text) is not None
    assert query(session, text, inferred=False).rows == ()
    assert query(session, text, inferred=False).rows == ()
    assert names(query(session, text)) == {"cup"}
    forget(session)
    assert query(session, text).rows == ()


def test_plans_and_functions_are_replaced(attic: Map) -> None:
    session = attic.connection
    found = query(session, CUPS)
    assert again(session, CUPS) == found
    session.execute("DEALLOCATE ALL")
    assert again(session, CUPS) is None
    assert query(session, CUPS) == found
    assert again(session, CUPS) == found
    # As an update of the schema does: a function is made again, and a column is added.
    (definition,) = session.execute(
        "SELECT pg_get_functiondef('rdf_double'::regproc)"
    ).fetchone() or ("",)
    session.execute("DROP FUNCTION rdf_double; ALTER TABLE entity ADD COLUMN another text")
    try:
        with pytest.raises(psycopg.errors.UndefinedFunction):
            query(session, "SELECT ?x ?z { ?x a semmap:Cup ; semmap:z ?z }")
        session.execute(definition)
        assert query(session, CUPS) == found
        assert again(session, CUPS) == found
    finally:
        session.execute(f"{definition.replace('CREATE FUNCTION', 'CREATE OR REPLACE FUNCTION')}")
        session.execute("ALTER TABLE entity DROP COLUMN another")


def test_rights_are_those_of_the_role(attic: Map) -> None:
    session = attic.connection
    query(session, CUPS)
    assert again(session, CUPS) is not None
    session.execute("CREATE ROLE semmap_stranger")
    try:
        session.execute("GRANT USAGE ON SCHEMA semmap TO semmap_stranger")
        session.execute("SET ROLE semmap_stranger")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            query(session, CUPS)
    finally:
        session.execute("RESET ROLE")
        session.execute("DROP OWNED BY semmap_stranger; DROP ROLE semmap_stranger")
    assert len(query(session, CUPS).rows) == 1


def test_limits_and_settings(attic: Map) -> None:
    session = attic.connection
    text = "SELECT ?x { ?x semmap:name ?n }"
    settings = "SELECT current_setting('statement_timeout'), current_setting('join_collapse_limit')"
    before = session.execute(settings).fetchone()
    assert len(query(session, text).rows) == 3
    assert again(session, text) is not None
    assert session.execute(settings).fetchone() == before
    for _ in range(2):
        with pytest.raises(KnowledgeError, match="more than 2 rows"):
            query(session, text, rows=2)
    assert len(query(session, text, rows=3).rows) == 3


def test_a_kept_statement_that_became_slow_is_planned_again(
    attic: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = attic.connection
    text = "SELECT ?x { ?x semmap:name ?slow }"
    query(session, text)
    monkeypatch.setattr(kept_queries, "SHORT", 0)
    assert again(session, text) is not None
    assert again(session, text) is None
    monkeypatch.setattr(kept_queries, "SHORT", 60)
    monkeypatch.setattr(kept_queries, "SLOWER", 2)
    query(session, text)
    (kept,) = [each for key, each in queries.KEPT._queries.items() if key[0] == text]
    kept.seconds = 0
    assert again(session, text) is not None
    assert again(session, text) is not None
    assert again(session, text) is None
    text = "SELECT (COUNT(*) AS ?n) { ?a semmap:name ?b . ?c semmap:name ?d }"
    query(session, text)
    monkeypatch.setattr(kept_queries, "STOPPED", 0.05)
    with psycopg.connect(session.info.dsn, password=session.info.password) as other:
        other.execute("LOCK TABLE semmap.entity IN ACCESS EXCLUSIVE MODE")
        assert again(session, text) is None  # stopped
    assert session.info.transaction_status == psycopg.pq.TransactionStatus.IDLE
    assert len(query(session, text).rows) == 1


def test_values_of_all_kinds_are_kept(attic: Map) -> None:
    session = attic.connection
    update(session, r"""INSERT DATA { :cup prop:note "a \"quote\", \\ {%s} it" ; prop:mass 2 }""")
    for text in (
        r'SELECT ?x { ?x prop:note "a \"quote\", \\ {%s} it" }',
        "SELECT ?x { ?x prop:mass ?m FILTER(?m > 1.5 && ?m < 3e0 && ?m != 7) }",
        "SELECT ?x { ?x a semmap:Cup ; semmap:since ?t "
        'FILTER(?t > "2001-01-01T00:00:00Z"^^xsd:dateTime) }',
        "SELECT ?x { ?x a semmap:Cup } ORDER BY ?x LIMIT 1 OFFSET 0",
        "SELECT ?x FROM :cup FROM NAMED :table { ?x a semmap:Cup }",
        "CONSTRUCT { ?x semmap:name ?n } WHERE { ?x a semmap:Cup ; semmap:name ?n }",
    ):
        once, found = query(session, text), again(session, text)
        assert found is not None, text
        if once.graph is None:
            assert found.rows == once.rows
            assert bool(found.rows) == ("FROM" not in text), text
        else:
            assert found.graph is not None
            assert set(found.graph) == set(once.graph)
            assert len(found.graph) == 1


def test_threads_share_a_session(attic: Map) -> None:
    session = attic.connection
    texts = [CUPS, "SELECT ?x { ?x a semmap:Table }", "ASK { :cup a semmap:Cup }"]
    wanted = [query(session, text) for text in texts]
    with ThreadPoolExecutor(4) as pool:
        for i, found in enumerate(pool.map(lambda i: query(session, texts[i % 3]), range(60))):
            assert found == wanted[i % 3]
