"""`semmap topology`: what joins what, for Nav2, Open-RMF, Graphviz, as a picture, as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from navgrid.map_file import file_name
from planner.exchange.dot import dot
from planner.exchange.nav2_route import write_nav2
from planner.exchange.rmf_nav import write_rmf_nav
from planner.exchange.source import read_surroundings
from planner.exchange.stands import ExchangeError
from planner.live import Live
from planner.robot_class import RobotClass
from planner.topology import Connector, Place, Topology
from semmap import cli
from semmap.draw.view import StoreyView, storey_view
from semmap.query.maps import current_name
from semmap.query.storey_reader import read_storeys

__all__ = ["topology_as_json", "topology_command"]


class Format(StrEnum):
    """What the topology is written as."""

    nav2 = "nav2"
    rmf = "rmf"
    dot = "dot"
    png = "png"
    json = "json"


ENDINGS = {
    ".geojson": Format.nav2, ".yaml": Format.rmf, ".yml": Format.rmf, ".dot": Format.dot,
    ".gv": Format.dot, ".png": Format.png, ".json": Format.json,
}  # fmt: skip


def topology_command(
    file: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File; DOT and JSON else go to standard output."),
    ] = None,
    format_: Annotated[
        Format | None,
        typer.Option("--format", help="By default what the file's ending says, else dot."),
    ] = None,
    map_name: cli.MapName = None,
    storey: Annotated[str | None, typer.Option(help="Only this storey.")] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Ways and times of this class of robots; else as the crow flies."),
    ] = None,
    locked: Annotated[bool, typer.Option("--locked", help="It unlocks doors.")] = False,
    speed: Annotated[float, typer.Option(help="Metres a second, without --robot.")] = 0.5,
    json_: cli.Json = False,
) -> None:
    """Write what joins what: a route graph for Nav2 or Open-RMF, DOT, a picture or JSON."""
    chosen = _format(file, format_, json_)
    with cli.open_map(map_name) as connection:
        name = current_name(connection)
        around = read_surroundings(connection)
        views = [storey_view(s) for s in read_storeys(connection, storey, triangles=False)]
    with cli.database() as engine:
        network = Live(engine, name, robot or RobotClass(speed=speed, unlocks=locked)).network
    topology = network.topology
    if not topology.connectors:
        raise ExchangeError(
            f"the map {name} has no connectors: import an annotation that has (GeoJSON, "
            "GeoPackage) or an Open-RMF building"
        )
    if file is None:
        text = dot(topology, storey=storey, name=name) if chosen is Format.dot else json.dumps(
            topology_as_json(topology, storey))  # fmt: skip
        print(text.rstrip("\n"))
        return
    match chosen:
        case Format.nav2:
            written = write_nav2(network, file, storey=storey, surroundings=around, name=name)
        case Format.rmf:
            written = [
                write_rmf_nav(network, file, name=name, surroundings=around, storey=storey)
            ]  # fmt: skip
        case Format.png:
            written = _pictures(topology, views, file, name)
        case _:
            text = dot(topology, storey=storey, name=name) if chosen is Format.dot else json.dumps(
                topology_as_json(topology, storey), indent=1) + "\n"  # fmt: skip
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            written = [file]
    if json_ and chosen is not Format.json:
        print(json.dumps([str(path) for path in written]))
    else:
        for path in written:
            cli.out.print(str(path))


def _format(file: Path | None, said: Format | None, as_json: bool) -> Format:
    if said is None and file is not None:
        said = ENDINGS.get(file.suffix.lower())
        if said is None:
            raise typer.BadParameter(
                f"{file.name} does not say its format: give --format, one of {', '.join(Format)}"
            )
    if said is None:
        return Format.json if as_json else Format.dot
    if file is None and said not in (Format.dot, Format.json):
        raise typer.BadParameter(f"--format {said} is written to a file: give -o FILE")
    return said


def topology_as_json(topology: Topology, storey: str | None = None) -> dict[str, Any]:
    """Places and connectors as plain values; poses as x, y, z and quaternion."""
    places = [p for p in topology.places.values() if storey is None or p.storey == storey]
    names = {p.name for p in places}
    connectors = [c for c in topology.connectors.values() if names & set(c.places)]
    return {
        "places": [_plain(p) for p in places],
        "connectors": [
            _plain(c)
            | {"poses": [p._asdict() for p in c.poses], "permissions": sorted(c.permissions)}
            for c in connectors
        ],
        "elevators": topology.cabins(),
    }


def _plain(thing: Place | Connector) -> dict[str, Any]:
    """Without the number that only the database knows."""
    return {key: value for key, value in asdict(thing).items() if key != "id"}


def _pictures(topology: Topology, views: list[StoreyView], file: Path, name: str) -> list[Path]:
    from planner.exchange.picture import topology_plan  # slow to load, as all that draws

    return [
        topology_plan(
            topology,
            view,
            file if len(views) == 1
            else file.with_name(f"{file.stem}.{file_name(view.name)}{file.suffix or '.png'}"),
            title=f"{name}, {view.name}: topology" if view.name != name else f"{name}: topology",
        )
        for view in views
    ]  # fmt: skip
