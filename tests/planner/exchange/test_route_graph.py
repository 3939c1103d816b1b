"""Where something stands before a door or in it, exported graphs lead beside it."""

from __future__ import annotations

import networkx as nx
import pytest
import shapely

from planner.drawn_graph import DrawnEdge, DrawnGraph, DrawnNode, find_drawn_route
from planner.exchange.nav2_route import nav2_graph
from planner.exchange.rmf_nav import rmf_nav_graph
from planner.exchange.route_graph import route_graph
from planner.routing_graph import RoutingGraph
from semmap.geometry.pose import Pose
from tests.planner.test_storey_costmaps import ROBOT, box, ground, wall

NEAR = 0.2 - 0.1
"""Half the robot's width, but for a cell."""

AT = [
    (2.35, 1.5, 0.2),  # where the robot faces the door
    (3.1, 1.3, 0.1),  # in the opening
]

POSES = {"left": Pose.planar(0.8, 1.5, 0.0), "right": Pose.planar(5.2, 1.5, 0.0)}


def routing(at: tuple[float, float, float] | None) -> RoutingGraph:
    things = [] if at is None else [box(10, *at)]
    made = ground([*things, wall(20, -0.2, 1.0), wall(21, 2.0, 3.2)])
    return RoutingGraph(made.topology, ROBOT, made)


@pytest.mark.parametrize("at", AT)
def test_nodes_and_passages_are_beside_what_stands_there(at: tuple[float, float, float]) -> None:
    graph = routing(at)
    obstacle = shapely.Point(at[:2]).buffer(at[2], cap_style="square")
    plain = [pose[:2] for pose in graph.topology.connectors["door"].poses]
    assert shapely.LineString(plain).distance(obstacle) < 0.2
    made = route_graph(graph)
    for move in made.moves:
        if move.connector is not None and move.connector.name == "door":
            line = shapely.LineString([made.nodes[n].point[:2] for n in (move.start, move.end)])
            assert line.distance(obstacle) > NEAR
    lengths = nx.DiGraph()
    for move in made.moves:
        lengths.add_edge(move.start, move.end, seconds=move.seconds)
    names = [node.name for node in made.nodes]
    ends = names.index("door@left"), names.index("door@right")
    for a, b in (ends, ends[::-1]):
        took = nx.dijkstra_path_length(lengths, a, b, weight="seconds")
        edge = graph.index["door"] * 2 + (a == ends[1])
        assert took == pytest.approx(graph.seconds[edge])


@pytest.mark.parametrize("at", [None, *AT])
def test_a_door_is_opened_once_on_the_way(at: tuple[float, float, float] | None) -> None:
    graph = routing(at)
    pieces = len(graph.bends(2 * graph.index["door"])) + 1
    features = nav2_graph(graph)["features"]
    edges = [f["properties"] for f in features if "startid" in f["properties"]]
    through = [e for e in edges if e["metadata"].get("connector") == "door"]
    assert len(through) == 2 * pieces
    assert len([e for e in through if "open_door" in e.get("operations", {})]) == 2
    level = rmf_nav_graph(graph)["levels"]["ground"]
    leaf = graph.topology.connectors["door"].leaf()
    for start, end, params in level["lanes"]:
        line = [level["vertices"][n][:2] for n in (start, end)]
        names = [level["vertices"][n][2]["name"] for n in (start, end)]
        if params.get("door_name") == "door":
            assert shapely.LineString(line).distance(leaf) < 1e-6
        elif any(name.startswith("door#") for name in names):
            assert shapely.LineString(line).crosses(leaf) is False


@pytest.mark.parametrize("aside", ["left", "right"])
def test_a_passage_in_pieces_is_passed_once_when_the_graph_is_read_again(aside: str) -> None:
    graph = routing(AT[1])
    made = route_graph(graph)
    drawn = DrawnGraph(
        {
            n.name: DrawnNode(n.name, aside if n.name.startswith("door#") else n.place, *n.point)
            for n in made.nodes
        },
        [
            DrawnEdge(
                made.nodes[m.start].name,
                made.nodes[m.end].name,
                m.seconds,
                connector=m.connector and m.connector.name,
            )
            for m in made.moves
        ],
    )
    for start, goal in (("left", "right"), ("right", "left")):
        ends = [[graph.endpoint(place, POSES[place])] for place in (start, goal)]
        steps = find_drawn_route(drawn, graph, *ends).steps
        assert [s.behaviour for s in steps].count("pass_door") == 1
