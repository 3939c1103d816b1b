"""Twenty questions of a robot engineer, in SPARQL and in SQL, on the small house and the hotel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import psycopg
import pytest
import rdflib
from sqlalchemy import Engine

from semmap.ingest.importer import import_file
from semmap.knowledge import KnowledgeError, query
from semmap.language.error import QueryError
from tests.command_line import semmap

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"

NAMED = "SELECT e.name FROM entity e WHERE e.map_id = current_map() AND "
OF_TYPE = "e.id IN (SELECT id FROM object_type WHERE type = '{}')"

HOUSE: dict[str, tuple[str, str]] = {
    "How many chairs are in each room?": (
        "SELECT ?room (COUNT(?c) AS ?n) { ?c a semmap:Chair ; semmap:heldBy+ ?room . "
        "?room a semmap:Room } GROUP BY ?room",
        "SELECT h.name, count(*) FROM entity e JOIN placement p ON p.entity_id = e.id "
        "JOIN entity h ON h.id = p.holder_id WHERE e.type = 'chair' AND h.kind = 'room' "
        "AND e.map_id = current_map() GROUP BY h.name",
    ),
    "What is on the kitchen table?": (
        "SELECT ?x { ?x semmap:placedOn :KitchenTable_01_001 }",
        NAMED + "e.id IN (SELECT entity_id FROM placement WHERE relation = 'on' "
        "AND holder_id = entity_id('KitchenTable_01_001'))",
    ),
    "Which doors join which rooms?": (
        "SELECT ?d ?a ?b { ?d a semmap:Connector ; semmap:connectsFrom ?a . "
        "OPTIONAL { ?d semmap:connectsTo ?b } }",
        "SELECT d.name, a.name, b.name FROM connector c JOIN entity d ON d.id = c.entity_id "
        "JOIN entity a ON a.id = c.place_a LEFT JOIN entity b ON b.id = c.place_b "
        "WHERE d.map_id = current_map()",
    ),
    "Which rooms can a robot reach from the bedroom?": (
        "SELECT ?x { ?x a semmap:Room ; semmap:reachableFrom :bedroom }",
        NAMED + "e.kind = 'room' AND e.name <> 'bedroom' "
        "AND is_reachable(entity_id('bedroom'), e.id)",
    ),
    "Which tables and cabinets have a top of more than one square metre?": (
        "SELECT ?x { ?x a semmap:SupportFurniture ; geo:hasDefaultGeometry/geo:asWKT ?w "
        "FILTER(geof:area(?w) > 1) }",
        NAMED
        + OF_TYPE.format("support_furniture")
        + " AND (SELECT ST_Area(footprint) FROM world WHERE entity_id = e.id) > 1",
    ),
    "Which furniture is within half a metre of the bed?": (
        "SELECT ?x { ?x a semmap:Furniture FILTER(?x != :Bed_01_001 && "
        "semmap:distance(?x, :Bed_01_001) < 0.5) }",
        NAMED + OF_TYPE.format("furniture") + " AND e.name <> 'Bed_01_001' AND (SELECT "
        "box_gap(a.box, b.box) FROM world a, world b WHERE a.entity_id = e.id "
        "AND b.entity_id = entity_id('Bed_01_001')) < 0.5",
    ),
    "Of which types are there more than four objects?": (
        "SELECT ?t { ?x semmap:kind 'object' ; semmap:directType ?t } GROUP BY ?t "
        "HAVING(COUNT(*) > 4)",
        "SELECT t.iri FROM entity e JOIN semantic_type t ON t.name = e.type WHERE e.kind = 'object'"
        " AND e.map_id = current_map() GROUP BY t.iri HAVING count(*) > 4",
    ),
    "Which chairs stand within a metre of which tables?": (
        "SELECT ?a ?b { ?a a semmap:Chair ; semmap:near ?b . ?b a semmap:Table }",
        "SELECT a.name, b.name FROM entity a, entity b WHERE a.type = 'chair' "
        "AND a.map_id = current_map() AND b.map_id = current_map() "
        "AND b.id IN (SELECT id FROM object_type WHERE type = 'table') AND is_near(a.id, b.id, 1)",
    ),
    "What hangs higher than 1.2 m?": (
        "SELECT ?x { ?x a semmap:Object ; semmap:lowest ?z FILTER(?z > 1.2) }",
        NAMED
        + "e.kind = 'object' AND (SELECT ST_ZMin(box) FROM world WHERE entity_id = e.id) > 1.2",
    ),
    "Which seats stand in the living room's outline?": (
        "SELECT ?x { ?x a semmap:Seat ; geo:sfWithin :living-room }",
        NAMED + OF_TYPE.format("seat") + " AND (SELECT ST_Within(a.footprint, b.footprint) FROM "
        "world a, world b WHERE a.entity_id = e.id AND b.entity_id = entity_id('living-room'))",
    ),
    "Which tables stand on the kitchen's floor?": (
        "SELECT ?x { ?x a semmap:Table ; semmap:on :kitchen }",
        NAMED + OF_TYPE.format("table") + " AND is_on(e.id, entity_id('kitchen'))",
    ),
    "Which objects heavier than 20 kg are in which room?": (
        "SELECT ?x ?room { ?x prop:mass ?m ; semmap:heldBy ?room . ?room a semmap:Room "
        "FILTER(?m > 20) }",
        "SELECT e.name, h.name FROM entity e JOIN placement p ON p.entity_id = e.id JOIN entity h "
        "ON h.id = p.holder_id AND h.kind = 'room' WHERE e.map_id = current_map() "
        "AND (e.properties ->> 'mass')::float8 > 20",
    ),
}
"""Questions about the small house in SPARQL, and SQL that is written by hand."""

HOTEL: dict[str, tuple[str, str]] = {
    "How many rooms has each storey?": (
        "SELECT ?s (COUNT(?r) AS ?n) { ?r a semmap:Room ; semmap:onStorey ?s } GROUP BY ?s",
        "SELECT s.name, count(*) FROM entity e JOIN world w ON w.entity_id = e.id JOIN entity s "
        "ON s.id = w.storey_id WHERE e.kind = 'room' AND e.map_id = current_map() GROUP BY s.name",
    ),
    "Which storeys lie above the lobby's?": (
        "SELECT ?s { ?s semmap:elevation ?e . ?t semmap:elevation ?f ; semmap:name 'L1' "
        "FILTER(?e > ?f) }",
        NAMED + "(SELECT elevation FROM storey WHERE entity_id = e.id) > "
        "(SELECT elevation FROM storey WHERE entity_id = entity_id('L1'))",
    ),
    "Which rooms are cabins of elevators?": (
        "SELECT ?c ?e { ?c semmap:cabinOf ?e }",
        "SELECT e.name, l.name FROM room r JOIN entity e ON e.id = r.entity_id JOIN entity l "
        "ON l.id = r.elevator_id WHERE e.map_id = current_map()",
    ),
    "Which rooms share a door with a cabin?": (
        "SELECT DISTINCT ?r { ?d semmap:connects ?c, ?r . ?c semmap:cabinOf ?e FILTER(?c != ?r) }",
        "SELECT DISTINCT b.name FROM connector c JOIN room r ON r.entity_id IN (c.place_a, "
        "c.place_b) AND r.elevator_id IS NOT NULL JOIN entity b ON b.id IN (c.place_a, c.place_b) "
        "AND b.id <> r.entity_id WHERE b.map_id = current_map()",
    ),
    "Which connectors are elevator doors?": (
        "SELECT ?d { ?d semmap:form 'elevator_door' }",
        NAMED + "e.id IN (SELECT entity_id FROM connector WHERE form = 'elevator_door')",
    ),
    "Which rooms are named or typed as bathrooms?": (
        "SELECT ?r { ?r a semmap:Room ; semmap:name ?n OPTIONAL { ?r rdfs:label ?l } "
        "FILTER(REGEX(?n, 'bath', 'i') || REGEX(?l, 'bath', 'i')) }",
        NAMED + "e.kind = 'room' AND (e.name ~* 'bath' OR e.label ~* 'bath')",
    ),
    "Which objects are within 3 m of the first one, seen from above?": (
        "SELECT ?x { { SELECT ?o { ?o a semmap:Object ; semmap:name ?n } ORDER BY ?n LIMIT 1 } "
        "?o geo:hasCentroid/geo:asWKT ?p . ?x a semmap:Object ; geo:hasCentroid/geo:asWKT ?w "
        "FILTER(geof:distance(?p, ?w, uom:metre) < 3) }",
        NAMED + "e.kind = 'object' AND (SELECT ST_Distance(ST_Centroid(ST_Envelope(a.box)), "
        "ST_Centroid(ST_Envelope(b.box))) FROM world a, world b WHERE a.entity_id = e.id "
        "AND b.entity_id = (SELECT id FROM entity WHERE map_id = current_map() "
        "AND kind = 'object' ORDER BY name COLLATE \"C\" LIMIT 1)) < 3",
    ),
    "Of which types are objects that the ontology does not know?": (
        "SELECT DISTINCT ?t { ?x semmap:kind 'object' ; semmap:directType ?t "
        "FILTER(STRSTARTS(STR(?t), STR(type:))) }",
        "SELECT DISTINCT 'urn:semmap:type#' || t.name FROM entity e JOIN semantic_type t "
        "ON t.name = e.type WHERE t.iri IS NULL AND e.kind = 'object' "
        "AND e.map_id = current_map()",
    ),
}
"""Questions about the hotel; some have no answer where the hotel has nothing of the kind."""


@pytest.fixture(scope="module")
def sessions(module_engine: Engine, worlds: Path) -> dict[str, str]:
    """A database with the house and the hotel."""
    import_file(module_engine, worlds / "small_house/worlds/small_house.world", map_name="house")
    import_file(module_engine, ROOMS, map_name="house")
    import_file(module_engine, worlds / "rmf/hotel/hotel.building.yaml", map_name="hotel")
    return {"url": module_engine.url.render_as_string(hide_password=False)}


@pytest.fixture(scope="module")
def connection(sessions: dict[str, str], module_engine: Engine) -> Any:
    with module_engine.connect() as connection:
        yield connection.connection.driver_connection


def plain(term: Any) -> Any:
    """Return the name of an entity, the IRI of a type, or a value."""
    if isinstance(term, rdflib.URIRef):
        text = str(term)
        return text.rsplit("#")[-1] if text.startswith("urn:semmap:map:") else text
    return None if term is None else term.toPython()


def encoded(value: Any) -> Any:
    from semmap.knowledge.vocabulary import encode

    fixed = isinstance(value, str) and not value.startswith("urn:")
    return encode(value) if fixed else value


@pytest.mark.parametrize(
    ("name", "question"),
    [("house", question) for question in HOUSE] + [("hotel", question) for question in HOTEL],
)
def test_answers_in_sparql_are_those_in_sql(
    connection: psycopg.Connection, name: str, question: str
) -> None:
    connection.rollback()
    connection.execute("SELECT set_config('semmap.map', %s, false)", (name,))
    connection.commit()
    sparql, sql = (HOUSE if name == "house" else HOTEL)[question]
    answer = query(connection, sparql)
    assert not answer.explanation[0].startswith("evaluated by rdflib")
    found = [tuple(map(plain, row)) for row in answer.rows]
    expected = [tuple(map(encoded, row)) for row in connection.execute(sql).fetchall()]
    key = str
    assert sorted(found, key=key) == sorted(expected, key=key)
    if name == "house":
        assert found, "a question that nothing answers proves nothing"


def test_the_command_line(sessions: dict[str, str]) -> None:
    url = sessions["url"]
    text = "SELECT ?x { ?x semmap:placedOn :KitchenTable_01_001 }"
    done = semmap(url, "sparql", text, "--map", "house")
    assert ":Tableware_01_001" in done.stdout
    rows = json.loads(semmap(url, "sparql", text, "--map", "house", "--json").stdout)
    ((only,),) = [row.values() for row in rows["results"]["bindings"]]
    assert only == {"type": "uri", "value": "urn:semmap:map:house#Tableware_01_001"}
    assert "FROM placement" in semmap(url, "sparql", text, "--map", "house", "--explain").stdout
    with pytest.raises(QueryError, match="line 1, column 26"):
        semmap(url, "sparql", "SELECT ?x { ?x semmap:on }", "--map", "house")
    slow = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f }"
    with pytest.raises(KnowledgeError, match=r"0\.2 s"):
        semmap(url, "sparql", slow, "--map", "hotel", "--seconds", "0.2")
