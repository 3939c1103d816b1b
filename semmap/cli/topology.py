"""`semmap topology`: the topology for Nav2, Open-RMF and Graphviz, as a picture, as JSON."""

from __future__ import annotations

import json

import typer

from semmap.api.map_drawing import topology_as_json
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json


@command_of("Map.write_topology", file="[--output -o]", unlocks="--locked")
def topology_command(call: MethodCall, json_: Json = False) -> None:
    """Write the topology: a route graph for Nav2 or Open-RMF, DOT, a picture or JSON.

    Without a file, DOT and JSON are printed.
    """
    if "file" in call.values:
        written = [str(path) for path in call()]
        print(json.dumps(written) if json_ else "\n".join(written))
        return
    format_ = call.values.pop("format", "json" if json_ else "dot")
    if format_ not in ("dot", "json"):
        raise typer.BadParameter(f"--format {format_} is written to a file: give -o FILE")
    storey = call.values.pop("storey", None)
    topology = call.handle.routing_graph(**call.values).topology
    if format_ == "json":
        print(json.dumps(topology_as_json(topology, storey)))
        return
    from planner.exchange.dot import dot

    print(dot(topology, storey=storey, name=call.handle.name).rstrip("\n"))
