"""Navigation graphs of Open-RMF (YAML), as `rmf_building_map_tools` writes them.

The approach poses in a cabin become one vertex with the name of its `lift`, at the same spot on
each level, as the fleet adapter requires; it joins the levels by itself. Each place has a vertex of
its name, to which tasks go.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import shapely
import yaml

from planner.exchange.route_graph import (
    BuildingOutline,
    Cabin,
    DrawnLane,
    ExchangeError,
    Move,
    RouteGraph,
    RouteNode,
    around_corners,
    route_graph,
    with_middles,
    with_waypoints,
)
from planner.routing_graph import RoutingGraph
from planner.topology import PlaceConnector
from semmap.whole_file import write_whole

REVERSED = {"forward": "backward", "backward": "forward"}
"""The orientation of a lane in the other direction."""

CABIN = 1.5  # width and depth of a cabin without outline, metres


def rmf_nav_graph(
    routing: RoutingGraph,
    *,
    name: str = "building",
    building: BuildingOutline | None = None,
    storey: str | None = None,
) -> dict[str, Any]:
    """The navigation graph of a building, or of one storey, as plain values.

    Lanes are travel and passages that the robot of the routing graph can use, and drawn lanes.
    Connections between levels other than lifts (stairs) are left out. A door is a connector whose
    behaviour is ``pass_door``. The vertex of a place lies in the outline that `building` has, and
    lanes lead around its corners. Raises ExchangeError: the storey is unknown, or there is no lane.
    """
    building = building or BuildingOutline()
    speed = routing.robot.speed
    made = route_graph(routing, storey=storey)
    made = with_waypoints(made, routing.topology, building.lanes, speed)
    made = with_middles(made, building.outlines, speed)
    made = around_corners(made, building.outlines, routing.robot)
    levels: dict[str, _Level] = {s: _Level() for s in made.storeys}
    lifts = _lifts(made.nodes, building)
    at: list[tuple[str, int]] = []
    for node in made.nodes:
        level = levels[node.storey]
        if node.elevator is None:
            vertex = level.vertex(node.point, node.name, **node.params)
        else:
            cabin = lifts[node.elevator]
            vertex = level.vertex(
                (cabin.x, cabin.y), f"{node.elevator}@{node.storey}", lift=node.elevator
            )
        at.append((node.storey, vertex))
    doors = {
        s.connector.name: {
            "endpoints": [[_real(x), _real(y)] for x, y in s.connector.leaf().coords],
            "map": s.storey,
        }
        for s in made.nodes
        if s.connector is not None and _is_door(s.connector)
    }
    for move in made.moves:
        (here, a), (there, b) = at[move.start], at[move.end]
        if move.kind == "ride" or a == b or here != there:
            continue
        door = move.connector is not None and _is_door(move.connector) and _opens(move, made)
        levels[here].lane(a, b, **({"door_name": move.connector.name} if door else {}))  # type: ignore[union-attr]
    _add_drawn_lanes(levels, building.lanes, made, at, doors)
    if not any(level.lanes for level in levels.values()):
        raise ExchangeError("no connector joins two places; add connectors that join the rooms")
    return {
        "building_name": name,
        "doors": doors,
        "levels": {
            s: {"lanes": level.lanes, "vertices": level.vertices} for s, level in levels.items()
        },
        "lifts": {
            lift: {
                "dims": [_real(c.width), _real(c.depth)],
                "position": [_real(c.x), _real(c.y), _real(c.yaw)],
            }
            for lift, c in lifts.items()
        },
    }


def write_rmf_nav(routing: RoutingGraph, path: Path | str, **options: Any) -> Path:
    """Write the graph; the options are those of `rmf_nav_graph`."""
    graph = rmf_nav_graph(routing, **options)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, yaml.safe_dump(graph, allow_unicode=True, default_flow_style=None))
    return path


def _add_drawn_lanes(
    levels: Mapping[str, _Level],
    lanes: Sequence[DrawnLane],
    made: RouteGraph,
    at: Sequence[tuple[str, int]],
    doors: Mapping[str, Mapping[str, Any]],
) -> None:
    """Add the lanes that the building's file has, with their properties, in each direction.

    A lane through a door that the robot cannot pass, as a locked one, is left out.
    """
    passed = {move.connector.name for move in made.moves if move.connector is not None}
    found = {n.region: at[i] for i, n in enumerate(made.nodes) if n.region}
    shut = {
        storey: {
            name: shapely.LineString(door["endpoints"])
            for name, door in doors.items()
            if door["map"] == storey
        }
        for storey in levels
    }
    for lane in lanes:
        (here, a), (there, b) = (found.get(end, ("", -1)) for end in (lane.start, lane.end))
        if here != there or a == b:
            continue
        level, given = levels[here], lane.properties
        line = shapely.LineString([level.vertices[n][:2] for n in (a, b)])
        params = {key: given[key] for key in ("speed_limit", "mutex") if given.get(key)}
        crossed = [name for name, door in shut[here].items() if door.intersects(line)]
        if not passed.issuperset(crossed):
            continue
        if crossed:
            params["door_name"] = crossed[0]
        ways = [(a, b, given.get("orientation"))]
        if given.get("bidirectional", True):
            ways.append((b, a, REVERSED.get(str(given.get("orientation")))))
        for start, end, heading in ways:
            own = {**params, **({"orientation_constraint": heading} if heading else {})}
            for key, vertex in (("dock_name", end), ("undock_name", start)):
                dock = level.vertices[vertex][2].get("dock_name")
                if dock:
                    own[key] = dock
            level.lane(start, end, **own)


class _Level:
    """Vertices and lanes of a storey; of two lanes between the same vertices the last counts."""

    def __init__(self) -> None:
        self.vertices: list[list[Any]] = []
        self.lanes: list[list[Any]] = []
        self.numbers: dict[str, int] = {}
        self.drawn: dict[tuple[int, int], int] = {}

    def vertex(self, point: tuple[float, ...], name: str, **params: Any) -> int:
        """The number of the vertex of a name, which is added if it is missing."""
        if name not in self.numbers:
            self.numbers[name] = len(self.vertices)
            self.vertices.append([_real(point[0]), _real(point[1]), {"name": name, **params}])
        return self.numbers[name]

    def lane(self, start: int, end: int, **params: Any) -> None:
        number = self.drawn.setdefault((start, end), len(self.lanes))
        self.lanes[number : number + 1] = [[start, end, params]]


def _is_door(connector: PlaceConnector) -> bool:
    return connector.type == "door" and connector.behaviour == "pass_door"


def _opens(move: Move, made: RouteGraph) -> bool:
    """Whether a passage needs the door: the whole of it, or a piece of it at the leaf."""
    ends = [made.nodes[n] for n in (move.start, move.end)]
    assert move.connector is not None
    if all(node.connector is not None for node in ends):
        return True
    line = shapely.LineString([node.point[:2] for node in ends])
    return bool(move.connector.leaf().intersects(line))


def _lifts(nodes: tuple[RouteNode, ...], building: BuildingOutline) -> dict[str, Cabin]:
    """The cabins; without an outline, at the mean of their approach poses."""
    inside: dict[str, list[RouteNode]] = {}
    for node in nodes:
        if node.connector is not None and node.elevator is not None:
            inside.setdefault(node.elevator, []).append(node)
    lifts = {}
    for lift, own in inside.items():
        x, y, _ = (sum(axis) / len(own) for axis in zip(*(n.point for n in own), strict=True))
        mean = Cabin(x, y, own[0].yaw or 0.0, CABIN, CABIN)
        lifts[lift] = building.cabins.get(lift) or mean
    return lifts


def _real(value: float) -> float:
    return round(float(value), 4)
