"""Route graphs of Nav2 as regions and links: what a user drew comes in whole, or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, text

from semmap.ingest.importer import import_file
from semmap.ingest.route_graph.graph_file import is_route_graph, read_route_graph
from semmap.ingest.world import WorldError
from tests.ingest.test_importer import counts

OFFICE = Path(__file__).parents[3] / "examples/office/office_rooms.geojson"
Change = Callable[[list[dict[str, Any]]], Any]


def node(number: int, x: float, y: float, **said: Any) -> dict[str, Any]:
    geometry = {"type": "Point", "coordinates": [x, y]}
    return {"type": "Feature", "properties": {"id": number, **said}, "geometry": geometry}


def edge(number: int, start: int, end: int, **said: Any) -> dict[str, Any]:
    properties = {"id": number, "startid": start, "endid": end, **said}
    geometry = {"type": "MultiLineString"}  # without coordinates, as in Nav2's own sample
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def graph() -> list[dict[str, Any]]:
    """Two nodes in one room, one on the corridor, in the office's first storey."""
    opens = {"type": "open_door", "trigger": "ON_ENTER", "metadata": {"door_id": 54}}
    return [
        node(0, 12.0, 1.0, frame="map", metadata={"region": {"kind": "desk", "lights": [1, 2]}}),
        node(1, 13.0, 3.4, metadata={"name": "before the door"}),
        node(7, 9.0, 5.0),
        edge(9, 0, 1, cost=10.0, overridable=False, metadata={"speed_limit": 0.85}),
        edge(10, 1, 0),
        edge(11, 1, 7, operations={"open_door": opens}),
        edge(12, 1, 7, cost=3),
    ]


def write(folder: Path, features: list[dict[str, Any]], name: str = "drawn", **more: Any) -> Path:
    path = folder / f"{name}.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **more}))
    return path


def links(engine: Engine) -> dict[tuple[str, str, str], dict[str, Any]]:
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT a.name AS a, l.relation, b.name AS b, l.properties FROM link l "
                "JOIN entity a ON a.id = l.from_id JOIN entity b ON b.id = l.to_id"
            )
        )
        return {(row.a, row.relation, row.b): row.properties for row in rows}


@pytest.fixture
def office(engine: Engine) -> Engine:
    import_file(engine, OFFICE, map_name="office")
    return engine


def test_a_drawn_graph_becomes_regions_in_rooms_and_links(office: Engine, tmp_path: Path) -> None:
    path = write(tmp_path, graph(), storey="floor-1st")
    summary = import_file(office, path, map_name="office")
    assert (summary.added, summary.skipped) == (3, [])
    with office.connect() as connection:
        held = {
            row.name: (row.holder, row.z, row.properties)
            for row in connection.execute(
                text(
                    "SELECT e.name, h.name AS holder, w.pose[3] AS z, e.properties FROM entity e "
                    "JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id "
                    "LEFT JOIN entity h ON h.id = p.holder_id WHERE e.type = 'waypoint'"
                )
            )
        }
    assert {name: holder for name, (holder, _, _) in held.items()} == {
        "drawn-node0": "lab1",
        "before the door": "lab1",
        "drawn-node7": "corridor1",
    }
    assert held["drawn-node0"][2]["metadata"] == {"region": {"kind": "desk", "lights": [1, 2]}}
    found = links(office)
    said = found["drawn-node0", "nav2_edge", "before the door"]
    assert (said["cost"], said["overridable"], said["id"]) == (10.0, False, 9)
    assert said["metadata"] == {"speed_limit": 0.85}
    twice = found["before the door", "nav2_edge", "drawn-node7"]
    assert twice["operations"]["open_door"]["metadata"] == {"door_id": 54}
    assert [(e["id"], e["cost"]) for e in twice["also"]] == [(12, 3.0)]
    assert found["before the door", "stands_before", "door1"] == {"side": 0}
    assert len(found) == 4


def test_importing_again_is_a_no_op_and_deletes_removed_edges(
    office: Engine, tmp_path: Path
) -> None:
    path = write(tmp_path, graph(), storey="floor-1st")
    import_file(office, path, map_name="office")
    before = counts(office), links(office)
    again = import_file(office, path, map_name="office")
    assert (again.added, again.changed, again.removed) == (0, 0, 0)
    assert (counts(office)[:4], links(office)) == (before[0][:4], before[1])
    write(tmp_path, [f for f in graph() if f["properties"]["id"] != 10], storey="floor-1st")
    import_file(office, path, map_name="office")
    gone = ("before the door", "nav2_edge", "drawn-node0")
    assert links(office) == {k: v for k, v in before[1].items() if k != gone}


