"""The file for Nav2's route server: shortest paths in it pass the doors of routes."""

from __future__ import annotations

import itertools
import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import networkx as nx
import pytest
from sqlalchemy import Engine

import semmap
from planner.route import NoRouteError
from tests.planner.exchange.nav2_reader import read
from tests.ros.conftest import Peer, RunNode, refused
from tests.waiting import wait_until

SERVER, KIND = "/route_server/set_route_graph", "nav2_msgs/srv/SetRouteGraph"
CONNECTORS = "SELECT name FROM entity WHERE map_id = current_map() AND kind = 'connector'"
Ways = dict[tuple[str, str], list[str] | None]
"""The doors from a room to another one; None where there is no way."""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("nav2") / "graph.geojson"


@pytest.fixture(scope="module")
def building(peer: Peer, run_node: RunNode, hotel: Engine, file: Path) -> Iterator[semmap.Map]:
    url = hotel.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with semmap.connect(url) as db, run_node(url, "hotel", route_graph=str(file)):
        found = db.map("hotel")
        wait_until(file.exists, 60)
        yield found


def in_file(file: Path, pairs: list[tuple[str, str]]) -> Ways:
    graph = read(file)
    of_place: dict[str, set[int]] = {}
    for number, node in graph.nodes.items():
        of_place.setdefault(node["metadata"]["place"], set()).add(number)
    found: Ways = {}
    for start, goal in pairs:
        sources = of_place.get(start, set())
        away, paths = (
            nx.multi_source_dijkstra(graph, sources, weight="cost") if sources else ({}, {})
        )
        ends = away.keys() & of_place.get(goal, set())
        found[start, goal] = None
        if ends:
            steps = itertools.pairwise(paths[min(ends, key=away.__getitem__)])
            edges = (min(graph[a][b].values(), key=lambda e: e["cost"]) for a, b in steps)
            passed = (edge["metadata"].get("connector") for edge in edges)
            found[start, goal] = [door for door, _ in itertools.groupby(filter(None, passed))]
    return found


def of_map(map: semmap.Map, pairs: list[tuple[str, str]]) -> Ways:
    found: Ways = {}
    for start, goal in pairs:
        try:
            steps = map.route(start, goal).doors
        except NoRouteError:
            found[start, goal] = None
        else:
            found[start, goal] = [step.connector.name for step in steps if step.connector]
    return found


def test_a_route_server_that_comes_later_is_asked(
    peer: Peer, building: semmap.Map, file: Path
) -> None:
    peer("serve", SERVER, KIND, {"success": True})
    assert peer.take(SERVER) == {"graph_filepath": str(file)}


def test_its_shortest_paths_pass_the_doors_of_routes_also_after_one_is_locked(
    peer: Peer, building: semmap.Map, file: Path
) -> None:
    names = sorted(room.name for room in building.rooms)
    names = [name for name in names if not name.startswith("Lift")]  # into one, up and down tie
    pairs = random.Random(1).sample(list(itertools.permutations(names, 2)), 40)
    peer("serve", SERVER, KIND, {"success": True})
    before = of_map(building, pairs)
    assert in_file(file, pairs) == before
    counts = Counter(door for way in before.values() for door in way or ())
    assert len(counts) > 10
    doors = {door.name: door for door in building.doors}
    busy = next(name for name, _ in counts.most_common() if name in doors)
    doors[busy].state = "locked"
    after = of_map(building, pairs)
    assert after != before
    asked = peer.take(SERVER, lambda _: in_file(file, pairs) == after, 60)
    assert asked == {"graph_filepath": str(file)}
    doors[busy].state = "open"
    peer.take(SERVER, lambda _: in_file(file, pairs) == before)


def test_a_graph_that_the_route_server_refuses_is_named(peer: Peer, building: semmap.Map) -> None:
    peer("serve", SERVER, KIND, {"success": False})
    peer.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", latched=False)
    door = next(door for door in building.doors if door.state == "open")
    door.state = "locked"
    try:
        peer.take("/diagnostics", lambda array: "refuses the file" in refused(array)[1])
    finally:
        door.state = "open"
        peer("serve", SERVER, KIND, {"success": True})


def test_without_connectors_the_file_goes_and_the_diagnostics_say_why(
    peer: Peer, building: semmap.Map, file: Path
) -> None:
    peer.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", latched=False)
    with building.transaction():
        for (name,) in building.sql(CONNECTORS):
            building[name].delete()
    peer.take("/diagnostics", lambda array: "hotel has no connectors" in refused(array)[1])
    assert not file.exists()
