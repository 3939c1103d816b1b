"""The building of Open-RMF as another process gets it, beside the map and the file it is from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import networkx as nx
import pytest
import shapely
import yaml
from sqlalchemy import Engine

import semmap
from planner.route import NoRouteError
from tests.ros.conftest import Peer, RunNode

TOPIC, KIND = "/semmap/building_map", "rmf_building_map_msgs/msg/BuildingMap"


@pytest.fixture(scope="module")
def building(peer: Peer, run_node: RunNode, hotel: Engine) -> Iterator[semmap.Map]:
    url = hotel.url.set(drivername="postgresql").render_as_string(hide_password=False)
    peer.listen(TOPIC, KIND)
    with semmap.connect(url) as db, run_node(url, "hotel"):
        yield db.map("hotel")


@pytest.fixture(scope="module")
def message(peer: Peer, building: semmap.Map) -> Any:
    assert building.rooms
    return peer.take(TOPIC, seconds=60)


def lines(graph: Any) -> list[shapely.LineString]:
    at = [(each["x"], each["y"]) for each in graph["vertices"]]
    return [shapely.LineString([at[e["v1_idx"]], at[e["v2_idx"]]]) for e in graph["edges"]]


def leaf(door: Any) -> shapely.LineString:
    return shapely.LineString([(door["v1_x"], door["v1_y"]), (door["v2_x"], door["v2_y"])])


def test_walls_and_doors_are_where_rooms_end(message: Any, building: semmap.Map) -> None:
    """Every 0.1 m of a room's border a wall or a doorway is near."""
    storeys = {storey.name: storey for storey in building.storeys}
    assert [level["name"] for level in message["levels"]] == [*storeys]
    for level in message["levels"]:
        rooms = [
            r for r in building.rooms if r.storey is not None and r.storey.name == level["name"]
        ]
        assert rooms
        drawn = [*lines(level["wall_graph"]), *map(leaf, level["doors"])]
        openings = [
            d.geometry for d in building.doors if d.storey and d.storey.name == level["name"]
        ]
        near = shapely.union_all([*drawn, *openings]).buffer(0.4)
        borders = [r.footprint.boundary for r in rooms if not r.name.startswith("Lift")]
        missed = sum(border.difference(near).length for border in borders)
        assert missed < 0.01 * sum(border.length for border in borders)


def test_doors_are_those_of_the_map(message: Any, building: semmap.Map) -> None:
    found = {door["name"]: leaf(door) for level in message["levels"] for door in level["doors"]}
    assert len(found) > 15
    for name, line in found.items():
        assert line.hausdorff_distance(building.doors[name].geometry) < 0.01
    kinds = {door["door_type"] for level in message["levels"] for door in level["doors"]}
    assert kinds <= {1, 2, 3, 4, 5, 6}


def test_lifts_are_those_of_the_file(message: Any, worlds: Path) -> None:
    stated = yaml.safe_load((worlds / "rmf/hotel/hotel.building.yaml").read_text())["lifts"]
    found = {lift["name"]: lift for lift in message["lifts"]}
    assert found.keys() == stated.keys()
    for name, lift in stated.items():
        made = found[name]
        sides = sorted((made["width"], made["depth"]))
        assert sides == pytest.approx(sorted((lift["width"], lift["depth"])), abs=0.05)
        assert len(made["levels"]) == sum(bool(doors) for doors in lift["level_doors"].values())
        cabin = shapely.MultiLineString(lines(made["wall_graph"])).convex_hull
        assert cabin.centroid.distance(shapely.Point(made["ref_x"], made["ref_y"])) < 0.01
        assert all(cabin.buffer(0.5).contains(leaf(door)) for door in made["doors"])


def graph_of(message: Any) -> nx.DiGraph:
    """The vertices by name, on all levels; those of a lift are one."""
    made = nx.DiGraph()
    for level in message["levels"]:
        for graph in level["nav_graphs"]:
            names = []
            for vertex in graph["vertices"]:
                lift = [p["value_string"] for p in vertex["params"] if p["name"] == "lift"]
                names.append(lift[0] if lift else vertex["name"])
            ways = [
                (names[e["v1_idx"]], names[e["v2_idx"]], e["edge_type"]) for e in graph["edges"]
            ]
            made.add_edges_from((a, b) for a, b, _ in ways)
            made.add_edges_from((b, a) for a, b, kind in ways if kind == 0)
    return made


def test_lanes_lead_where_routes_do_also_after_a_door_is_locked(
    peer: Peer, message: Any, building: semmap.Map
) -> None:
    before = graph_of(message)
    rooms = [r.name for r in building.rooms if not r.name.startswith("Lift") and r.name in before]
    assert len(rooms) > 20
    start = rooms[0]

    def reached() -> set[str]:
        found = set()
        for room in rooms:
            try:
                building.route(start, room)
            except NoRouteError:
                continue
            found.add(room)
        return found

    def in_graph(found: Any) -> set[str]:
        return {*nx.descendants(graph_of(found), start), start} & {*rooms}

    assert in_graph(message) == reached()
    counts = Counter(place for door in building.doors for place in door.places)
    ends = (each for each, count in counts.items() if each and count == 1 and each.name != start)
    end = next(each for each in ends if each.name in rooms)
    dead_end = next(door for door in building.doors if end in door.places)
    dead_end.state = "locked"
    now = reached()
    assert len(now) < len(rooms)
    assert peer.take(TOPIC, lambda found: in_graph(found) == now, seconds=60)
    dead_end.state = "open"
    assert peer.take(TOPIC, lambda found: in_graph(found) == {*rooms}, seconds=60)
