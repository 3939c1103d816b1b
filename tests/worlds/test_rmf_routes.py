"""Where the lanes and lifts of Open-RMF's hotel and clinic lead, `planner.route` leads, too.

The oracle knows nothing of rooms: it is the lanes of ``building.yaml``, each in its directions,
the vertices in a lift's cabin joined over the levels that the lift serves, and the doors' lines as
drawn, in pixels.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import networkx as nx
import pytest
import shapely
import yaml
from shapely import LineString, Point
from sqlalchemy import Engine, text

from navgrid.grid import frame_name
from planner.exchange.nav2_route import nav2_graph
from planner.exchange.reader import read_building_outline
from planner.exchange.rmf_nav import rmf_nav_graph
from planner.live_topology import LiveTopology
from planner.readers.drawn_graph import read_drawn_graph
from planner.readers.entity_lookup import MapLookup, find_entities
from planner.readers.topology import read_topology
from planner.route import NoRouteError
from planner.route_planner import RoutePlanner
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.task_planner import plan_task
from planner.topology import OUTSIDE, Topology
from semmap.query.change_feed import ChangeFeed
from semmap.query.map_handle import MapHandle
from tests.conftest import Import
from tests.planner.office import route
from tests.seen import seen_by

NAMED = {"hotel": 17, "clinic": 30}
"""Vertices with a name, as the collection's own page states them."""

CONNECTED = {"hotel": 140, "clinic": 758}
"""Ordered pairs of them that the lanes of one fleet and the lifts connect."""

CROSSED = {"hotel": 6, "clinic": 13}
"""Doors that lanes lead through."""

NEAR_WALLS = {"hotel": 2, "clinic": 120}
"""Edges that may be nearer to a wall than 0.3 m, as one of their nodes is."""

WAYPOINTS = {
    "hotel": ("tinybot_charger", "deliverybot_charger"),
    "clinic": ("L1_left_nurse_center", "L1_right_nurse_center"),
}
"""Two in one room."""

NO_NODE = {"hotel": "L1-room3", "clinic": "L1-room1"}
"""A room without a waypoint."""

GRAZED = 0.025
"""Metres by which a way may graze a wall: outlines are followed to 2 cm."""

Vertex = tuple[str, int]
"""A level and the number of a vertex on it."""


class Lanes:
    """The lanes of a building, a graph a fleet."""

    def __init__(self, building: dict[str, Any]) -> None:
        self.building = building
        self.names: dict[Vertex, str] = {
            (level, number): vertex[3]
            for level, plan in building["levels"].items()
            for number, vertex in enumerate(plan["vertices"])
            if vertex[3]
        }
        lanes = [lane for plan in building["levels"].values() for lane in plan["lanes"]]
        self.fleets = sorted({lane[2]["graph_idx"][1] for lane in lanes})

    def graph(self, fleet: int) -> nx.DiGraph:
        graph = nx.DiGraph()
        for level, plan in self.building["levels"].items():
            for start, end, said in plan["lanes"]:
                if said["graph_idx"][1] == fleet:
                    graph.add_edge((level, start), (level, end))
                    if said["bidirectional"][1]:
                        graph.add_edge((level, end), (level, start))
        for lift, said in self.building["lifts"].items():
            cabin = [
                (level, number)
                for level in said["level_doors"]
                for number, vertex in enumerate(self.building["levels"][level]["vertices"])
                if len(vertex) > 4 and vertex[4].get("lift_cabin", [1, ""])[1] == lift
            ]
            for a, b in itertools.permutations(cabin, 2):
                if a in graph and b in graph:
                    graph.add_edge(a, b, lift=lift)
        return graph

    def connected(self) -> set[tuple[Vertex, Vertex]]:
        """Ordered pairs of vertices that one fleet drives from and to."""
        return {
            (start, goal)
            for fleet in self.fleets
            for start, away in nx.all_pairs_shortest_path_length(self.graph(fleet))
            for goal in away
            if goal != start
        }

    def through_doors(self) -> Iterator[tuple[Vertex, Vertex, str]]:
        """Lanes that cross one door, with its name."""
        for level, plan in self.building["levels"].items():
            at = [(v[0], v[1]) for v in plan["vertices"]]
            doors = {d[2]["name"][1]: LineString([at[d[0]], at[d[1]]]) for d in plan["doors"]}
            for start, end, _ in plan["lanes"]:
                lane = LineString([at[start], at[end]])
                crossed = [name for name, door in doors.items() if door.intersects(lane)]
                if len(crossed) == 1:
                    yield (level, start), (level, end), crossed[0]


