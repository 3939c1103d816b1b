"""The topology over the floor plan of a storey, as PNG."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from planner.exchange.dot import STATES
from planner.exchange.route_graph import middle_of
from planner.exchange.visibility_graph import corner_paths
from planner.topology import OUTSIDE, PlaceConnector, Topology
from semmap.draw.floor_plan import floor_plan
from semmap.draw.view import RoomView, StoreyView

Point = tuple[float, float]

PLACE, ELEVATOR = "#2b2f36", "#7d5fb2"


def topology_plan(
    topology: Topology, storey: StoreyView, path: Path | str, *, title: str = "", dpi: int = 200
) -> Path:
    """Draw the topology of a storey over its floor plan; returns the file.

    A dot in each room, and a line from it to each of its connectors in the colour of their state.
    One-way connectors have an arrow. A label at a cabin names the storeys that the elevator serves.
    """
    at = {room.name: middle_of(room.outline) for room in storey.rooms}
    ways = {room.name: _ways(topology, room, at[room.name]) for room in storey.rooms}
    bare = replace(storey, objects=[], regions=[], path=[])
    joined = [c for c in topology.connectors.values() if at.keys() & set(c.places)]

    def over(axes: Axes) -> None:
        for connector in joined:
            _lines(axes, connector, at, ways)
        for name, (x, y) in at.items():
            elevator = topology.places[name].elevator if name in topology.places else None
            axes.plot(
                x,
                y,
                "s" if elevator else "o",
                ms=7,
                zorder=7,
                mec="white",
                mew=1.2,
                mfc=ELEVATOR if elevator else PLACE,
            )
            if elevator:
                _served(axes, topology, elevator, storey.name, x, y)

    return floor_plan(bare, path, title=title or f"{storey.name}: topology", dpi=dpi, over=over)


def _ways(topology: Topology, room: RoomView, middle: Point) -> dict[tuple[str, int], list[Point]]:
    """Lines from the middle of a room to its approach poses, by name and side of the connector."""
    doors = topology.connectors_of(room.name)
    poses = [(c.poses[side].x, c.poses[side].y) for c, side in doors]
    ways = corner_paths(room.outline, np.array([middle, *poses]))
    return {
        (c.name, side): [
            middle,
            *((float(x), float(y)) for x, y in ways.corners[ways.between.get((0, number), [])]),
            pose,
        ]
        for number, ((c, side), pose) in enumerate(zip(doors, poses, strict=True), 1)
    }


def _lines(
    axes: Axes,
    connector: PlaceConnector,
    at: Mapping[str, Point],
    ways: Mapping[str, Mapping[tuple[str, int], list[Point]]],
) -> None:
    """Draw the lines from a connector to its places on this storey."""
    sides = [
        ways[place][connector.name, side]
        for side, place in enumerate(connector.places)
        if place in at
    ]
    if len(sides) == 2:
        line = [*sides[0], *reversed(sides[1])]
    elif OUTSIDE in connector.places:
        line = [*sides[0], (connector.poses[1].x, connector.poses[1].y)]
    else:
        line = sides[0]
    colour = STATES[connector.state]
    x, y = zip(*line, strict=True)
    style = "--" if connector.state == "locked" else "-"
    axes.plot(x, y, style, color="white", lw=3.4, alpha=0.8, zorder=6)
    axes.plot(x, y, style, color=colour, lw=1.7, zorder=6.1, solid_capstyle="round")
    if connector.direction != "both" and len(line) > 2:
        a, b = ((p.x, p.y) for p in connector.poses)
        if connector.direction == "backward":
            a, b = b, a
        arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.7, "mutation_scale": 16}
        axes.annotate("", b, a, zorder=6.2, arrowprops=arrow)


def _served(axes: Axes, topology: Topology, elevator: str, here: str, x: float, y: float) -> None:
    cabins = topology.cabins()[elevator]
    others = [s for c in cabins if (s := topology.places[c].storey) is not None and s != here]
    if others:
        axes.annotate(
            f"{elevator}: to {', '.join(others)}",
            (x, y),
            (0, -13),
            zorder=8,
            fontsize=6.5,
            textcoords="offset points",
            ha="center",
            va="top",
            color=ELEVATOR,
            weight="bold",
            bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8},
        )
