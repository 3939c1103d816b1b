"""Twenty questions of a robot engineer, in SPARQL and in SQL, on the small house and the hotel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import Engine

from semmap.ingest.importer import import_file
from semmap.knowledge import KnowledgeError, query
from semmap.language.error import QueryError
from tests.command_line import semmap
from tests.question_page import plain, questions, written

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"

HOUSE = questions("twenty_questions.md", "The small house")
HOTEL = questions("twenty_questions.md", "A hotel")


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
    blocks = (HOUSE if name == "house" else HOTEL)[question]
    answer = query(connection, blocks["sparql"])
    assert not answer.explanation[0].startswith("evaluated by rdflib")
    found = [[plain(term) for term in row] for row in answer.rows]
    expected = connection.execute(blocks["sql"].encode()).fetchall()
    assert written(found) == written(expected) == blocks["text"]
    assert found, "a question that nothing answers proves nothing"


def test_there_are_twenty_questions() -> None:
    assert (len(HOUSE), len(HOTEL)) == (12, 8)


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
