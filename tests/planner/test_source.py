import pytest
from sqlalchemy import text

from planner.route import NoRouteError
from planner.source.meant import read_places_like
from planner.source.topology import read_topology
from planner.topology import OUTSIDE
from semmap.cli import choose_map
from tests.planner.office import route


@pytest.fixture
def connection(office_engine):
    with office_engine.connect() as connection:
        choose_map(connection, "office")
        yield connection
        connection.rollback()


def doors(found):
    return [step.connector.name for step in found.doors]


def test_the_office_is_read_with_its_doors_and_cabins(connection):
    topology = read_topology(connection)
    assert topology.places["lab1"].storey == "floor-1st"
    assert topology.cabins() == {"elevator": ["elevator-1st", "elevator-3rd"]}
    assert topology.connectors["entrance"].places == ("foyer-1st", OUTSIDE)
    assert topology.connectors["edoor1"].type == "elevator_door"
    assert topology.connectors["door13"].state == "locked"
    assert {c.name for c, _ in topology.doors_of("office4")} == {"door6", "door7"}
    z = {round(p.z, 3) for p in topology.connectors["door5"].poses}
    assert z == {7.0}  # in the map's frame


def test_figure_4_on_the_map(connection):
    topology = read_topology(connection)
    expected = ["door1", "door2", "edoor1", "edoor3", "door5", "door6"]
    assert doors(route(topology, "lab1", "office4")) == expected
    assert doors(route(topology, "office4", "lab2")) == ["door7", "door8"]


def test_a_locked_door_in_the_map_bars_the_way(connection):
    connection.execute(
        text(
            "UPDATE connector SET state = 'locked' WHERE entity_id = "
            "(SELECT id FROM entity WHERE name = 'door8' AND map_id = current_map())"
        )
    )
    with pytest.raises(NoRouteError, match="door8 is locked"):
        route(read_topology(connection), "office4", "lab2")


@pytest.mark.parametrize(
    ("said", "places"),
    [
        ("lab1", ["lab1"]),
        ("muffin1", ["office4"]),  # on desk4 in office4
        ("desk1", ["lab2"]),
        ("kitchen", ["kitchen"]),
        ("lab", ["lab1", "lab2"]),
        ("meeting_room", ["meeting1", "meeting3"]),
        ("sanitary_room", ["restroom1", "restroom3"]),  # of a subtype
        ("nowhere", []),
    ],
)  # fmt: skip
def test_people_may_name_a_thing_a_label_or_a_type(connection, said, places):
    assert sorted(read_places_like(connection, read_topology(connection), said)) == places
