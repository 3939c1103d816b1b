"""Route graphs for Nav2's route server (GeoJSON, `nav2_route`).

The server's loader and planner need ids that are unique over nodes and edges and fit uint16, costs
above zero, metadata without nulls, and real numbers written as such (the loader takes an integer
for another type, and `getValue<float>` fails on it).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from navgrid.grid import file_name, frame_name
from planner.exchange.route_graph import (
    BuildingOutline,
    ExchangeError,
    Move,
    RouteGraph,
    RouteNode,
    around_corners,
    route_graph,
)
from planner.routing_graph import RoutingGraph
from planner.topology import PlaceConnector, Topology
from semmap.whole_file import write_whole

MOST_IDS = 65_535  # the largest id of a node or an edge: messages store them as uint16
LEAST_COST = 1e-3  # seconds; the planner throws for an edge without cost
ROUTE_FRAME = "map"  # the frame of a topology without storeys and without a name

NO_OPERATION = ("pass_door", "drive_through")
"""Behaviours that need no operation if the connector is open."""


def nav2_graph(
    routing: RoutingGraph,
    *,
    storey: str | None = None,
    building: BuildingOutline | None = None,
    name: str | None = None,
) -> dict[str, Any]:
    """The route graph of a building or of one storey as a GeoJSON object.

    The `cost` of an edge is its time in seconds. The server's scorers may override it, except for
    rides, whose ends lie above each other; `abs_time_taken` is the time for Nav2's TimeScorer.
    Blocked edges are left out. Doors have ``open_door``, as they may be shut when the robot comes;
    a ride is ``call_elevator``, ``use_elevator`` and ``switch_map``.

    With the outlines of a `building`, travel leads around their corners, over additional nodes;
    else it is straight, even through a wall. Frames are ``map_STOREY``, as in the parameters that
    `navgrid.nav2.write_nav2` writes. `name`, of the map, is also the storey of a map without
    storeys. Raises ExchangeError: the storey is unknown, has no edges, or needs more ids than there
    are.
    """
    made = route_graph(routing, storey=storey, storeyless=name or ROUTE_FRAME)
    if building is not None:
        made = around_corners(made, building.outlines, routing.robot)
    topology = routing.topology
    what = f"storey {storey}" if storey is not None else "the building"
    if not made.moves:
        raise ExchangeError(
            f"{what} has no edge between two poses, and Nav2 refuses a graph without edges; "
            "add connectors that join its rooms"
        )
    count = len(made.nodes) + len(made.moves)
    if count > MOST_IDS:
        place, doors = made.busiest()
        raise _TooManyError(
            f"{what} needs {count:,} ids and Nav2 has {MOST_IDS:,}; its largest place is {place} "
            f"with {doors} connectors: write one file for each storey, or divide such places "
            "into rooms"
        )
    frame_of = {s: s if s == ROUTE_FRAME else frame_name(s) for s in made.storeys}
    served = {e: _storeys_of(topology, cabins) for e, cabins in topology.cabins().items()}
    features = [
        _node(number, node, frame_of[node.storey], served if storey is not None else {})
        for number, node in enumerate(made.nodes, 1)
    ]
    features += [
        _edge(number, move, made, frame_of)
        for number, move in enumerate(made.moves, len(made.nodes) + 1)
    ]
    return {"type": "FeatureCollection", "name": name or "graph", "features": features}


def nav2_graphs(routing: RoutingGraph, **options: Any) -> dict[str | None, dict[str, Any]]:
    """One graph of the whole building, by None; one for each storey if there are too few ids.

    Raises ExchangeError if one storey alone needs more ids than there are.
    """
    try:
        return {None: nav2_graph(routing, **options)}
    except _TooManyError:
        storeys = routing.topology.storeys()
        if options.get("storey") is not None or len(storeys) < 2:
            raise
    return {storey: nav2_graph(routing, storey=storey, **options) for storey in storeys}


def write_nav2(routing: RoutingGraph, path: Path | str, **options: Any) -> list[Path]:
    """Write the graph, or one file for each storey if there are too few ids; returns the files.

    The options are those of `nav2_graph`. If a graph cannot be made, nothing is written.
    """
    path = Path(path)
    written = []
    for storey, graph in nav2_graphs(routing, **options).items():
        own = path if storey is None else path.with_name(f"{path.stem}.{file_name(storey)}.geojson")
        own.parent.mkdir(parents=True, exist_ok=True)
        write_whole(own, dumps(graph))
        written.append(own)
    return written


def dumps(graph: Mapping[str, Any]) -> str:
    """The graph as text, one feature on each line, so that files can be compared."""
    head = {k: v for k, v in graph.items() if k != "features"}
    lines = ",\n".join(json.dumps(f, allow_nan=False) for f in graph["features"])
    return f'{json.dumps(head)[:-1]}, "features": [\n{lines}\n]}}\n'


class _TooManyError(ExchangeError):
    pass


def _storeys_of(topology: Topology, cabins: list[str]) -> list[str]:
    return [s for cabin in cabins if (s := topology.places[cabin].storey) is not None]


def _node(
    number: int, node: RouteNode, frame: str, served: Mapping[str, list[str]]
) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "id": number,
        "frame": frame,
        "metadata": _without_nulls(
            name=node.name, place=node.place, storey=node.storey, elevator=node.elevator
        ),
    }
    if node.connector is not None and node.yaw is not None:
        about = {"connector": node.connector.name, "side": node.side, "yaw": _real(node.yaw)}
        properties["metadata"] |= about
    if node.elevator is not None and node.elevator in served:
        properties["operations"] = {
            "switch_map": _operation(
                "switch_map", "NODE", elevator=node.elevator, storeys=served[node.elevator]
            )
        }
    geometry = {"type": "Point", "coordinates": _coordinates(node)}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _edge(number: int, move: Move, made: RouteGraph, frame_of: Mapping[str, str]) -> dict[str, Any]:
    start, end = made.nodes[move.start], made.nodes[move.end]
    seconds = _real(max(move.seconds, LEAST_COST))
    properties: dict[str, Any] = {
        "id": number,
        "startid": move.start + 1,
        "endid": move.end + 1,
        "cost": seconds,
        "overridable": move.kind != "ride",
        "metadata": _without_nulls(
            kind=move.kind,
            abs_time_taken=seconds,
            elevator=move.elevator,
            **({"place": start.place} if move.kind == "walk" else {}),
        ),
    }
    connector = move.connector
    if connector is not None:
        properties["metadata"] |= _without_nulls(
            connector=connector.name,
            type=connector.type,
            state=connector.state,
            behaviour=connector.behaviour,
            width=None if connector.width is None else _real(connector.width),
        )
    operations = _operations(move, start, end, frame_of)
    if operations:
        properties["operations"] = operations
    line = {"type": "LineString", "coordinates": [_coordinates(start), _coordinates(end)]}
    return {"type": "Feature", "properties": properties, "geometry": line}


def _operations(
    move: Move,
    start: RouteNode,
    end: RouteNode,
    frame_of: Mapping[str, str],
) -> dict[str, Any]:
    """The operations of a move, with their triggers."""
    found: dict[str, Any] = {}

    def add(kind: str, trigger: str = "ON_ENTER", **about: Any) -> None:
        found[kind] = _operation(kind, trigger, **about)

    if move.kind == "ride":
        storeys = {"from_storey": start.storey, "to_storey": end.storey}
        add("use_elevator", elevator=move.elevator, **storeys)
        add("switch_map", "ON_EXIT", storey=end.storey, frame=frame_of[end.storey])
    connector = move.connector
    if connector is not None and start.connector is not None:  # not again at each bend
        name = connector.name
        if move.elevator is not None:
            add("call_elevator", elevator=move.elevator, connector=name, storey=start.storey)
        elif start.elevator is None and _may_be_shut(connector):
            add("open_door", connector=name, state=connector.state)
        if connector.behaviour not in (*NO_OPERATION, "call_elevator"):
            add(connector.behaviour, connector=name)
    return found


def _may_be_shut(connector: PlaceConnector) -> bool:
    """Whether the robot may find it shut, although it is open now: a door, not an opening."""
    is_door = connector.type == "door" and connector.behaviour == "pass_door"
    return is_door or connector.state != "open"


def _operation(kind: str, trigger: str, **about: Any) -> dict[str, Any]:
    return {"type": kind, "trigger": trigger, "metadata": _without_nulls(**about)}


def _without_nulls(**values: Any) -> dict[str, Any]:
    """The values that are not None: the loader throws on null."""
    return {key: value for key, value in values.items() if value is not None}


def _real(value: float) -> float:
    return round(float(value), 4)


def _coordinates(node: RouteNode) -> list[float]:
    return [_real(v) for v in node.point]
