"""A loft whose names and properties need care, beside a second map with the same names."""

from __future__ import annotations

from collections.abc import Iterator

import psycopg
import pytest

import semmap
from semmap import Map
from semmap.knowledge.updates import update
from tests.conftest import MakeDatabase
from tests.knowledge.engines import Engines

STATED = """
PREFIX ex: <http://example.org/>
INSERT DATA {
    :ann ex:likes :cup%201, "tea"@en, "Tee"@de, 5, 2.5, true, ex:coffee ; foaf:knows :bob .
    :bob foaf:knows :ann ; ex:likes ex:coffee ; ex:born "1990-05-17T08:30:00Z"^^xsd:dateTime .
    ex:coffee rdfs:label "coffee" ; a ex:Drink ; ex:servedIn :cup%201 .
    ex:Drink rdfs:subClassOf ex:Liquid .
    :shelf%2Fleft rel:beside :table . :table rel:beside :shelf%2Fleft, :sofa .
    GRAPH :ann_believes { :cup%201 semmap:heldBy :sofa . :bob ex:likes "milk" }
    GRAPH ex:archive { :bob ex:likes "juice" }
}
"""


@pytest.fixture(scope="session")
def loft_map(make_database: MakeDatabase) -> Iterator[Map]:
    """Two rooms, furniture, people and statements."""
    url = make_database(keep=True).render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        other = db.create_map("other")
        other.add_room("studio", [(0, 0), (9, 0), (9, 9), (0, 9)], floor=0, ceiling=3)
        other.add_object("table", type="table", size=(1, 1, 1), pose=(1, 1, 0))
        other.add_object("only here", type="table", size=(1, 1, 1), pose=(4, 4, 0))
        loft = db.create_map("loft")
        loft.add_room(
            "studio", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3, type="living_room"
        )
        loft.add_room(
            "cooking corner",
            [(5.1, 0), (8, 0), (8, 4), (5.1, 4)],
            floor=0,
            type="kitchen",
            label="kitchen",
        )
        loft.add_object("table", type="dining_table", size=(1.6, 0.9, 0.75), pose=(2, 2, 0))
        loft.add_object("sofa", type="sofa", size=(2, 0.9, 0.8), pose=(1.2, 0.6, 0))
        loft.add_object(
            "shelf/left",
            type="bookshelf",
            size=(1, 0.3, 2),
            pose=(4.4, 3.7, 0),
            properties={"colour": "red", "shelves": 5, "mass": 30.5, "fixed": True},
        )
        loft.add_object(
            "cup 1",
            type="cup",
            size=(0.08, 0.08, 0.1),
            on="table",
            properties={"colour": "blau", "owner": {"name": "ann"}, "mass": 0.25},
        )
        loft.add_object(
            "tasse β",
            type="cup",
            size=(0.08, 0.08, 0.1),
            pose=(2.4, 2.2, 0.75),
            properties={"colour": "red", "mass": 1, "note": 'a "quote" \\ and %s'},
        )
        loft.add_object("stove", type="stove", size=(0.6, 0.6, 0.9), pose=(7.5, 3.5, 0))
        loft.add_object("lost", type="umbrella")
        loft.add_agent("ann", type="person", size=(0.5, 0.5, 1.7), pose=(3.5, 1, 0))
        loft.add_agent("bob", type="person", size=(0.5, 0.5, 1.8), pose=(6, 2, 0))
        update(loft.connection, STATED)
        yield loft


@pytest.fixture(scope="session")
def loft(loft_map: Map) -> psycopg.Connection:
    """A session that sees the loft; its tests change nothing."""
    return loft_map.connection


@pytest.fixture(scope="session")
def engines(loft: psycopg.Connection) -> Engines:
    """Other engines with the facts of the loft."""
    return Engines(loft)


@pytest.fixture
def changing(loft_map: Map) -> Iterator[psycopg.Connection]:
    """A session that sees the loft; what the test changes is undone."""
    with loft_map.transaction() as transaction:
        yield loft_map.connection
        raise psycopg.Rollback(transaction)
