import pytest

from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.topology import (
    OUTSIDE,
    Place,
    PlaceConnector,
    Topology,
    TopologyError,
    UnknownPlaceError,
)
from semmap.geometry.pose import Pose
from tests.planner.office import door, office


def test_outside_is_a_place_where_a_door_leads_there():
    assert OUTSIDE in office().places
    assert (
        OUTSIDE not in Topology.of([Place("a"), Place("b")], [door("d", "a", "b", 0, 0, 0)]).places
    )


def test_doors_of_a_place_come_with_its_side():
    assert [(c.name, side) for c, side in office().connectors_of("office4")] == [
        ("door6", 1),
        ("door7", 0),
    ]


def test_an_unknown_place_is_answered_with_the_closest_ones():
    with pytest.raises(UnknownPlaceError, match="no place named ofice4; did you mean office4"):
        office().place("ofice4")
    with pytest.raises(UnknownPlaceError, match="there are: corridor1, corridor3, "):
        office().place("zzz")
    with pytest.raises(UnknownPlaceError, match="import a world"):
        Topology().place("lab")


@pytest.mark.parametrize(
    ("places", "joined", "message"),
    [
        (["a", "a"], [], "two places are named a"),
        (["a", "b"], [("d", "a", "b"), ("d", "b", "a")], "two connectors are named d"),
        (["a"], [("d", "a", "b")], "connector d joins b, which is not a place"),
    ],
)
def test_what_does_not_fit_together_is_refused(places, joined, message):
    connectors = [PlaceConnector(n, (a, b), (Pose(), Pose())) for n, a, b in joined]
    with pytest.raises(TopologyError, match=message):
        Topology.of([Place(p) for p in places], connectors)


def test_a_door_inside_one_room_is_a_connector():
    """A wall that stands free in a room: the door is driven through, or driven around."""
    door = PlaceConnector("d", ("a", "a"), (Pose(0.0, -1.0), Pose(0.0, 1.0)), state="closed")
    topology = Topology.of([Place("a")], [door])
    assert [side for _, side in topology.connectors_of("a")] == [0, 1]
    graph = RoutingGraph(topology)
    assert sorted(zip(graph.tails, graph.heads, strict=True)) == [(0, 1), (0, 1), (1, 0), (1, 0)]
    before, behind = (graph.endpoint("a", Pose(0.0, y)) for y in (-2.0, 2.0))
    route = find_route(graph, before, behind)
    assert route.metres == 4.0


@pytest.mark.parametrize(
    ("direction", "from_first", "from_second"),
    [("both", True, True), ("forward", True, False), ("backward", False, True)],
)
def test_direction_says_from_which_side_a_connector_is_passed(direction, from_first, from_second):
    c = PlaceConnector("d", ("a", "b"), (Pose(), Pose()), direction=direction)
    assert (c.passes(0), c.passes(1)) == (from_first, from_second)
