"""A map as the message of a building of Open-RMF: walls, doors, lifts and a navigation graph."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from planner.exchange.reader import read_building_outline
from planner.exchange.rmf_nav import rmf_nav_graph
from planner.exchange.route_graph import ExchangeError
from semmap.export.features import read_map
from semmap.export.rmf_building import rmf_building
from semmap.geometry.pose import Pose
from semmap_ros.optional import interface

if TYPE_CHECKING:
    import semmap
    from semmap_ros.node import MapNode

BuildingMap, Level, Lift, Door, Graph, GraphNode, GraphEdge, Param, Place = (
    interface(f"rmf_building_map_msgs/msg/{name}")
    for name in (
        *("BuildingMap", "Level", "Lift", "Door", "Graph"),
        *("GraphNode", "GraphEdge", "Param", "Place"),
    )
)

DOOR_TYPES = {
    "sliding": 1,
    "double_sliding": 2,
    "telescope": 3,
    "double_telescope": 4,
    "hinged": 5,
    "double_hinged": 6,
}
"""The numbers of the types of doors of the traffic editor; of another it is 0."""

VALUES = {str: (1, "value_string"), int: (2, "value_int"), float: (3, "value_float")}
"""The number and the field of a parameter by the type of its value."""


def read_building_map(node: MapNode, map: semmap.Map) -> Any:
    """Return the message of a map; None without its package.

    Its navigation graph has what the node's robot can pass now, so that a door that is locked is
    not in it; a map without connectors has none.
    """
    if BuildingMap is None:
        return None
    with map.snapshot() as seen:
        building, outline = rmf_building(read_map(seen)), read_building_outline(seen)
    try:
        routing = map.routing_graph(node.value("robot") or None)
        ways = rmf_nav_graph(routing, name=map.name, building=outline)["levels"]
    except ExchangeError:
        ways = {}
    return BuildingMap(
        name=building["name"],
        levels=[_level(name, level, ways) for name, level in building["levels"].items()],
        lifts=[_lift(*each) for each in building["lifts"].items()],
    )


def _level(name: str, level: Mapping[str, Any], ways: Mapping[str, Any]) -> Any:
    vertices = [(x, y, word, *rest) for x, y, _, word, *rest in level["vertices"]]
    graphs = []
    if name in ways:
        points = [
            (x, y, about["name"], {k: v for k, v in about.items() if k != "name"})
            for x, y, about in ways[name]["vertices"]
        ]
        graphs = [_graph("0", points, ways[name]["lanes"], directed=True)]
    walls: list[Any] = [(a, b, {}) for a, b, _ in level["walls"]]
    doors = []
    for a, b, params in level["doors"]:
        about = {key: value for key, (_, value) in params.items()}
        doors.append(
            Door(
                **_ends(vertices[a], vertices[b]),
                name=about["name"],
                door_type=DOOR_TYPES.get(about["type"], 0),
                motion_range=float(about["motion_degrees"]),
                motion_direction=int(about["motion_direction"]),
            )
        )
    return Level(
        name=name,
        elevation=float(level["elevation"]),
        places=[Place(name=word, x=x, y=y) for x, y, word, *_ in vertices if word],
        doors=doors,
        nav_graphs=graphs,
        wall_graph=_graph("walls", [(x, y, word, {}) for x, y, word, *_ in vertices], walls),
    )


def _lift(name: str, lift: Mapping[str, Any]) -> Any:
    frame = Pose.planar(lift["x"], lift["y"], lift["yaw"])
    x, y = lift["width"] / 2, lift["depth"] / 2
    corners = _placed(frame, [(x, y), (-x, y), (-x, -y), (x, -y)])
    doors = []
    for own, door in lift["doors"].items():
        half, turn = door["width"] / 2, door["motion_axis_orientation"]
        along = half * math.cos(turn), half * math.sin(turn)
        ends = [(door["x"] + side * along[0], door["y"] + side * along[1]) for side in (-1, 1)]
        doors.append(Door(**_ends(*_placed(frame, ends)), name=own, door_type=door["door_type"]))
    around: list[Any] = [(a, b, {}) for a, b in pairwise([0, 1, 2, 3, 0])]
    return Lift(
        name=name,
        levels=[level for level, own in lift["level_doors"].items() if own],
        doors=doors,
        wall_graph=_graph("walls", [(*point, "", {}) for point in corners], around),
        **{f"ref_{key}": lift[key] for key in ("x", "y", "yaw")},
        width=lift["width"],
        depth=lift["depth"],
    )


def _placed(frame: Pose, points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(x, y) for x, y, _ in frame.apply([(*point, 0.0) for point in points]).tolist()]


def _ends(start: Sequence[Any], end: Sequence[Any]) -> dict[str, float]:
    return {"v1_x": start[0], "v1_y": start[1], "v2_x": end[0], "v2_y": end[1]}


def _graph(name: str, vertices: Iterable[Any], edges: Iterable[Any], directed: bool = False) -> Any:
    return Graph(
        name=name,
        vertices=[
            GraphNode(x=x, y=y, name=word, params=_params(about)) for x, y, word, about in vertices
        ],
        edges=[
            GraphEdge(v1_idx=a, v2_idx=b, params=_params(about), edge_type=int(directed))
            for a, b, about in edges
        ],
    )


def _params(about: Mapping[str, Any]) -> list[Any]:
    found = []
    for name, value in about.items():
        if isinstance(value, bool):
            found.append(Param(name=name, type=4, value_bool=value))
        elif type(value) in VALUES:
            kind, field = VALUES[type(value)]
            found.append(Param(name=name, type=kind, **{field: value}))
    return found
