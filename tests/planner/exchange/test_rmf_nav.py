"""Open-RMF's navigation graphs, read as its fleet adapter does."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import networkx as nx
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from sqlalchemy import Engine

from planner.exchange.reader import read_building_outline
from planner.exchange.rmf_nav import write_rmf_nav
from planner.exchange.route_graph import ExchangeError
from planner.readers.topology import read_topology
from planner.route import NoRouteError
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Place, Topology
from semmap.ingest.importer import import_file
from tests.ingest.rmf.test_building import building, dump
from tests.planner.exchange.buildings import buildings, figure_4
from tests.planner.office import route
from tests.seen import seen_by

RELAXED = settings(
    max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)


def read(path: Path) -> nx.DiGraph:
    """Waypoints by name, lanes and rides; what `parse_graph` throws for is an error."""
    root = yaml.safe_load(path.read_text())
    assert isinstance(root["building_name"], str)
    lifts = {}
    for name, said in root["lifts"].items():
        x, y, yaw = (_number(v) for v in said["position"])
        width, depth = (_number(v) for v in said["dims"])
        assert width > 0
        assert depth > 0
        lifts[name] = (x, y, yaw, width, depth)
    for said in root["doors"].values():
        (ax, ay), (bx, by) = said["endpoints"]
        assert math.dist((ax, ay), (bx, by)) > 0
        assert said["map"] in root["levels"]
    graph = nx.DiGraph(lifts=lifts, doors=root["doors"])
    in_lift: dict[str, list[str]] = {}
    for level, said in root["levels"].items():
        names = []
        for x, y, about in said["vertices"]:
            name = about["name"]
            assert isinstance(name, str)
            assert name not in graph, f"duplicated waypoint name {name}"
            graph.add_node(name, level=level, x=_number(x), y=_number(y), **about)
            names.append(name)
            if about.get("lift"):
                assert about["lift"] in lifts
                in_lift.setdefault(about["lift"], []).append(name)
        for start, end, about in said["lanes"]:
            assert isinstance(start, int)
            assert isinstance(end, int)
            assert start != end
            assert about.get("door_name") is None or about["door_name"] in root["doors"]
            a, b = (graph.nodes[names[n]].get("lift") for n in (start, end))
            assert a is None or b is None or a == b, "two lifts"
            graph.add_edge(names[start], names[end], **about)
    for names in in_lift.values():
        spots = [(graph.nodes[n]["x"], graph.nodes[n]["y"]) for n in names]
        assert max(math.dist(p, q) for p in spots for q in spots) <= 0.1, "bad vertical alignment"
        for a, b in pairwise(names):
            graph.add_edge(a, b, ride=True)
            graph.add_edge(b, a, ride=True)
    return graph


def _number(value: Any) -> float:
    assert isinstance(value, int | float)
    assert not isinstance(value, bool)
    return float(value)


def test_the_office_with_doors_and_lift(tmp_path: Path) -> None:
    graph = read(write_rmf_nav(RoutingGraph(figure_4()), tmp_path / "0.yaml", name="office"))
    doors = graph.graph["doors"]
    assert set(doors) == {
        "door1",
        "door2",
        "door5",
        "door6",
        "door7",
        "door8",
        "exit",
        "side_door",
        "edoor1",
        "edoor3",
    } - {"edoor1", "edoor3"}
    assert doors["door1"] == {"endpoints": [[1.55, 4.0], [2.45, 4.0]], "map": "floor-1st"}
    assert graph.edges["door1@lab1", "door1@corridor1"]["door_name"] == "door1"
    way = nx.shortest_path(graph, "lab1", "office4")
    assert [n for n in way if "elevator@" in n] == ["elevator@floor-1st", "elevator@floor-3rd"]


def test_the_office_of_the_map_has_its_cabin_and_its_rooms(
    office_engine: Engine, tmp_path: Path
) -> None:
    with office_engine.connect() as connection:
        topology, around = (
            read_topology(seen_by(connection)),
            read_building_outline(seen_by(connection)),
        )
    path = write_rmf_nav(RoutingGraph(topology), tmp_path / "0.yaml", building=around)
    graph = read(path)
    (lift,) = graph.graph["lifts"].values()
    assert lift == pytest.approx((3.0, 8.3, 0.0, 1.6, 1.8))
    assert (graph.nodes["kitchen"]["x"], graph.nodes["kitchen"]["y"]) == (7.4, 8.2)
    rooms = [p.name for p in topology.places.values() if p.elevator is None and p.name != OUTSIDE]
    assert set(rooms) <= set(graph)


@RELAXED
@given(building=buildings())
def test_what_lanes_join_is_what_routes_join(building: Topology, tmp_path: Path) -> None:
    try:
        graph = read(write_rmf_nav(RoutingGraph(building), tmp_path / "0.yaml"))
    except ExchangeError:
        return
    rooms = [p for p in building.places.values() if p.elevator is None and p.name != OUTSIDE]
    for start in rooms:
        if start.name not in graph:
            assert not building.connectors_of(start.name)
            continue
        reached = nx.descendants(graph, start.name)
        for goal in rooms:
            if goal == start:
                continue
            try:
                route(building, start.name, goal.name)
            except NoRouteError:
                assert goal.name not in reached
            else:
                assert goal.name in reached


def test_nothing_to_drive_is_said(tmp_path: Path) -> None:
    with pytest.raises(ExchangeError, match="add connectors that join the rooms"):
        write_rmf_nav(RoutingGraph(Topology.of([Place("a")], [])), tmp_path / "0.yaml")
    assert not list(tmp_path.iterdir())


def test_lanes_keep_their_speed_mutex_and_dock(engine: Engine, tmp_path: Path) -> None:
    """A lane with all of them, in both directions; another fleet's lane without."""
    drawn = building()
    plan = drawn["levels"]["G"]
    plan["vertices"][15][4]["dock_name"] = [1, "dock_1"]
    plan["lanes"] = [
        [15, 16, {"bidirectional": [4, True], "speed_limit": [3, 0.4], "mutex": [1, "aisle"]}],
        [16, 17, {"bidirectional": [4, False], "orientation": [1, "forward"]}],
    ]
    import_file(engine, write_building(tmp_path / "house.building.yaml", drawn))
    with engine.connect() as connection:
        topology, around = (
            read_topology(seen_by(connection)),
            read_building_outline(seen_by(connection)),
        )
    graph = read(write_rmf_nav(RoutingGraph(topology), tmp_path / "0.yaml", building=around))
    shared = {"speed_limit": 0.4, "mutex": "aisle"}
    assert graph.edges["kitchen", "charger"] == {**shared, "dock_name": "dock_1"}
    assert graph.edges["charger", "kitchen"] == {**shared, "undock_name": "dock_1"}
    one_way = graph.edges["kitchen", "desk spot"]
    assert one_way["orientation_constraint"] == "forward"
    assert not {"speed_limit", "mutex", "dock_name"} & one_way.keys()
    assert graph.nodes["charger"]["dock_name"] == "dock_1"


def write_building(path: Path, drawn: dict[str, Any]) -> Path:
    path.write_text(dump(drawn))
    return path
