"""Navigation graphs of Open-RMF (YAML), as `rmf_building_map_tools` writes them.

A level a storey, with vertices ``[x, y, {name, ...}]`` and lanes ``[from, to, {...}]``, each in one
direction. A lane through a door has its `door_name`. The stands in a cabin become one vertex with
the name of its `lift`, at the same spot on each level, as the fleet adapter asks; it joins the
levels itself. Each place has a vertex of its own name, which is what tasks go to.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from planner.exchange.stands import (
    ExchangeError,
    Stand,
    Waypoint,
    around_corners,
    stands_of,
    with_middles,
)
from planner.exchange.surroundings import Cabin, Surroundings
from planner.network import Network
from planner.topology import Connector

__all__ = ["rmf_nav_graph", "write_rmf_nav"]

LEAF = 0.9
"""Width of a door that says none, metres."""

CABIN = 1.5
"""Width and depth of a cabin of which nothing is known, metres."""


def rmf_nav_graph(
    network: Network,
    *,
    name: str = "building",
    surroundings: Surroundings | None = None,
    storey: str | None = None,
) -> dict[str, Any]:
    """The navigation graph of a building as plain values.

    Lanes are the walks in places and the passages that the network's robot may make; ways between
    levels other than lifts (stairs) are none. A door is where the behaviour is ``pass_door``.

    Parameters
    ----------
    name : of the building
    surroundings : outlines, within which a place's vertex lies and around whose corners lanes lead,
        and cabins
    storey : only this one

    Raises
    ------
    ExchangeError
        There is no such storey, or there is no lane.
    """
    surroundings = surroundings or Surroundings()
    speed = network.robot.speed
    made = with_middles(stands_of(network, storey=storey), surroundings.outlines, speed)
    made = around_corners(made, surroundings.outlines, speed)
    levels: dict[str, _Level] = {s: _Level() for s in made.storeys}
    lifts = _lifts(made.stands, surroundings)
    at: list[tuple[str, int]] = []
    for stand in made.stands:
        level = levels[stand.storey]
        if stand.elevator is None:
            vertex = level.vertex(stand.point, stand.name)
        else:
            cabin = lifts[stand.elevator]
            vertex = level.vertex(
                (cabin.x, cabin.y), f"{stand.elevator}@{stand.storey}", lift=stand.elevator
            )
        at.append((stand.storey, vertex))
    for move in made.moves:
        (here, a), (there, b) = at[move.start], at[move.end]
        if move.kind == "ride" or a == b or here != there:
            continue
        door = move.connector is not None and _is_door(move.connector)
        levels[here].lane(a, b, **({"door_name": move.connector.name} if door else {}))  # type: ignore[union-attr]
    if not any(level.lanes for level in levels.values()):
        raise ExchangeError("no connector joins two places; add connectors that join the rooms")
    return {
        "building_name": name,
        "doors": {
            s.connector.name: _door(s.connector, s.storey)
            for s in made.stands
            if isinstance(s, Stand) and _is_door(s.connector)
        },
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


def write_rmf_nav(network: Network, path: Path | str, **options: Any) -> Path:
    """Write the graph of `rmf_nav_graph`, whose options these are."""
    graph = rmf_nav_graph(network, **options)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(graph, allow_unicode=True, default_flow_style=None), "utf-8")
    return path


class _Level:
    def __init__(self) -> None:
        self.vertices: list[list[Any]] = []
        self.lanes: list[list[Any]] = []
        self.numbers: dict[str, int] = {}
        self.drawn: set[tuple[int, int]] = set()

    def vertex(self, point: tuple[float, ...], name: str, **params: Any) -> int:
        """The number of the vertex of that name, made where it is not there."""
        if name not in self.numbers:
            self.numbers[name] = len(self.vertices)
            self.vertices.append([_real(point[0]), _real(point[1]), {"name": name, **params}])
        return self.numbers[name]

    def lane(self, start: int, end: int, **params: Any) -> None:
        if (start, end) not in self.drawn:
            self.drawn.add((start, end))
            self.lanes.append([start, end, params])


def _is_door(connector: Connector) -> bool:
    return connector.type == "door" and connector.behaviour == "pass_door"


def _door(connector: Connector, storey: str) -> dict[str, Any]:
    """The ends of its leaf: across the line between its two poses, at the middle of that."""
    (a, b), half = connector.poses, (connector.width or LEAF) / 2
    x, y, yaw = (a.x + b.x) / 2, (a.y + b.y) / 2, a.yaw
    dx, dy = -half * math.sin(yaw), half * math.cos(yaw)
    ends = [[_real(x + dx), _real(y + dy)], [_real(x - dx), _real(y - dy)]]
    return {"endpoints": ends, "map": storey}


def _lifts(stands: tuple[Stand | Waypoint, ...], surroundings: Surroundings) -> dict[str, Cabin]:
    """The cabins; of one that the map does not draw, the middle of its stands."""
    inside: dict[str, list[Stand]] = {}
    for stand in stands:
        if isinstance(stand, Stand) and stand.elevator is not None:
            inside.setdefault(stand.elevator, []).append(stand)
    return {
        lift: surroundings.cabins.get(lift)
        or Cabin(
            sum(s.pose.x for s in own) / len(own),
            sum(s.pose.y for s in own) / len(own),
            own[0].pose.yaw,
            CABIN,
            CABIN,
        )
        for lift, own in inside.items()
    }


def _real(value: float) -> float:
    return round(float(value), 4)