class Building:
    """The lanes of a building, and the map that was made of it."""

    def __init__(self, name: str, lanes: Lanes, engine: Engine) -> None:
        self.name, self.lanes, self.engine = name, lanes, engine
        self.lookup = MapLookup(ChangeFeed(engine).snapshot)
        with engine.connect() as connection:
            self.topology: Topology = read_topology(seen_by(connection))
            rows = connection.execute(
                text(
                    "SELECT e.name, e.label, s.name AS storey FROM entity e "
                    "JOIN world w ON w.entity_id = e.id JOIN entity s ON s.id = w.storey_id "
                    "WHERE e.map_id = current_map() AND e.kind = 'region' ORDER BY e.id"
                )
            ).all()
            self.building = read_building_outline(seen_by(connection))
            self.walls = {
                row.storey: shapely.from_wkb(bytes(row.outline))
                for row in connection.execute(
                    text(
                        "SELECT s.name AS storey, ST_AsBinary(w.footprint) AS outline "
                        "FROM entity e JOIN world w ON w.entity_id = e.id "
                        "JOIN entity s ON s.id = w.storey_id "
                        "WHERE e.map_id = current_map() AND e.type = 'wall'"
                    )
                )
            }
            self.places: dict[Vertex, str] = {}
            for row in rows:
                (place,) = {e.place for e in find_entities(seen_by(connection), row.name)}
                self.places[self.vertex(row.storey, row.name, row.label)] = place

    def vertex(self, level: str, name: str, label: str | None) -> Vertex:
        """The vertex that a region was made of; of two with one name the first comes first."""
        if label is None:
            return level, int(name.removeprefix(f"{level}-waypoint"))
        return next(
            vertex
            for vertex, said in self.lanes.names.items()
            if vertex[0] == level and said == label and vertex not in self.places
        )

    def pairs(self, vertices: set[tuple[Vertex, Vertex]]) -> set[tuple[str, str]]:
        """The pairs of different places in which pairs of vertices lie."""
        found = {(self.places[a], self.places[b]) for a, b in vertices}
        return {(a, b) for a, b in found if a != b}


@pytest.fixture(scope="module", params=NAMED)
def building(request: pytest.FixtureRequest, worlds: Path, imported: Import) -> Iterator[Building]:
    path = worlds / "rmf" / request.param / f"{request.param}.building.yaml"
    with imported((path, request.param)) as engine:
        yield Building(request.param, Lanes(yaml.safe_load(path.read_text())), engine)


def test_each_named_vertex_is_in_a_place_of_its_level(building: Building) -> None:
    assert len(building.lanes.names) == NAMED[building.name]
    for vertex, name in building.lanes.names.items():
        assert building.topology.places[building.places[vertex]].storey == vertex[0], name


def test_where_lanes_and_lifts_lead_there_is_a_route(building: Building) -> None:
    connected = building.lanes.connected()
    named = {pair for pair in connected if set(pair) <= set(building.lanes.names)}
    assert len(named) == CONNECTED[building.name]
    places = building.topology.places
    lifts = building.lanes.building["lifts"]
    pairs = building.pairs(connected)
    assert {a for a, b in pairs} >= {building.places[a] for a, b in named}
    graph = RoutingGraph(building.topology)
    sites = {place: graph.endpoint(place) for pair in pairs for place in pair}
    for start, goal in pairs:
        found = find_route(graph, sites[start], sites[goal])
        ridden = {step.elevator for step in found.steps if step.behaviour == "use_elevator"}
        levels = {places[start].storey, places[goal].storey}
        assert len(ridden) == len(levels) - 1, (start, goal)
        assert all(levels <= set(lifts[lift]["level_doors"]) for lift in ridden)


def test_a_lane_through_a_door_leads_to_the_doors_other_place(building: Building) -> None:
    crossed = set()
    for start, end, door in building.lanes.through_doors():
        connector = building.topology.connectors.get(door) or building.topology.connectors.get(
            f"{door}-door"
        )
        assert connector is not None
        assert set(connector.places) == {building.places[start], building.places[end]}, door
        crossed.add(door)
    assert len(crossed) == CROSSED[building.name]


