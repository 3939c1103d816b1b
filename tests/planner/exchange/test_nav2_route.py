"""Nav2's route graphs: what its loader takes, and that its shortest ways are ours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from planner.exchange.nav2_route import nav2_graph, nav2_graphs, write_nav2
from planner.exchange.route_graph import ExchangeError
from planner.graph_edges import StraightTravelCost, Travel
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Place, Topology
from semmap.geometry.pose import Pose
from tests.planner.exchange.buildings import buildings, figure_4
from tests.planner.exchange.nav2_reader import read
from tests.planner.office import door, route

RELAXED = settings(
    max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)


def written(routing: RoutingGraph, tmp_path: Path, **options: object) -> nx.MultiDiGraph:
    (path,) = write_nav2(routing, tmp_path / "graph.geojson", **options)
    return read(path)


def at(graph: nx.MultiDiGraph, place: str) -> list[int]:
    return [n for n, node in graph.nodes.items() if node["metadata"]["place"] == place]


def test_the_office_as_nav2_reads_it(tmp_path: Path) -> None:
    topology = figure_4(door5={"state": "closed"})
    graph = written(RoutingGraph(topology), tmp_path)
    assert len(graph) == 2 * len(topology.connectors)
    assert {n["frame"] for n in graph.nodes.values()} == {"map_floor_1st", "map_floor_3rd"}
    kinds = [e["metadata"]["kind"] for *_, e in graph.edges(data=True)]
    assert kinds.count("passage") == 2 * len(topology.connectors)
    assert kinds.count("ride") == 2
    names = {n["metadata"]["name"]: number for number, n in graph.nodes.items()}
    (opens,) = graph.get_edge_data(names["door5@corridor3"], names["door5@foyer-3rd"]).values()
    assert opens["operations"]["open_door"]["trigger"] == "ON_ENTER"
    assert opens["operations"]["open_door"]["metadata"]["connector"] == "door5"
    doors = [e for *_, e in graph.edges(data=True) if e["metadata"].get("type") == "door"]
    assert len(doors) > 10
    for edge in doors:  # all may be shut when the robot comes
        state = edge["metadata"]["state"]
        assert edge["operations"]["open_door"]["metadata"]["state"] == state
    (calls,) = graph.get_edge_data(names["edoor1@foyer-1st"], names["edoor1@elevator-1st"]).values()
    assert calls["operations"]["call_elevator"]["metadata"]["elevator"] == "elevator"
    (ride,) = graph.get_edge_data(
        names["edoor1@elevator-1st"], names["edoor3@elevator-3rd"]
    ).values()
    assert ride["operations"]["switch_map"]["metadata"]["frame"] == "map_floor_3rd"
    assert ride["operations"]["switch_map"]["trigger"] == "ON_EXIT"
    assert not ride["overridable"]


def test_one_storey_has_one_frame_and_says_where_its_elevator_leads(tmp_path: Path) -> None:
    graph = written(RoutingGraph(figure_4()), tmp_path, storey="floor-3rd")
    assert {n["frame"] for n in graph.nodes.values()} == {"map_floor_3rd"}
    (cabin,) = at(graph, "elevator-3rd")
    switch = graph.nodes[cabin]["operations"]["switch_map"]
    assert switch["trigger"] == "NODE"
    assert switch["metadata"]["storeys"] == ["floor-1st", "floor-3rd"]
    with pytest.raises(ExchangeError, match="no storey attic; there are: floor-1st, floor-3rd"):
        nav2_graph(RoutingGraph(figure_4()), storey="attic")


def test_locked_connectors_and_wrong_directions_are_no_edges(tmp_path: Path) -> None:
    topology = figure_4(door5={"state": "locked"}, door2={"direction": "forward"})
    passed = [
        e["metadata"]["connector"]
        for *_, e in written(RoutingGraph(topology), tmp_path).edges(data=True)
        if e["metadata"]["kind"] == "passage"
    ]
    assert "door5" not in passed
    assert passed.count("door2") == 1
    opened = nav2_graph(RoutingGraph(topology, RobotClass(unlocks=True)))["features"]
    assert any(
        f["properties"]["metadata"].get("connector") == "door5"
        for f in opened
        if "startid" in f["properties"]
    )


@RELAXED
@given(building=buildings())
def test_shortest_ways_are_those_of_routes(building: Topology, tmp_path: Path) -> None:
    try:
        graph = written(RoutingGraph(building), tmp_path)
    except ExchangeError:
        assert not building.connectors or all(
            c.state == "locked" for c in building.connectors.values()
        )
        return
    for start in building.places:
        sources = at(graph, start)
        if not sources:
            continue
        away = nx.multi_source_dijkstra_path_length(graph, set(sources), weight="cost")
        for goal in building.places:
            if goal == start:
                continue
            ours = min((away[n] for n in at(graph, goal) if n in away), default=None)
            try:
                expected = route(building, start, goal).seconds
            except NoRouteError:
                assert ours is None
            else:
                assert ours == pytest.approx(expected, abs=0.01)


def star(doors: int, storey: str = "ground") -> Topology:
    rooms = [Place(f"{storey}-room{n}", storey=storey) for n in range(doors)]
    hall = Place(f"{storey}-hall", storey=storey)
    joins = [door(f"{storey}-d{n}", hall.name, r.name, n, 0, 0.0) for n, r in enumerate(rooms)]
    return Topology.of([hall, *rooms], joins)


def test_a_building_with_too_many_ids_becomes_a_file_a_storey(tmp_path: Path) -> None:
    parts = [star(185, storey) for storey in ("one", "two")]
    both = Topology.of(
        [p for t in parts for p in t.places.values()],
        [c for t in parts for c in t.connectors.values()],
    )
    files = write_nav2(RoutingGraph(both), tmp_path / "graph.geojson")
    assert [f.name for f in files] == ["graph.one.geojson", "graph.two.geojson"]
    assert len(read(files[1])) == 370
    with pytest.raises(ExchangeError, match=r"hall with 260 connectors: .* divide such places"):
        nav2_graphs(RoutingGraph(star(260)))


def test_nothing_to_write_is_said(tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="add connectors that join its rooms"):
        write_nav2(RoutingGraph(Topology.of([Place("a")], [])), tmp_path / "graph.geojson")
    assert not list(tmp_path.iterdir())


class Blocked(StraightTravelCost):
    """No way leads through one place."""

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        walked = super().between(place, a, b)
        if place == "corridor1":
            walked.seconds[:] = np.inf
        return walked


def test_a_walk_that_there_is_not_is_no_edge(tmp_path: Path) -> None:
    graph = written(RoutingGraph(figure_4(), costs=Blocked()), tmp_path)
    walked = {
        e["metadata"]["place"]
        for *_, e in graph.edges(data=True)
        if e["metadata"]["kind"] == "walk"
    }
    assert "corridor3" in walked
    assert "corridor1" not in walked
    assert OUTSIDE not in walked
