"""`semmap topology`: the topology for Nav2, Open-RMF and Graphviz, as a picture, as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import typer
from typer import Option

from semmap import cli
from semmap.api.map_drawing import TopologyFormat, topology_as_json, topology_format
from semmap.cli.options import Storey


def topology_command(
    file: Path | None = Option(None, "--output", "-o", help="File; else DOT and JSON are printed."),
    format_: TopologyFormat | None = Option(
        None, "--format", help="By default the format of the file's ending, or dot."
    ),
    map_name: cli.MapName = None,
    storey: Storey = None,
    robot: str | None = Option(
        None, help="Class of robots whose paths and times are used, not straight lines."
    ),
    locked: bool = Option(False, "--locked", help="The robot unlocks doors."),
    speed: float = Option(0.5, help="Metres a second, without --robot."),
    json_: cli.Json = False,
) -> None:
    """Write the topology: a route graph for Nav2 or Open-RMF, DOT, a picture or JSON."""
    from planner.exchange.dot import dot

    chosen = _format(file, format_, json_)
    options: Any = {"robot": robot, "unlocks": locked, "speed": speed}
    with cli.chosen_map(map_name) as house:
        if file is not None:
            written = house.write_topology(file, format=chosen, storey=storey, **options)
        elif chosen is TopologyFormat.dot:
            graph = house.routing_graph(**options)
            print(dot(graph.topology, storey=storey, name=house.name).rstrip("\n"))
            return
        else:
            topology = house.routing_graph(**options).topology
            print(json.dumps(topology_as_json(topology, storey)))
            return
    if json_ and chosen is not TopologyFormat.json:
        print(json.dumps([str(path) for path in written]))
    else:
        for path in written:
            cli.out.print(str(path))


def _format(file: Path | None, given: TopologyFormat | None, as_json: bool) -> TopologyFormat:
    if file is not None:
        try:
            return topology_format(file, given)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
    if given is None:
        return TopologyFormat.json if as_json else TopologyFormat.dot
    if given not in (TopologyFormat.dot, TopologyFormat.json):
        raise typer.BadParameter(f"--format {given} is written to a file: give -o FILE")
    return given
