"""A flat whose places are known, for the tests of beliefs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import semmap
from semmap import Map
from tests.conftest import MakeDatabase


@pytest.fixture(scope="module")
def flat_map(make_database: MakeDatabase) -> Iterator[Map]:
    """Two rooms with furniture, a coke without geometry, a cereal box on the table, a robot."""
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        flat = db.create_map("flat")
        flat.add_room(
            "kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.7, type="kitchen"
        )
        flat.add_room("hall", [(4.1, 0), (8, 0), (8, 3), (4.1, 3)], floor=0, ceiling=2.7)
        flat.add_object("table", type="table", size=(1.6, 0.8, 0.75), pose=(1.5, 1.5, 0))
        flat.add_object("counter", type="counter", size=(0.6, 2.0, 0.9), pose=(3.6, 1.5, 0))
        flat.add_object("bench", type="bench", size=(1.2, 0.4, 0.45), pose=(6, 1, 0))
        flat.add_object("fridge", type="refrigerator", size=(0.6, 0.6, 1.8), pose=(0.4, 2.6, 0))
        flat.add_object("cereal", type="food", size=(0.2, 0.08, 0.3), on="table")
        flat.add_object("mug", type="mug", size=(0.08, 0.08, 0.1), on="bench")
        # of a type that the ontology has neither a size nor usual places for
        flat.add_object("coke", type="umbrella")
        flat.add_object("piano", type="piano", size=(1.5, 0.6, 1.2), pose=(5, 2.5, 0))
        flat.add_agent("robot", type="robot", size=(0.5, 0.5, 1.2), pose=(7, 2, 0))
        yield flat


THESIS = (
    "INSERT INTO belief_model (map_id, there, elsewhere, change, moves) "
    "VALUES (current_map(), 0.6, 0.3, 0.1, 'Infinity')"
)
"""Makes the numbers of the thesis those of a map: sightings lose value, and nothing moves."""


WEIGHTS = {
    "table": 1.6 * 0.8,
    "counter": 0.6 * 2.0,
    "bench": 1.2 * 0.4 * 0.2,  # a seat
    "fridge": 0.6 * 0.6 * (1 + 0.3),  # inside, and its top, 1.8 m above the floor
    "piano": 1.5 * 0.6,
    "kitchen": 4 * 3 * 0.02,
    "hall": 3.9 * 3 * 0.02,
}
"""Square metres of each place of the flat, times how readily such a place keeps things."""


@pytest.fixture
def flat(flat_map: Map) -> Iterator[Map]:
    """The flat, for one test: what the test changes is undone."""
    with flat_map.transaction() as transaction:
        yield flat_map
        import psycopg

        raise psycopg.Rollback(transaction)
