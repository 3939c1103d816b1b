"""`semmap topology` on the office, and its route graph back into the map."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from sqlalchemy import Engine, text

from navgrid.grid import frame_name
from planner.exchange.route_graph import ExchangeError
from planner.readers.drawn_graph import read_drawn_graph
from planner.readers.topology import read_topology
from planner.route_planner import RoutePlanner
from planner.routing_graph import RoutingGraph
from semmap.database import open_engine
from semmap.ingest.importer import import_file
from semmap.query.storey_reader import read_storeys
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.ingest.worlds_by_hand import room_features
from tests.office import OFFICE_FILES
from tests.planner.exchange.nav2_reader import read
from tests.seen import seen_by


@pytest.fixture
def topology(office_url: str) -> object:
    return lambda *words: semmap(office_url, "topology", *words).stdout


def test_each_ending_says_its_format(topology, tmp_path: Path) -> None:
    for name in ("a.geojson", "a.yaml", "a.dot", "a.json"):
        assert topology("-o", tmp_path / "new" / name).strip() == str(tmp_path / "new" / name)
    assert len(read(tmp_path / "new" / "a.geojson")) > 20
    assert set(yaml.safe_load((tmp_path / "new" / "a.yaml").read_text())) == {
        "building_name",
        "doors",
        "levels",
        "lifts",
    }
    said = json.loads((tmp_path / "new" / "a.json").read_text())
    assert {c["name"] for c in said["connectors"]} >= {"door1", "edoor3"}
    for connector in said["connectors"]:
        assert all(
            {*pose} == {"x", "y", "z", "qx", "qy", "qz", "qw"} for pose in connector["poses"]
        )
    assert (tmp_path / "new" / "a.dot").read_text() == topology()
    assert json.loads(topology("--json", "--storey", "floor-1st"))["elevators"]


def test_a_picture_a_storey_shows_lines_over_the_plan(topology, tmp_path: Path) -> None:
    said = json.loads(topology("-o", tmp_path / "t.png", "--json"))
    assert [Path(p).name for p in said] == ["t.floor-1st.png", "t.floor-3rd.png"]
    pixels = np.asarray(Image.open(said[1]).convert("RGB")).astype(int)
    locked = np.abs(pixels - (0xB3, 0x26, 0x1E)).max(axis=2) < 8
    assert locked.sum() > 500  # door13 is locked: its line has that colour


def test_what_is_wrong_says_the_mend(topology, tmp_path: Path) -> None:
    with pytest.raises(LookupError, match="attic"):
        topology("-o", tmp_path / "a.dot", "--storey", "attic")
    with pytest.raises(ValueError, match=r"a\.txt: its ending stands for no format"):
        topology("-o", tmp_path / "a.txt")
    assert topology("--format", "png") == ""
    assert not list(tmp_path.iterdir())


def test_a_map_without_connectors_says_so(engine: Engine, database: str, tmp_path: Path) -> None:
    path = tmp_path / "room.geojson"
    corners = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]
    geometry = {"type": "Polygon", "coordinates": [corners]}
    room = {"type": "Feature", "geometry": geometry, "properties": {"kind": "room"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [room]}))
    import_file(engine, path)
    with pytest.raises(ExchangeError, match="the map room has no connectors: import"):
        semmap(database, "topology")


def test_the_route_graph_comes_back_as_it_went(
    topology, make_database: MakeDatabase, tmp_path: Path
) -> None:
    path = tmp_path / "graph.geojson"
    topology("-o", path)
    graph = read(path)
    engine = open_engine(make_database())
    for file in [*OFFICE_FILES, path]:
        summary = import_file(engine, file, map_name="office")
    assert (summary.added, summary.skipped) == (len(graph), [])
    with engine.connect() as connection:
        drawn = read_topology(seen_by(connection))
        nodes = connection.execute(
            text(
                "SELECT e.name, h.name AS holder, w.pose, e.properties FROM entity e "
                "JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id "
                "LEFT JOIN entity h ON h.id = p.holder_id "
                "WHERE e.type = 'waypoint' AND e.properties ? 'frame'"
            )
        ).all()
        links = connection.execute(
            text(
                "SELECT a.properties ->> 'id' AS a, b.name, b.properties ->> 'id' AS b, "
                "l.relation, l.properties FROM link l JOIN entity a ON a.id = l.from_id "
                "JOIN entity b ON b.id = l.to_id WHERE l.relation IN ('nav2_edge', 'stands_before')"
            )
        ).all()
        drawn_graph = read_drawn_graph(seen_by(connection), drawn)
    planner = RoutePlanner(RoutingGraph(drawn))
    for start, goal in (("lab1", "office4"), ("office4", "kitchen")):
        route = planner.route_on(drawn_graph, start, goal)
        assert [s.connector for s in route.doors] == [
            s.connector for s in planner.route(start, goal).doors
        ]
    engine.dispose()
    assert {row.properties["id"] for row in nodes} == set(graph)
    for row in nodes:
        node = graph.nodes[row.properties["id"]]
        assert (row.pose[0], row.pose[1]) == pytest.approx((node["x"], node["y"]))
        assert row.properties["metadata"] == node["metadata"]
        place = node["metadata"]["place"]
        storey = node["metadata"]["storey"]
        assert row.holder == (place if place in drawn.places and place != "outside" else storey)
    edges = {
        (r.properties["id"], int(r.a), int(r.b)): r for r in links if r.relation == "nav2_edge"
    }
    assert set(edges) == {(key, a, b) for a, b, key in graph.edges(keys=True)}
    for (key, a, b), row in edges.items():
        edge = graph.edges[a, b, key]
        assert row.properties["cost"] == pytest.approx(edge["cost"])
        assert row.properties["metadata"] == edge["metadata"]
        assert row.properties.get("operations", {}) == edge["operations"]
        assert row.properties["overridable"] == edge["overridable"]
    before = {
        (int(r.a), r.name, r.properties["side"]) for r in links if r.relation == "stands_before"
    }
    expected = {
        (n, node["metadata"]["connector"], node["metadata"]["side"])
        for n, node in graph.nodes.items()
        if node["metadata"]["place"] != "outside" and "connector" in node["metadata"]
    }
    assert before == expected


def test_frames_are_those_of_the_maps_parameters_without_storeys_too(
    engine: Engine, database: str, tmp_path: Path
) -> None:
    path = tmp_path / "flat.geojson"
    flat = room_features({"hall": (0, 0, 4, 4), "bath": (4, 0, 8, 4)})
    line = {"type": "LineString", "coordinates": [[4, 1.5], [4, 2.5]]}
    door = {"type": "Feature", "geometry": line, "properties": {"kind": "door", "name": "d"}}
    flat["features"].append(door)
    path.write_text(json.dumps(flat))
    import_file(engine, path)
    semmap(database, "topology", "-o", tmp_path / "graph.geojson")
    frames = {node["frame"] for _, node in read(tmp_path / "graph.geojson").nodes(data=True)}
    with engine.connect() as connection:
        assert (
            frames
            == {frame_name(s.storey) for s in read_storeys(seen_by(connection))}
            == {"map_flat"}
        )
