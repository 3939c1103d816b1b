import pytest
import shapely
from sqlalchemy import text

from planner.readers.topology import read_regions, read_topology
from planner.route import NoRouteError
from planner.topology import OUTSIDE
from semmap.ingest.regions.extraction import draw_region
from tests.planner.office import route
from tests.seen import seen_by


def doors(found):
    return [step.connector.name for step in found.doors]


def test_the_office_is_read_with_its_doors_and_cabins(connection):
    topology = read_topology(seen_by(connection))
    assert topology.places["lab1"].storey == "floor-1st"
    assert topology.cabins() == {"elevator": ["elevator-1st", "elevator-3rd"]}
    assert topology.connectors["entrance"].places == ("foyer-1st", OUTSIDE)
    assert topology.connectors["edoor1"].type == "elevator_door"
    assert topology.connectors["door13"].state == "locked"
    assert {c.name for c, _ in topology.connectors_of("office4")} == {"door6", "door7"}
    z = {round(p.z, 3) for p in topology.connectors["door5"].poses}
    assert z == {7.0}  # in the map's frame


def test_figure_4_on_the_map(connection):
    topology = read_topology(seen_by(connection))
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
        route(read_topology(seen_by(connection)), "office4", "lab2")


def test_regions_without_end_have_no_times(connection):
    regions = [
        ("for_ever", None, True),
        ("since", "[2020-01-01, infinity)", True),
        ("until", "[-infinity, 2020-01-01)", False),
    ]
    of_map, lab = connection.execute(text("SELECT current_map(), entity_id('lab1')")).one()
    for name, valid, _ in regions:
        draw_region(connection, of_map, name, shapely.box(14, 1, 15, 2), holder=lab)
        connection.execute(
            text(
                "UPDATE region SET valid = CAST(:valid AS tstzrange) "
                "WHERE entity_id = entity_id(:name)"
            ),
            {"name": name, "valid": valid},
        )
    found, ends = read_regions(seen_by(connection))
    assert [r.name for r in found if r.name in {n for n, *_ in regions}] == ["for_ever", "since"]
    ids = dict(connection.execute(text("SELECT name, id FROM entity WHERE kind = 'region'")).all())
    years = {name: [t.year for t in ends.get(ids[name], [])] for name, *_ in regions}
    assert years == {"for_ever": [], "since": [2020], "until": [2020]}