def test_the_route_graph_leads_through_no_wall(building: Building) -> None:
    graph = RoutingGraph(building.topology)
    graph = nav2_graph(graph, building=building.building)["features"]
    nodes = [f["properties"] for f in graph if f["geometry"]["type"] == "Point"]
    at = {node["id"]: node["metadata"] for node in nodes}
    assert {(n["frame"], n["metadata"]["storey"]) for n in nodes} == {
        (frame_name(storey), storey) for storey in building.lanes.building["levels"]
    }  # the frames of nav2_params.yaml
    edges = [f["properties"] for f in graph if "startid" in f["properties"]]
    doors = [edge for edge in edges if edge["metadata"].get("behaviour") == "pass_door"]
    places = building.topology.places
    for door in doors:
        name = door["metadata"]["connector"]
        if not any(places[p].elevator for p in building.topology.connectors[name].places):
            assert door["operations"]["open_door"]["metadata"]["connector"] == name
    assert len(doors) > 10
    solid = {storey: walls.buffer(-GRAZED) for storey, walls in building.walls.items()}
    driven = nx.DiGraph()
    for said, line in ((f["properties"], f["geometry"]["coordinates"]) for f in graph):
        if "startid" not in said:
            continue
        start, end = at[said["startid"]], at[said["endid"]]
        driven.add_edge(start["name"], end["name"])
        if said["metadata"]["kind"] != "ride":
            drive = LineString(point[:2] for point in line)
            assert not drive.intersects(solid[start["storey"]]), (start["name"], end["name"])
    assert any("#" in node["name"] for node in at.values())
    stands: dict[str, str] = {node["place"]: node["name"] for node in at.values()}
    for a, b in building.pairs(building.lanes.connected()):
        assert nx.has_path(driven, stands[a], stands[b])


def test_edges_keep_the_radius_from_walls(building: Building) -> None:
    """Only the last piece to a node that is nearer to a wall itself comes nearer."""
    radius = 0.3
    graph = nav2_graph(RoutingGraph(building.topology), building=building.building)["features"]
    at = {f["properties"]["id"]: f for f in graph if f["geometry"]["type"] == "Point"}
    near = lines = 0
    for feature in (f for f in graph if "startid" in f["properties"]):
        if feature["properties"]["metadata"]["kind"] != "walk":
            continue
        start, end = (at[feature["properties"][key]] for key in ("startid", "endid"))
        walls = building.walls[start["properties"]["metadata"]["storey"]]
        ends = [Point(node["geometry"]["coordinates"][:2]) for node in (start, end)]
        kept = min(radius, *(walls.distance(point) for point in ends))
        away = walls.distance(LineString(ends))
        assert away >= kept - 0.01, (start["properties"], end["properties"])
        near += away < radius - 0.01
        lines += 1
    assert near <= NEAR_WALLS[building.name]
    assert lines > 400


def test_waypoints_are_places_to_go(building: Building) -> None:
    """Two waypoints of one room are as far apart as they are drawn, and not 0 m."""
    planner = RoutePlanner(RoutingGraph(building.topology), lookup=building.lookup)
    here = [r for r in building.topology.regions if r.outline.area == 0]
    assert len(here) >= NAMED[building.name]
    a, b = (next(r for r in here if r.name == name) for name in WAYPOINTS[building.name])
    assert a.places == b.places
    route = planner.route(a.name, b.name)
    assert route.metres == pytest.approx(a.outline.distance(b.outline), abs=1e-3)
    assert route.metres > 5
    plan = plan_task(MapHandle(building.engine), f"in(robot, {b.name})", start=a.name)
    driven = RoutePlanner.of_live(LiveTopology(MapHandle(building.engine))).route(a.name, b.name)
    assert plan.seconds == pytest.approx(driven.seconds, abs=0.1)
    assert driven.metres >= route.metres - 1e-6  # around walls, also through other rooms


