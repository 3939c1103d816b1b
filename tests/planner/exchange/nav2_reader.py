"""A route graph read as strictly as Nav2's C++ does.

What `GeoJsonGraphFileLoader` would throw for, misread or leave undefined is an error here: required
keys (``id``; ``startid``, ``endid``; of operations ``type`` and ``trigger``), types (nlohmann
converts no text to a number), ends that are there, metadata of primitives, objects and arrays of
primitives. Of the planner: costs above zero, ids unique over nodes and edges as it blocks both by
id; of the messages: uint16. Of the scorers: reals are written as reals.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import networkx as nx

TRIGGERS = ("NODE", "ON_ENTER", "ON_EXIT")
REALS = ("abs_time_taken", "abs_speed_limit", "speed_limit", "penalty", "yaw", "width")


def read(path: Path) -> nx.MultiDiGraph:
    """Nodes by id with x, y, frame, metadata, operations; edges keyed by id."""
    root = json.loads(path.read_text(), parse_constant=_refuse)
    assert root["type"] == "FeatureCollection"
    features = root["features"]
    nodes = [f for f in features if f["geometry"]["type"] == "Point"]
    edges = [f for f in features if f["geometry"]["type"] in ("LineString", "MultiLineString")]
    assert len(nodes) + len(edges) == len(features)
    assert nodes, "the loader refuses a graph without nodes"
    assert edges, "the loader refuses a graph without edges"
    graph = nx.MultiDiGraph()
    taken: set[int] = set()
    for node in nodes:
        properties = node["properties"]
        x, y = (_number(v) for v in node["geometry"]["coordinates"][:2])
        frame = properties.get("frame", "map")
        assert isinstance(frame, str)
        graph.add_node(
            _id(properties["id"], taken),
            x=x,
            y=y,
            frame=frame,
            metadata=_metadata(properties),
            operations=_operations(properties),
        )
    for edge in edges:
        properties = edge["properties"]
        number = _id(properties["id"], taken)
        start, end = properties["startid"], properties["endid"]
        assert start in graph, f"edge {number}: start {start} is no node"
        assert end in graph, f"edge {number}: end {end} is no node"
        cost = _number(properties.get("cost", 0.0))
        overridable = properties.get("overridable", True)
        assert isinstance(overridable, bool)
        assert cost > 0, f"edge {number} costs nothing"
        graph.add_edge(
            start,
            end,
            number,
            cost=cost,
            overridable=overridable,
            metadata=_metadata(properties),
            operations=_operations(properties),
            line=edge["geometry"].get("coordinates"),
        )
    return graph


def _refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")


def _id(value: Any, taken: set[int]) -> int:
    assert type(value) is int
    assert 0 <= value <= 65535, f"{value} does not fit uint16"
    assert value not in taken, f"{value} is taken"
    taken.add(value)
    return value


def _number(value: Any) -> float:
    assert isinstance(value, int | float)
    assert not isinstance(value, bool)
    return float(value)


def _operations(properties: dict[str, Any]) -> dict[str, Any]:
    operations = properties.get("operations", {})
    assert isinstance(operations, dict)
    for operation in operations.values():
        assert isinstance(operation["type"], str)
        assert operation["trigger"] in TRIGGERS
        _metadata(operation)
    return operations


def _metadata(holder: dict[str, Any]) -> dict[str, Any]:
    metadata = holder.get("metadata", {})
    _check(metadata)
    return metadata


def _check(metadata: Any) -> None:
    assert isinstance(metadata, dict)
    for key, value in metadata.items():
        if isinstance(value, dict):
            _check(value)
            continue
        for primitive in value if isinstance(value, list) else [value]:
            assert isinstance(primitive, bool | int | float | str), f"{key} is {primitive!r}"
        if key in REALS:
            assert isinstance(value, float), f"getValue<float> throws for {key}"
