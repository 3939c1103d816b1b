import math

import numpy as np
import pytest

from planner.graph_edges import StraightTravelCost, Travel
from planner.route import NoRouteError
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose


def test_a_place_without_doors_says_so_and_one_within_itself_what_it_is():
    class Walled(StraightTravelCost):
        def between(self, place, a, b):
            walked = StraightTravelCost().between(place, a, b)
            apart = np.array([[(p.x < 1.5) != (q.x < 1.5) for q in b] for p in a])
            return Travel(*(np.where(apart.reshape(k.shape), math.inf, k) for k in walked))

    islands = Topology.of([Place("a"), Place("b")], [])
    graph = RoutingGraph(islands, costs=Walled())
    with pytest.raises(NoRouteError, match="a has no door; add a connector"):
        find_route(graph, graph.endpoint("a"), graph.endpoint("b"))
    near, far = graph.endpoint("a", Pose()), graph.endpoint("a", Pose(2.0))
    with pytest.raises(NoRouteError, match=r"finds no path in a from \(0.00, 0.00\) to \(2.00"):
        find_route(graph, near, far)
    assert find_route(graph, near, graph.endpoint("a", Pose(1.0))).metres == 1.0


def test_a_pose_that_is_walled_off_from_the_door_of_the_only_way_says_so():
    class Walled(StraightTravelCost):
        def between(self, place, a, b):
            walked = StraightTravelCost().between(place, a, b)
            apart = np.array([[(p.x < 3.5) != (q.x < 3.5) for q in b] for p in a])
            return Travel(*(np.where(apart.reshape(k.shape), math.inf, k) for k in walked))

    doors = [
        PlaceConnector("door1", ("a", "b"), (Pose(0.5), Pose(1.5))),
        PlaceConnector("way_out", ("b", "outside"), (Pose(5.5), Pose(6.5))),
    ]
    graph = RoutingGraph(Topology.of([Place("a"), Place("b")], doors), costs=Walled())
    with pytest.raises(NoRouteError, match=r"finds no path in b from door1 to \(5.00, 0.00\)"):
        find_route(graph, graph.endpoint("a", Pose()), graph.endpoint("b", Pose(5.0)))
