"""Route graphs as Nav2's route server reads them (GeoJSON, `nav2_route`).

Nodes are the stands, in a frame a storey; edges are walks, passages and rides, each in one
direction. What the server's loader and planner take for granted is kept: ids are unique over nodes
and edges and fit uint16, costs are above zero, metadata has no nulls, real numbers are written
as such (an integer is another type to the loader, and `getValue<float>` fails on it).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from navgrid.map_file import file_name
from navgrid.nav2 import frame_name
from planner.exchange.stands import (
    ExchangeError,
    Move,
    Stand,
    Stands,
    Waypoint,
    around_corners,
    stands_of,
)
from planner.exchange.surroundings import Surroundings
from planner.network import Network
from planner.topology import Topology

__all__ = ["MOST_IDS", "nav2_graph", "nav2_graphs", "write_nav2"]

MOST_IDS = 65_535
"""The largest id: messages hold them as uint16. Blocking edges goes by ids of nodes, too."""

LEAST_COST = 1e-3
"""Seconds; the planner throws for an edge that costs nothing."""

ROUTE_FRAME = "map"

NO_OPERATION = ("pass_door", "drive_through")
"""Behaviours that driving on is enough for, where the connector is open."""


def nav2_graph(
    network: Network,
    *,
    storey: str | None = None,
    surroundings: Surroundings | None = None,
    frames: Mapping[str, str] | None = None,
    name: str = "graph",
) -> dict[str, Any]:
    """The route graph of a building or of one storey as a GeoJSON object.

    An edge's `cost` is its time in seconds, which the server's scorers may override except for
    rides, whose ends lie above each other. `abs_time_taken` in the metadata says the time to Nav2's
    TimeScorer. Operations: ``open_door`` where a door is not open, ``call_elevator`` before a
    cabin is entered, ``use_elevator`` and then ``switch_map`` for a ride, else the connector's
    behaviour where it needs one; each names what it is about in its metadata.

    Parameters
    ----------
    network : travel times of the robot that drives; what bars it is no edge
    storey : only this one; its nodes in cabins then carry ``switch_map`` with the storeys served
    surroundings : outlines, around whose corners walks are led over nodes more; without, walks are
        straight, also where that is through a wall
    frames : the frame of each storey, by default ``map`` where there is one, else ``map_STOREY``

    Raises
    ------
    ExchangeError
        There is no such storey, it has no way, or it needs more ids than there are.
    """
    made = stands_of(network, storey=storey)
    if surroundings is not None:
        made = around_corners(made, surroundings.outlines, network.robot.speed)
    topology = network.topology
    what = f"storey {storey}" if storey is not None else "the building"
    if not made.moves:
        raise ExchangeError(
            f"{what} has no way between two poses, and Nav2 takes no graph without edges; "
            "add connectors that join its rooms"
        )
    count = len(made.stands) + len(made.moves)
    if count > MOST_IDS:
        place, doors = made.busiest()
        raise _TooManyError(
            f"{what} needs {count:,} ids and Nav2 has {MOST_IDS:,}; its largest place is {place} "
            f"with {doors} connectors: write one file a storey, or part such places into rooms"
        )
    frame_of = _frames(made.storeys, frames)
    served = {e: _storeys_of(topology, cabins) for e, cabins in topology.cabins().items()}
    features = [
        _node(number, stand, frame_of[stand.storey], served if storey is not None else {})
        for number, stand in enumerate(made.stands, 1)
    ]
    features += [
        _edge(number, move, made, frame_of)
        for number, move in enumerate(made.moves, len(made.stands) + 1)
    ]
    return {"type": "FeatureCollection", "name": name, "features": features}


def nav2_graphs(network: Network, **options: Any) -> dict[str | None, dict[str, Any]]:
    """One graph of the whole building under None; one a storey where ids do not suffice.

    Raises
    ------
    ExchangeError
        One storey alone needs more ids than there are.
    """
    try:
        return {None: nav2_graph(network, **options)}
    except _TooManyError:
        storeys = network.topology.storeys()
        if options.get("storey") is not None or len(storeys) < 2:
            raise
    return {storey: nav2_graph(network, storey=storey, **options) for storey in storeys}


def write_nav2(network: Network, path: Path | str, **options: Any) -> list[Path]:
    """Write the graph, or one file a storey where ids do not suffice; the files written.

    Nothing is written where a graph cannot be made (`nav2_graphs`, whose options these are).
    """
    path = Path(path)
    written = []
    for storey, graph in nav2_graphs(network, **options).items():
        own = path if storey is None else path.with_name(f"{path.stem}.{file_name(storey)}.geojson")
        own.parent.mkdir(parents=True, exist_ok=True)
        own.write_text(dumps(graph), encoding="utf-8")
        written.append(own)
    return written


def dumps(graph: Mapping[str, Any]) -> str:
    """The graph as text, a feature a line, so that changes show in a comparison of files."""
    head = {k: v for k, v in graph.items() if k != "features"}
    lines = ",\n".join(json.dumps(f, allow_nan=False) for f in graph["features"])
    return f'{json.dumps(head)[:-1]}, "features": [\n{lines}\n]}}\n'


class _TooManyError(ExchangeError):
    pass


def _frames(storeys: list[str], said: Mapping[str, str] | None) -> dict[str, str]:
    if said is None:
        alone = len(storeys) == 1
        return {storey: ROUTE_FRAME if alone else frame_name(storey) for storey in storeys}
    missing = [storey for storey in storeys if storey not in said]
    if missing:
        raise ExchangeError(f"there is no frame for {', '.join(missing)}; add it to frames")
    return {storey: said[storey] for storey in storeys}


def _storeys_of(topology: Topology, cabins: list[str]) -> list[str]:
    return [s for cabin in cabins if (s := topology.places[cabin].storey) is not None]


def _node(
    number: int, stand: Stand | Waypoint, frame: str, served: Mapping[str, list[str]]
) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "id": number,
        "frame": frame,
        "metadata": _said(
            name=stand.name, place=stand.place, storey=stand.storey, elevator=stand.elevator
        ),
    }
    if isinstance(stand, Stand):
        properties["metadata"] |= {
            "connector": stand.connector.name,
            "side": stand.side,
            "yaw": _real(stand.pose.yaw),
        }
    if stand.elevator is not None and stand.elevator in served:
        properties["operations"] = {
            "switch_map": _operation(
                "switch_map", "NODE", elevator=stand.elevator, storeys=served[stand.elevator]
            )
        }
    geometry = {"type": "Point", "coordinates": _coordinates(stand)}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _edge(number: int, move: Move, made: Stands, frame_of: Mapping[str, str]) -> dict[str, Any]:
    start, end = made.stands[move.start], made.stands[move.end]
    seconds = _real(max(move.seconds, LEAST_COST))
    properties: dict[str, Any] = {
        "id": number,
        "startid": move.start + 1,
        "endid": move.end + 1,
        "cost": seconds,
        "overridable": move.kind != "ride",
        "metadata": _said(
            kind=move.kind, abs_time_taken=seconds, elevator=move.elevator,
            **({"place": start.place} if move.kind == "walk" else {}),
        ),
    }  # fmt: skip
    connector = move.connector
    if connector is not None:
        properties["metadata"] |= _said(
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
    move: Move, start: Stand | Waypoint, end: Stand | Waypoint, frame_of: Mapping[str, str]
) -> dict[str, Any]:
    """What the robot does beside driving; the trigger says when."""
    found: dict[str, Any] = {}
    if move.kind == "ride":
        found["use_elevator"] = _operation(
            "use_elevator", "ON_ENTER", elevator=move.elevator,
            from_storey=start.storey, to_storey=end.storey,
        )  # fmt: skip
        found["switch_map"] = _operation(
            "switch_map", "ON_EXIT", storey=end.storey, frame=frame_of[end.storey]
        )
    connector = move.connector
    if connector is not None:
        if move.elevator is not None:
            found["call_elevator"] = _operation(
                "call_elevator", "ON_ENTER", elevator=move.elevator, connector=connector.name,
                storey=start.storey,
            )  # fmt: skip
        elif connector.state != "open" and start.elevator is None:
            found["open_door"] = _operation(
                "open_door", "ON_ENTER", connector=connector.name, state=connector.state
            )
        if connector.behaviour not in (*NO_OPERATION, "call_elevator"):
            found[connector.behaviour] = _operation(
                connector.behaviour, "ON_ENTER", connector=connector.name
            )
    return found


def _operation(kind: str, trigger: str, **about: Any) -> dict[str, Any]:
    return {"type": kind, "trigger": trigger, "metadata": _said(**about)}


def _said(**values: Any) -> dict[str, Any]:
    """Without what is None: the loader throws on null."""
    return {key: value for key, value in values.items() if value is not None}


def _real(value: float) -> float:
    return round(float(value), 4)


def _coordinates(stand: Stand | Waypoint) -> list[float]:
    return [_real(v) for v in stand.point]