def test_the_storey_is_given_by_the_frame_the_node_or_the_file(
    office: Engine, tmp_path: Path
) -> None:
    for number, (frame, more) in enumerate(
        (("map_floor_3rd", {}), ("map", {"storey": "floor-3rd"}), ("floor-3rd", {}))
    ):
        features = [node(1, 2, 3, frame=frame), node(2, 2, 5, frame=frame), edge(3, 1, 2)]
        import_file(office, write(tmp_path, features, f"g{number}", **more), map_name="office")
        with office.connect() as connection:
            z = connection.execute(
                text(
                    "SELECT w.pose[3] FROM world w JOIN entity e ON e.id = w.entity_id "
                    "WHERE e.name = :name"
                ),
                {"name": f"g{number}-node1"},
            ).scalar_one()
        assert z == pytest.approx(7.0)
    before = counts(office)
    with pytest.raises(WorldError, match="names no storey, and the map has floor-1st, floor-3rd"):
        import_file(office, write(tmp_path, graph(), "lost"), map_name="office")
    other = tmp_path / "other"
    other.mkdir()
    again = write(other, features, "g2", storey="floor-3rd")
    with pytest.raises(WorldError, match=r"g2-node1: is in the map already.*Rename this file"):
        import_file(office, again, map_name="office")
    assert counts(office) == before


def test_a_graph_alone_makes_a_map(engine: Engine, tmp_path: Path) -> None:
    summary = import_file(engine, write(tmp_path, graph()))
    assert (summary.map, summary.added) == ("drawn", 3)
    assert len(links(engine)) == 3


def test_annotations_are_distinguished_from_graphs(tmp_path: Path) -> None:
    assert not is_route_graph(OFFICE)
    assert is_route_graph(write(tmp_path, graph()))
    line = {"type": "LineString", "coordinates": [[0, 0], [1, 0]]}
    door = {
        "type": "Feature",
        "geometry": line,
        "properties": {"kind": "connector", "joins": "a,b", "note": "startid"},
    }
    assert not is_route_graph(write(tmp_path, [door]))
    assert not is_route_graph(tmp_path / "missing.geojson")


def set_(index: int, **said: Any) -> Change:
    return lambda features: features[index]["properties"].update(said)


BAD: tuple[tuple[Change, str], ...] = (
    (set_(0, id="zero"), r"features\[0\] \(node zero\): its id is 'zero'. Give a whole number"),
    (set_(0, id=70000), r"from 0 to 65535"),
    (set_(0, id=1.5), r"its id is 1.5"),
    (set_(1, id=0), r"features\[1\] \(node 0\): its id 0 is also that of another node"),
    (set_(3, id=10), r"features\[4\] \(edge 10\): its id 10 is also that of another edge"),
    (set_(4, endid=8), r"features\[4\] \(edge 10\): its endid is 8, which is not a node"),
    (lambda f: f[4]["properties"].pop("startid"), r"\(edge 10\): has no startid"),
    (set_(3, cost=-1), r"its cost is -1. Give a number from zero up"),
    (set_(3, cost=None), r"its cost is None"),
    (set_(3, overridable="no"), r"overridable is 'no'. Give true or false"),
    (set_(0, metadata={"a": {"b": None}}), r"metadata.a.b is null, which makes Nav2's loader fail"),
    (set_(0, metadata={"a": [[1]]}), r"metadata.a is an array of arrays or objects"),
    (set_(0, metadata=3), r"its metadata is not an object"),
    (set_(0, metadata={"a": "\x00"}), r"holds a character that is not valid in text"),
    (set_(0, frame=None), r"its frame is None"),
    (set_(3, operations={"go": {"type": "go"}}), r"the trigger of its operation go is None"),
    (set_(3, operations={"go": {"trigger": "NODE"}}), r"its operation go has no type"),
    (lambda f: f[0]["geometry"].update(coordinates=[1]), r"has the position \[1\]"),
    (lambda f: f[0]["geometry"].update(coordinates=[1e9, 0]), r"has the position \[1000000000"),
    (lambda f: f[0]["geometry"].pop("coordinates"), r"has the position None"),
    (lambda f: [f.pop(0) for _ in range(3)], r"contain no node"),
)


@pytest.mark.parametrize(("change", "said"), BAD)
def test_a_bad_file_changes_nothing_and_names_the_feature(
    module_engine: Engine, tmp_path: Path, change: Change, said: str
) -> None:
    features = graph()
    change(features)
    before = counts(module_engine)
    with pytest.raises(WorldError, match=said):
        import_file(module_engine, write(tmp_path, features))
    assert counts(module_engine) == before


def test_invalid_nodes_and_edges_are_left_out_and_named(tmp_path: Path) -> None:
    room = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}
    other = {"type": "Feature", "geometry": room, "properties": {"kind": "room"}}
    world = read_route_graph(write(tmp_path, [*graph(), other, {"type": "Feature"}]))
    assert [s.element for s in world.skipped] == ["features[7]", "features[8]"]
    assert len(world.entries) == 3