def test_the_rmf_export_has_the_waypoints_and_lanes_of_the_file(building: Building) -> None:
    """Names, chargers, parking spots and directions as `building.yaml` has them."""
    graph = RoutingGraph(building.topology)
    made = rmf_nav_graph(graph, building=building.building)["levels"]
    chargers = lanes = 0
    for level, plan in building.lanes.building["levels"].items():
        vertices = {about["name"]: (x, y, about) for x, y, about in made[level]["vertices"]}
        number: dict[int, str] = {}
        given = [vertex[3] for vertex in plan["vertices"]]
        for i, (_, _, _, name, *params) in enumerate(plan["vertices"]):
            own = {k: v[1] for k, v in (params[0] if params else {}).items()}
            known = next((n for n in (name, f"{name}_2") if n in vertices), None)
            if name and "lift_cabin" not in own:
                assert known is not None, name
                about = vertices[known][2]
                assert about.items() >= {k: v for k, v in own.items() if v != ""}.items()
                chargers += "is_charger" in about
            number[i] = known if name and known else f"{level}-waypoint{i}"
        names = [about["name"] for _, _, about in made[level]["vertices"]]
        driven = {(names[a], names[b]): about for a, b, about in made[level]["lanes"]}
        for start, end, params in plan["lanes"]:
            pair = number[start], number[end]
            if any(n not in vertices or given.count(n) > 1 for n in pair):
                continue  # in a cabin, or two vertices have this name
            assert pair in driven
            heading = params.get("orientation", [1, ""])[1]
            assert driven[pair].get("orientation_constraint", "") == heading
            if params["bidirectional"][1]:
                assert pair[::-1] in driven
            lanes += 1
    assert chargers >= 3
    assert lanes >= 0.8 * sum(
        len(plan["lanes"]) for plan in building.lanes.building["levels"].values()
    )


def test_routes_on_the_drawn_graph_are_those_of_its_lanes(building: Building) -> None:
    """Between waypoints that the lanes join, as far as networkx drives along the lanes."""
    with building.lookup._snapshot() as seen:
        drawn = read_drawn_graph(seen, building.topology)
    planner = RoutePlanner(RoutingGraph(building.topology), lookup=building.lookup)
    lanes = nx.DiGraph()
    for edge in drawn.edges:
        ends = [drawn.nodes[n].point for n in (edge.start, edge.end) if n in drawn.nodes]
        if len(ends) == 2:
            lanes.add_edge(edge.start, edge.end, metres=math.dist(*ends))
    away = dict(nx.all_pairs_dijkstra_path_length(lanes, weight="metres"))
    named = [r.name for r in building.topology.regions if r.label and r.name in drawn.nodes]
    pairs = [(a, b) for a, b in itertools.permutations(named, 2) if b in away.get(a, {})]
    assert len(pairs) > 40
    for a, b in pairs[::37]:
        route = planner.route_on(drawn, a, b)
        assert route.metres == pytest.approx(away[a][b], abs=0.01), (a, b)
    with pytest.raises(NoRouteError, match="no node in"):
        planner.route_on(drawn, named[0], NO_NODE[building.name])


def joined(topology: Topology) -> nx.MultiGraph:
    """What is joined inside of the building."""
    graph = nx.MultiGraph()
    graph.add_nodes_from(topology.places)
    for connector in topology.connectors.values():
        graph.add_edge(*connector.places, key=connector.name, connector=connector)
    for elevator, cabins in topology.cabins().items():
        for a, b in combinations(cabins, 2):
            graph.add_edge(a, b, key=elevator, elevator=elevator)
    graph.remove_nodes_from([OUTSIDE])
    return graph


def test_elsewhere_the_reason_is_said(building: Building) -> None:
    """Each pair of places that nothing joins, and each that one connector alone joins."""
    graph = joined(building.topology)
    alone = [part for part in nx.connected_components(graph) if len(part) < len(graph) / 2]
    main = max(nx.connected_components(graph), key=len)
    for part in alone:
        with pytest.raises(NoRouteError, match=r"add (a|the) connector|leads outside"):
            route(building.topology, min(main), min(part))
    used = set().union(*building.pairs(building.lanes.connected()))
    bridges = [(a, b, graph[a][b]) for a, b in nx.bridges(nx.Graph(graph))]
    cut = 0
    for a, b, edges in bridges:
        if len(edges) > 1 or not ({a, b} & used) or "connector" not in next(iter(edges.values())):
            continue
        (name,) = edges
        topology = locked(building.topology, name)
        with pytest.raises(NoRouteError, match=f"{name} is locked"):
            route(topology, a, b)
        cut += 1
    assert cut > 0


def test_without_a_lift_the_reason_is_said(building: Building) -> None:
    places = building.topology.places
    for a, b in building.pairs(building.lanes.connected()):
        if places[a].storey != places[b].storey:
            with pytest.raises(NoRouteError, match=r"without riding an elevator|use_elevator"):
                route(
                    building.topology,
                    a,
                    b,
                    behaviours={"pass_door", "drive_through", "call_elevator"},
                )
            break
    else:
        raise AssertionError("no lane leads to another level")


def locked(topology: Topology, name: str) -> Topology:
    changed = replace(topology.connectors[name], state="locked")
    return Topology(topology.places, {**topology.connectors, name: changed})
