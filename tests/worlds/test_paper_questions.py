"""The example queries of the three papers as SPARQL, on the small house with mugs and a gripper."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import psycopg
import pytest
import trimesh
from sqlalchemy import Engine

import semmap
from semmap import SemanticMap
from semmap.ingest.importer import import_file
from semmap.interlinking.reader import read_map_objects, read_object_models
from semmap.knowledge import query
from semmap.manipulation.store import add_actions, add_gripper, record_task
from tests.knowledge.engines import Engines, comparable
from tests.manipulation.cup_map import candidate

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"


@pytest.fixture(scope="module")
def house(module_engine: Engine, worlds: Path) -> Iterator[SemanticMap]:
    """The house with two mugs of one model on tables, grasps, outcomes, looks and a move."""
    for path in (worlds / "small_house/worlds/small_house.world", ROOMS):
        import_file(module_engine, path, map_name="house")
    with semmap.connect(module_engine.url.render_as_string(hide_password=False)) as db:
        house = db.map("house")
        session = house.session_of_map()
        mug = trimesh.creation.cylinder(0.035, 0.09, sections=24)
        mug.apply_translation((0, 0, 0.045))
        house.add_object("mug1", type="mug", mesh=mug, on="KitchenTable_01_001")
        house.add_object("mug2", type="mug", mesh=mug, on="BalconyTable_01_001")
        house.add_agent("pr2", type="robot", size=(0.6, 0.6, 1.3), pose=(6.5, -1.0, 0))
        add_gripper(session, "pr2 gripper", form="parallel", opening=0.09, depth=0.05)
        add_gripper(session, "hand", form="multi-finger", opening=0.12, depth=0.08)
        side, top = add_actions(
            session,
            "mug1",
            "pr2 gripper",
            [candidate(quality=0.6), candidate(x=0.01, quality=0.8, approach="top", family="top")],
        )
        add_actions(session, "mug1", "hand", [candidate(x=0.02, quality=0.95)])
        record_task(session, "mug1", action=top, outcome="error", message="slipped")
        record_task(session, "mug1", action=side, outcome="completed")
        house.observe("mug2", "BalconyTable_01_001", seen=False)
        yield house


@pytest.fixture
def session(house: SemanticMap) -> psycopg.Connection[Any]:
    return house.session_of_map()


def names(session: psycopg.Connection[Any], text: str) -> list[tuple[Any, ...]]:
    """The rows of an answer: names of entities, values."""
    answer = query(session, text)
    assert not answer.explanation[0].startswith("evaluated by rdflib")
    return [
        tuple(None if t is None else str(t).rsplit("#")[-1] for t in row) for row in answer.rows
    ]


GRASP_FOR_DRINKING = """
SELECT ?object ?grasp ?approach ?success {
    ?object semmap:hasFunction semmap:Drinking ; semmap:hasObjectModel ?model .
    ?grasp a semmap:Grasp ; semmap:actsOn ?model ; semmap:gripper <urn:semmap:device:pr2%20gripper> ;
        semmap:approach ?approach ; semmap:expectedSuccess ?success
    FILTER NOT EXISTS { ?grasp semmap:replacedBy ?better }
} ORDER BY DESC(?success) ?object"""


def test_a_grasp_suitable_for_drinking_the_best_outcome_first(
    session: psycopg.Connection[Any],
) -> None:
    """Tosello et al., section III-A: "Grasp something suitable for drinking!"."""
    expected = session.execute(
        "SELECT f.entity, 'urn:semmap:action:' || a.key, f.approach, f.expected "
        "FROM actions_on(entities_for('drinking'), 'pr2 gripper') f JOIN action a "
        "ON a.id = f.action_id ORDER BY f.expected DESC, f.entity"
    ).fetchall()
    found = names(session, GRASP_FOR_DRINKING)
    assert [(*row[:3], float(row[3])) for row in found] == expected
    assert [row[0] for row in found] == ["mug1", "mug2", "mug1", "mug2"]
    assert found[0][2] == "side", "the outcome counts more than the predicted quality"


OTHERS = (
    # "Grasp a cup!": of a class; "grasp the object at [x, y, z]!": by its shape, if it is novel
    "SELECT ?x ?g { ?x a semmap:Drinkware ; semmap:hasObjectModel ?m . ?g a semmap:Grasp ; "
    "semmap:actsOn ?m }",
    "SELECT ?m ?f { ?m a semmap:ObjectModel ; semmap:hasFunction ?f }",
    "SELECT ?d ?f ?o { ?d a semmap:GripperModel ; semmap:gripperForm ?f ; semmap:opening ?o "
    "FILTER(?o > 0.1) }",
    'SELECT ?d { ?d a semmap:Device ; rdfs:label "hand" ; semmap:capability semmap:Gripping }',
    "SELECT ?t ?o ?m ?g { ?t a semmap:Task ; semmap:outcome ?o ; semmap:taskAction ?g OPTIONAL { "
    "?t semmap:message ?m } }",
    "SELECT ?g ?s { ?g semmap:gripper ?d ; a ?c ; semmap:successes ?s . ?d rdfs:label ?l }",
    "SELECT ?c ?f { ?c semmap:usedFor ?f . semmap:Mug rdfs:subClassOf* ?c }",
    "SELECT ?x ?p ?q { ?x semmap:hasBelief ?b . ?b semmap:place ?p ; semmap:probability ?q }",
    "SELECT ?x ?s ?v { ?x semmap:hasObservation ?o . ?o semmap:seen ?s ; semmap:visibleShare ?v }",
)


@pytest.fixture(scope="module")
def engines(house: SemanticMap) -> Engines:
    return Engines(house.session_of_map())


@pytest.mark.parametrize("text", OTHERS)
def test_other_engines_answer_the_same(
    session: psycopg.Connection[Any], engines: Engines, text: str
) -> None:
    answer = query(session, text)
    assert answer.rows, "a question that nothing answers proves nothing"
    assert comparable(answer) == engines.oxigraph(text)


def test_nodes_are_found_by_their_iris(session: psycopg.Connection[Any]) -> None:
    nodes = names(
        session,
        "SELECT ?n { { ?n a semmap:Action } UNION { ?n a semmap:Task } UNION { ?n a semmap:Device } "
        "UNION { ?n a semmap:ObjectModel } }",
    )
    assert len(nodes) == 3 + 2 + 2 + 1
    for (node,) in nodes:
        assert names(session, f"SELECT ?t {{ <{node}> a ?t }}")
    for other in ("urn:semmap:action:1", "urn:semmap:device:nobody", "urn:semmap:task:x"):
        assert names(session, f"SELECT ?t {{ <{other}> a ?t }}") == []


def test_statements_about_a_grasp_join_it(session: psycopg.Connection[Any]) -> None:
    from semmap.knowledge import update

    with session.transaction() as transaction:
        ((grasp,),) = names(session, "SELECT ?g { ?g semmap:approach 'top' }")
        update(session, f"INSERT DATA {{ <{grasp}> rdfs:label 'from above' . :mug1 :likes 3 }}")
        text = "SELECT ?g { ?g a semmap:Grasp ; rdfs:label 'from above' ; semmap:width ?w }"
        assert names(session, text) == [(grasp,)]
        raise psycopg.Rollback(transaction)


def test_links_are_same_as(session: psycopg.Connection[Any]) -> None:
    """Section III-D: links between entities, object models and records of files."""
    with session.transaction() as transaction:
        sets = [read_map_objects(session, "house"), read_object_models(session)]
        model = sets[1].keys[0]
        numbers = [
            session.execute(
                "INSERT INTO data_set (name, digest) VALUES (%s, %s) RETURNING id", (name, name)
            ).fetchone()[0]  # type: ignore[index]
            for name in (sets[0].name, sets[1].name, "some/household.v2.csv")
        ]
        keys = ("mug1", model, "a cup/1")
        for left, right in ((0, 1), (0, 2), (2, 1)):
            row = session.execute(
                "INSERT INTO link_set (left_id, right_id, pattern, correspondences, labels) "
                "VALUES (%s, %s, 'names', '[]', 0) RETURNING id",
                (numbers[left], numbers[right]),
            ).fetchone()
            session.execute(
                "INSERT INTO record_link VALUES (%s, %s, %s, 1, 1)",
                (row and row[0], keys[left], keys[right]),
            )
        file_iri = "urn:semmap:household.v2:a%20cup%2F1"
        model_iri = f"urn:semmap:object-model:{model.replace(':', '%3A')}"
        assert set(names(session, "SELECT ?a ?b { ?a owl:sameAs ?b }")) == {
            ("mug1", model_iri),
            ("mug1", file_iri),
            (file_iri, model_iri),
        }
        text = "SELECT ?x { :mug1 (owl:sameAs|^owl:sameAs)+ ?x . ?x a semmap:ObjectModel }"
        assert names(session, text) == [(model_iri,)]
        joined = "SELECT ?x { ?x a semmap:Mug ; owl:sameAs ?m . ?m a semmap:ObjectModel }"
        assert names(session, joined) == [("mug1",)]
        raise psycopg.Rollback(transaction)


def test_where_an_object_was(house: SemanticMap, session: psycopg.Connection[Any]) -> None:
    """History: intervals of placements, and the position at a time."""
    with house.transaction() as transaction:
        before = session.execute("SELECT (pose_at(entity_id('mug2'), now()))[1:3]").fetchone()
        house["mug2"].put_on("KitchenTable_01_001")
        then = datetime.now(UTC)
        rows = names(
            session,
            "SELECT ?holder ?from ?until { :mug2 semmap:hasFormerPlacement ?p . "
            "?p semmap:heldBy ?holder ; semmap:from ?from ; semmap:until ?until } ORDER BY ?from",
        )
        spans = [tuple(map(datetime.fromisoformat, row[1:])) for row in rows]
        expected = session.execute(
            "SELECT h.name, lower(p.during), upper(p.during) FROM placement_history p "
            "JOIN entity h ON h.id = p.holder_id WHERE p.entity_id = entity_id('mug2') ORDER BY 2"
        ).fetchall()
        assert [(row[0], *span) for row, span in zip(rows, spans, strict=True)] == expected
        assert rows[0][0] == "BalconyTable_01_001"
        begin, end = spans[0]
        assert begin < end <= then
        middle = (begin + (end - begin) / 2).isoformat()
        text = (
            f'SELECT (semmap:positionAt(:mug2, "{middle}"^^xsd:dateTime) AS ?a) '
            '(semmap:positionAt(:mug2, "1999-01-01T00:00:00Z"^^xsd:dateTime) AS ?b) {}'
        )
        ((old, never),) = names(session, text)
        assert before is not None
        assert (
            old
            == session.execute("SELECT ST_AsText(ST_MakePoint(%s, %s, %s))", before[0]).fetchone()[
                0
            ]
        )  # type: ignore[index]
        assert never is None
        raise psycopg.Rollback(transaction)
