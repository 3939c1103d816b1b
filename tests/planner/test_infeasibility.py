import math
import random

import networkx as nx
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


def test_doors_that_would_join_rooms_are_named():
    """In random buildings with doors astray: networkx finds how few of them are needed."""
    draw = random.Random(5)
    named = 0
    for _ in range(60):
        rooms = [f"r{k}" for k in range(6)]
        pairs = {f"d{k}": tuple(draw.sample(rooms, 2)) for k in range(7)}
        off = {name for name in pairs if draw.random() < 0.5}
        doors = [
            PlaceConnector(
                name, ends, (Pose(k), Pose(k + 0.5)), state=draw.choice(["open", "locked"])
            )
            for k, (name, ends) in enumerate(pairs.items())
            if name not in off
        ]
        astray = {name: pairs[name] for name in off}
        graph = RoutingGraph(Topology.of(map(Place, rooms), doors, (), astray))
        ways = nx.MultiGraph()
        ways.add_nodes_from(rooms)
        ways.add_edges_from((*d.places, {"off": 0}) for d in doors if d.state == "open")
        ways.add_edges_from((*ends, {"off": 1}) for ends in astray.values())
        why = ""
        try:
            find_route(graph, graph.endpoint("r0"), graph.endpoint("r1"))
        except NoRouteError as error:
            why = str(error)
        told = why.partition(" would join them")[0].split("; ")[-1].split(", ")
        told = told if "would join them" in why else []
        needed = 0
        if nx.has_path(ways, "r0", "r1"):
            needed = nx.shortest_path_length(ways, "r0", "r1", weight="off")
        assert len(told) == needed
        assert {*told} <= off
        named += bool(told)
    assert named > 5
