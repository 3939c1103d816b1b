"""Twenty questions of a robot engineer, in SPARQL and in SQL, on the small house and the hotel."""

from __future__ import annotations

import json
from typing import Any

import psycopg
import pytest
from sqlalchemy import Engine

from semmap.knowledge import KnowledgeError
from semmap.knowledge.queries import query
from semmap.language.error import QueryError
from tests.command_line import semmap
from tests.question_page import plain, questions, written

HOUSE = questions("twenty_questions.md", "The small house")
HOTEL = questions("twenty_questions.md", "A hotel")


@pytest.fixture(scope="module")
def sessions(house_and_hotel: Engine) -> dict[str, str]:
    """A database with the house and the hotel."""
    return {"url": house_and_hotel.url.render_as_string(hide_password=False)}


@pytest.fixture(scope="module")
def connection(house_and_hotel: Engine) -> Any:
    with house_and_hotel.connect() as connection:
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
