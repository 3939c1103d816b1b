"""The example queries of the three papers as SPARQL, on the small house with mugs and a gripper."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
import rdflib
import trimesh
from scipy.spatial import cKDTree
from sqlalchemy import Engine

import semmap
from semmap import Map
from semmap.database.files import schema_folder
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.regions.region_map import BODIES
from semmap.fields.sources.people import GazeSource
from semmap.fields.sources.percepts import Gaze
from semmap.fields.store.names import read_map_vocabulary
from semmap.fields.store.source_history import SourceHistory
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from semmap.interlinking.reader import read_map_objects, read_object_models
from semmap.knowledge.manipulation_triples import MANIPULATION_TRIPLES
from semmap.knowledge.queries import query
from semmap.knowledge.updates import update
from semmap.knowledge.vocabulary import SEMMAP
from semmap.language.error import QueryError
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.devices import add_gripper
from semmap.manipulation.store.tasks import record_task
from tests.command_line import semmap as semmap_command
from tests.knowledge.engines import Engines, comparable
from tests.manipulation.cup_map import candidate
from tests.oracles.r2rml import facts_of, materialized, needs_processor
from tests.question_page import DOCS, blocks_of, plain, questions, written
from tests.seen import seen_by

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"


LOOKS = {
    "human1": ((6.5, -0.6, 1.6), (6.5527, 0.9512, 0.85)),
    "guest 2": ((6.5527, 4.0, 1.6), (6.5527, 0.9512, 0.85)),
}
"""Eye of each person, and what they look at: the first mug. The map does not know the guest."""


def look(session: psycopg.Connection[Any], looks: dict[str, tuple[Any, Any]]) -> None:
    """Keep gazes as `semmap fields serve` does."""
    buffer, time = MapBuffer(), datetime.now(UTC)
    poses = {name: looking_at(eye, at) for name, (eye, at) in looks.items()}
    source = GazeSource(read_map_vocabulary())
    buffer.put("gaze", source(Gaze(poses, time)), time, provides=source.provides)
    with session.transaction():
        updates = {update.source: update for update in buffer.current()}
        SourceHistory(10).save(session, updates)


def looking_at(eye: Any, at: Any) -> Any:
    """A pose whose z axis points from one point to another."""
    z = np.subtract(at, eye) / np.linalg.norm(np.subtract(at, eye))
    x = np.cross((0, 0, 1), z) / np.linalg.norm(np.cross((0, 0, 1), z))
    pose = np.eye(4)
    pose[:3] = np.column_stack([x, np.cross(z, x), z, eye])
    return pose


@pytest.fixture(scope="module")
def house(module_engine: Engine, worlds: Path) -> Iterator[Map]:
    """The house with two mugs of one model on tables, grasps, outcomes, looks and a move."""
    for path in (worlds / "small_house/worlds/small_house.world", ROOMS):
        import_file(module_engine, path, map_name="house")
    with semmap.connect(module_engine.url.render_as_string(hide_password=False)) as db:
        house = db.map("house")
        session = house.connection
        mug = trimesh.creation.cylinder(0.035, 0.09, sections=24)
        mug.apply_translation((0, 0, 0.045))
        house.add_object("mug1", type="mug", mesh=mug, on="KitchenTable_01_001")
        house.add_object("mug2", type="mug", mesh=mug, on="BalconyTable_01_001")
        house.add_object("mug3", type="mug", mesh=mug, pose=(5.9, 0.8, 0.801))
        house.add_object("book1", type="book", size=(0.2, 0.15, 0.04), pose=(6.8, 1.05, 0.801))
        house.add_object("mug", type="vase", size=(0.1, 0.1, 0.2), on="CoffeeTable_01_001")
        house.add_agent("human1", type="person", size=(0.5, 0.5, 1.7), pose=(6.5, -0.6, 0))
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
        look(session, LOOKS)
        house.observe("mug2", "BalconyTable_01_001", seen=False)
        yield house


@pytest.fixture
def session(house: Map) -> psycopg.Connection[Any]:
    return house.connection


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
    ?grasp a semmap:Grasp ; semmap:actsOn ?model ; semmap:approach ?approach ;
        semmap:gripper <urn:semmap:device:pr2%20gripper> ; semmap:expectedSuccess ?success
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
    assert [row[0] for row in found] == 2 * ["mug1", "mug2", "mug3"]
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
def engines(house: Map) -> Engines:
    return Engines(house.connection)


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
        "SELECT ?n { VALUES ?c { semmap:Action semmap:Task semmap:Device semmap:ObjectModel } "
        "?n a ?c }",
    )
    assert len(nodes) == 3 + 2 + 2 + 1
    for (node,) in nodes:
        assert names(session, f"SELECT ?t {{ <{node}> a ?t }}")
    for other in ("urn:semmap:action:1", "urn:semmap:device:nobody", "urn:semmap:task:x"):
        assert names(session, f"SELECT ?t {{ <{other}> a ?t }}") == []


def test_the_ontology_declares_the_properties() -> None:
    ontology = rdflib.Graph()
    for file in ("knowledge/manipulation.ttl", "functions.ttl"):
        ontology.parse(schema_folder() / "ontology" / file)
    kinds = (rdflib.OWL.ObjectProperty, rdflib.OWL.DatatypeProperty, rdflib.OWL.AnnotationProperty)
    declared = {str(each) for kind in kinds for each in ontology.subjects(rdflib.RDF.type, kind)}
    used = {t.property for t in MANIPULATION_TRIPLES if t.property.startswith(SEMMAP)}
    assert used - declared == set()


@needs_processor
def test_a_processor_of_r2rml_makes_the_facts_of_the_house(house: Map, tmp_path: Path) -> None:
    house.export_r2rml(tmp_path / "house.ttl")
    expected = facts_of(house)
    assert {f"<{t.property}>" for t in MANIPULATION_TRIPLES} & {str(q.predicate) for q in expected}
    assert materialized(tmp_path / "house.ttl", house.engine.url) == expected


def test_statements_about_a_grasp_join_it(session: psycopg.Connection[Any]) -> None:
    with session.transaction() as transaction:
        ((grasp,),) = names(session, "SELECT ?g { ?g semmap:approach 'top' }")
        update(session, f"INSERT DATA {{ <{grasp}> rdfs:label 'from above' . :mug1 :likes 3 }}")
        text = "SELECT ?g { ?g a semmap:Grasp ; rdfs:label 'from above' ; semmap:width ?w }"
        assert names(session, text) == [(grasp,)]
        raise psycopg.Rollback(transaction)


def test_links_are_same_as(session: psycopg.Connection[Any]) -> None:
    """Section III-D: links between entities, object models and records of files."""
    with session.transaction() as transaction:
        sets = [read_map_objects(seen_by(session)), read_object_models(session)]
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


def test_where_an_object_was(house: Map, session: psycopg.Connection[Any]) -> None:
    """History: intervals of placements, and the position at a time."""
    with house.transaction() as transaction:
        before = session.execute("SELECT (pose_at(entity_id('mug2'), now()))[1:3]").fetchone()
        house["mug2"].put_on("KitchenTable_01_001")
        then = datetime.now(UTC)
        rows = names(
            session,
            "SELECT ?holder ?from ?until { :mug2 semmap:hasFormerPlacement ?p . "
            "?p semmap:formerHolder ?holder ; semmap:from ?from ; semmap:until ?until } "
            "ORDER BY ?from",
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


DRINKWARE_IN_VIEW = """
SELECT ?x {
    ?x a semmap:Drinkware ; semmap:on :KitchenTable_01_001 .
    :human1 semmap:sees ?x
    FILTER(semmap:distance(?x, :human1) < 2)
}"""


@pytest.fixture(scope="module")
def voxels(house: Map) -> dict[str, Any]:
    """The centres of the voxels of each entity, metres."""
    mirror = VoxelMirror(house.database.engine, "house")
    mirror.catch_up()
    return {
        name: (mirror.regions.voxels(number) + 0.5) * 0.05
        for number, name in mirror.names.items()
        if mirror.roles[number] in BODIES
    }


def in_view(points: Any, agent: str) -> Any:
    """Which points are in the cone of a gaze: 0.5 rad, 5 m."""
    eye, at = map(np.asarray, LOOKS[agent])
    axis = (at - eye) / np.linalg.norm(at - eye)
    off = points - eye
    along = off @ axis
    inside: Any = (np.arccos(along / np.linalg.norm(off, axis=1)) <= 0.25) & (along <= 5)
    return inside


def test_drinkware_on_the_table_in_the_field_of_view_near_by(
    session: psycopg.Connection[Any], voxels: dict[str, Any]
) -> None:
    """One query over the map, the T-Box and the voxels."""
    assert names(session, DRINKWARE_IN_VIEW) == [("mug1",)]
    drinkware_on = "?x a semmap:Drinkware ; semmap:on :KitchenTable_01_001"
    assert set(names(session, f"SELECT ?x {{ {drinkware_on} }}")) == {("mug1",), ("mug3",)}
    seen = {x for (x,) in names(session, "SELECT ?x { :human1 semmap:sees ?x }")}
    assert seen == {
        name
        for name, points in voxels.items()
        if name != "human1" and in_view(points, "human1").mean() >= 0.2
    }
    far = names(session, "SELECT ?x { :guest%202 semmap:sees ?x . ?x a semmap:Drinkware }")
    assert ("mug1",) in far


def test_voxels_are_counted(session: psycopg.Connection[Any], voxels: dict[str, Any]) -> None:
    text = (
        "SELECT ?o (COUNT(*) AS ?n) (MAX(semmap:z(?v)) AS ?z) { ?v semmap:inFieldOfView :human1 ; "
        "semmap:occupiedBy ?o . ?o semmap:kind 'object' } GROUP BY ?o"
    )
    expected = {}
    for name, points in voxels.items():
        inside = points[in_view(points, "human1")]
        if len(inside) and name not in ("human1", "pr2"):
            expected[name] = (len(inside), inside[:, 2].max())
    found = {name: (int(n), float(z)) for name, n, z in names(session, text)}
    assert found.keys() == expected.keys()
    assert all(found[name] == pytest.approx(expected[name]) for name in expected)
    # Without ?v in the rest of the query, fields count, and the multiset is the same.
    counted = text.replace("(MAX(semmap:z(?v)) AS ?z)", "")
    answer = query(session, counted)
    assert "COUNT(*) AS ?n" in answer.explanation[0]
    assert {str(o).rsplit("#")[-1]: n.toPython() for o, n in answer.rows} == {
        name: n for name, (n, _) in expected.items()
    }


QUESTIONS = {
    "who looks at the mug": ("SELECT ?who { ?who semmap:sees :mug1 }", {"human1", "guest%202"}),
    "who looks at drinkware, once each": (
        "SELECT DISTINCT ?who { ?who semmap:sees/a semmap:Drinkware }",
        {"human1", "guest%202"},
    ),
    "what is seen by all": (
        "SELECT ?x { ?x a semmap:Mug FILTER NOT EXISTS { ?who a semmap:Person "
        "FILTER NOT EXISTS { ?who semmap:sees ?x } } }",
        {"mug1"},
    ),
    "drinkware that nobody sees": (
        "SELECT ?x { ?x a semmap:Mug MINUS { ?who semmap:sees ?x } }",
        {"mug2"},
    ),
    "likewise": (
        "SELECT ?x { ?x a semmap:Mug FILTER NOT EXISTS { ?who semmap:sees ?x } }",
        {"mug2"},
    ),
    "where it stands, if seen": (
        "SELECT ?room { :human1 semmap:sees ?x . ?x a semmap:Mug ; semmap:heldBy+ ?room . ?room a "
        "semmap:Room }",
        {"kitchen"},
    ),
    "an entity that has the name of a type": (
        "SELECT DISTINCT ?o { ?v semmap:occupiedBy :mug, ?o }",
        {"mug", "CoffeeTable_01_001", "Tablet_01_001"},
    ),
    "evaluated by rdflib": (
        "SELECT ?x { :human1 semmap:sees ?x . ?x a semmap:Mug BIND(BNODE('a') AS ?b) }",
        {"mug1"},
    ),
    "the notation of reMap, with its namespace": (
        "PREFIX : http://kb.openrobots.org/ SELECT ?o WHERE ?v :inFieldOfView human1 . "
        "?v semmap:occupiedBy ?o . ?o a semmap:Mug",
        {"mug1"},
    ),
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_fields_join_the_rest(session: psycopg.Connection[Any], name: str) -> None:
    text, expected = QUESTIONS[name]
    found = {str(x).rsplit("#")[-1] for (x,) in query(session, text).rows}
    assert found == expected


def test_comparisons_limit_what_fields_return(
    session: psycopg.Connection[Any], voxels: dict[str, Any]
) -> None:
    text = (
        "SELECT (COUNT(*) AS ?n) (MAX(?d) AS ?m) { ?v semmap:occupiedBy :KitchenTable_01_001 ; "
        "semmap:distanceToPerson ?d FILTER(?d < 1.2 && 1 <= ?d) }"
    )
    answer: Any = query(session, text)
    assert "FILTER(?v1 < 1.2) FILTER(?v1 >= 1.0)" in answer.explanation[0]
    ((count, most),) = answer.rows
    distances, _ = cKDTree(voxels["human1"]).query(voxels["KitchenTable_01_001"])
    between = distances[(distances < 1.2) & (distances >= 1)]
    assert count.toPython() == len(between) > 100
    assert most.toPython() == pytest.approx(between.max(), abs=1e-6)


def test_a_voxel_is_a_node(session: psycopg.Connection[Any]) -> None:
    answer: Any = query(
        session,
        "SELECT ?v (semmap:x(?v) AS ?x) (semmap:y(?v) AS ?y) (semmap:z(?v) AS ?z) "
        "{ ?v semmap:occupiedBy :mug1 } ORDER BY DESC(?z) ?v LIMIT 1",
    )
    ((voxel, x, y, z),) = answer.rows
    point = [t.toPython() for t in (x, y, z)]
    assert np.linalg.norm(np.subtract(point, (6.5527, 0.9512, 0.87))) < 0.08
    assert query(session, f"ASK {{ {voxel.n3()} semmap:occupiedBy :mug1 }}").truth is True
    assert query(session, f"ASK {{ {voxel.n3()} semmap:occupiedBy :mug2 }}").truth is False


UNKNOWN = {
    "SELECT ?v { ?v semmap:inPersonalSpace :human1 }": "no source provides :inPersonalSpace",
    "SELECT ?x { :human9 semmap:sees ?x }": "no entity and no type human9",
    "SELECT ?v { ?v semmap:inFieldOfView ?v }": r"\?v is a voxel and an entity",
    "SELECT ?x { ?x a semmap:Mug . ?v semmap:occupiedBy ?x ; semmap:containsRobot ?r }": "provides",
}


@pytest.mark.parametrize("text", UNKNOWN)
def test_what_nothing_states_is_an_error(session: psycopg.Connection[Any], text: str) -> None:
    with pytest.raises(QueryError, match=UNKNOWN[text]) as error:
        query(session, text)
    column = text.index("semmap:") + 1 if text.count("semmap:") == 1 else None
    assert column is None or error.value.column == column
    assert query(session, "ASK { :mug1 a semmap:Mug }").truth


def test_entities_without_voxels_are_named(session: psycopg.Connection[Any]) -> None:
    answer = query(session, "SELECT ?x { :human1 semmap:sees ?x }")
    ((note,),) = (answer.notes,)
    assert "unknown, as they have no voxels" in note
    assert "kitchen-door" in note


def test_fields_do_not_see_what_is_not_committed(
    house: Map, session: psycopg.Connection[Any]
) -> None:
    with house.transaction() as transaction:
        house["mug3"].put_on("BalconyTable_01_001")
        with pytest.raises(QueryError, match="commit first"):
            query(session, "SELECT ?x { :human1 semmap:sees ?x }")
        raise psycopg.Rollback(transaction)


def test_what_fields_state_is_not_stated(session: psycopg.Connection[Any]) -> None:
    with pytest.raises(QueryError, match="named graph"):
        update(session, "INSERT DATA { :human1 semmap:sees :mug2 }")
    with session.transaction() as transaction:
        update(session, "INSERT DATA { GRAPH :human1 { :human1 semmap:sees :mug2 } }")
        text = "SELECT ?x { GRAPH :human1 { ?who semmap:sees ?x } }"
        assert names(session, text) == [("mug2",)]
        raise psycopg.Rollback(transaction)


def test_the_command_says_who_answered(house: Map) -> None:
    url = house.database.engine.url.render_as_string(hide_password=False)
    done = semmap_command(url, "sparql", DRINKWARE_IN_VIEW, "--map", "house", "--explain")
    assert 'fields: SELECT ?v0 WHERE { "human1" <urn:semmap:ontology#sees> ?v0 . }' in done.stdout
    assert "by the kept state of the map, sources as kept at" in done.stdout
    assert "is_on(" in done.stdout


SECTIONS = questions("questions.md")


@pytest.fixture(scope="module")
def given(house: Map) -> Iterator[dict[str, Any]]:
    """The names that the page's Python has."""
    block = blocks_of((DOCS / "questions.md").read_text().split("\n## ")[0])["python"]
    names: dict[str, Any] = {}
    url = house.database.engine.url.render_as_string(hide_password=False)
    exec(block.replace("semmap.connect()", f"semmap.connect({url!r})"), names)
    yield names
    names["session"].close()
    names["db"].close()


@pytest.mark.parametrize("question", SECTIONS)
def test_the_page_is_true_in_all_languages(
    session: psycopg.Connection[Any], given: dict[str, Any], question: str
) -> None:
    blocks = SECTIONS[question]
    answer = query(session, blocks["sparql"])
    rows = [[plain(term) for term in row] for row in answer.rows]
    assert written(rows) == blocks["text"]
    assert rows
    if "sql" in blocks:
        assert written(session.execute(blocks["sql"].encode()).fetchall()) == blocks["text"]
    if "python" in blocks:
        names = dict(given)
        with given["session"].begin():
            exec(blocks["python"], names)
            assert written(names["rows"]) == blocks["text"]
