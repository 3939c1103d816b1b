"""The fields and the inventory say the same room of what stands in an opening."""

from __future__ import annotations

import pytest
import shapely

import semmap
from tests.conftest import MakeDatabase

ROOMS = {"west": shapely.box(0, 0, 4, 3), "east": shapely.box(4.2, 0, 9, 3)}
IN = "PREFIX : <urn:semmap:ontology#> SELECT ?what ?room { ?what :in ?room . ?room a :Room }"
SPARQL = "SELECT ?room { :table semmap:in ?room . ?room a semmap:Room }"


@pytest.mark.parametrize("aside", [-0.3, -0.1, -0.05, 0.0, 0.05, 0.1, 0.3])
def test_a_table_in_an_opening_has_one_room(make_database: MakeDatabase, aside: float) -> None:
    """It covers 20 cm of the wall, and 43 % of it are in each room, or more in one."""
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        house = db.create_map("house")
        for name, outline in ROOMS.items():
            house.add_room(name, outline, floor=0, ceiling=2.7)
        house.add_door("gap", "west", "east", [(4.1, 0.5), (4.1, 2.5)])
        at = (4.1 + aside, 1.5, 0)
        house.add_object("table", type="table", size=(1.4, 0.8, 0.75), pose=at)
        ground = shapely.box(at[0] - 0.7, 1.1, at[0] + 0.7, 1.9)
        share = {name: room.intersection(ground).area for name, room in ROOMS.items()}
        wanted = house["table"].room.name
        assert share[wanted] >= max(share.values()) - 1e-9
        assert {str(row[0]).rpartition("#")[2] for row in house.sparql(SPARQL)} == {wanted}
        answer = house.fields.query(IN)
        assert [tuple(row) for row in answer.rows if row[0] == "table"] == [("table", wanted)]
