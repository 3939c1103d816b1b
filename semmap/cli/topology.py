"""`semmap topology`: the topology for Nav2, Open-RMF and Graphviz, as a picture, as JSON."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli

if TYPE_CHECKING:
    from planner.topology import Place, PlaceConnector, Topology
    from semmap.draw.view import StoreyView

__all__ = ["topology_command"]


class TopologyFormat(StrEnum):
    """File formats of a topology."""

    nav2 = "nav2"
    rmf = "rmf"
    dot = "dot"
    png = "png"
    json = "json"


_ENDINGS = {
    ".geojson": TopologyFormat.nav2,
    ".yaml": TopologyFormat.rmf,
    ".yml": TopologyFormat.rmf,
    ".dot": TopologyFormat.dot,
    ".gv": TopologyFormat.dot,
    ".png": TopologyFormat.png,
    ".json": TopologyFormat.json,
}


def topology_command(
    file: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File; by default DOT and JSON are printed."),
    ] = None,
    format_: Annotated[
        TopologyFormat | None,
        typer.Option("--format", help="By default the format of the file's ending, or dot."),
    ] = None,
    map_name: cli.MapName = None,
    storey: Annotated[str | None, typer.Option(help="Only this storey.")] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Class of robots whose paths and times are used, not straight lines."),
    ] = None,
    locked: Annotated[bool, typer.Option("--locked", help="The robot unlocks doors.")] = False,
    speed: Annotated[float, typer.Option(help="Metres a second, without --robot.")] = 0.5,
    json_: cli.Json = False,
) -> None:
    """Write the topology: a route graph for Nav2 or Open-RMF, DOT, a picture or JSON."""
    from planner.exchange.dot import dot
    from planner.exchange.nav2_route import write_nav2
    from planner.exchange.reader import read_building_outline
    from planner.exchange.rmf_nav import write_rmf_nav
    from planner.exchange.route_graph import ExchangeError
    from planner.live_topology import LiveTopology
    from planner.robot_class import RobotClass
    from semmap.database.maps import current_name
    from semmap.draw.view import storey_view
    from semmap.query.map_handle import MapHandle
    from semmap.query.storey_reader import read_storeys

    chosen = _format(file, format_, json_)
    with cli.open_map(map_name) as connection:
        name = current_name(connection)
        building = read_building_outline(connection)
        views = [storey_view(s) for s in read_storeys(connection, storey, triangles=False)]
    with cli.database() as engine:
        default = RobotClass(speed=speed, unlocks=locked)
        routing = LiveTopology(MapHandle(engine, name), robot or default).graph
    topology = routing.topology
    if not topology.connectors:
        raise ExchangeError(
            f"the map {name} has no connectors: import an annotation that has them (GeoJSON, "
            "GeoPackage) or an Open-RMF building"
        )
    if chosen is TopologyFormat.dot:
        text = dot(topology, storey=storey, name=name)
    else:
        text = json.dumps(_topology_as_json(topology, storey), indent=None if file is None else 1)
    if file is None:
        print(text.rstrip("\n"))
        return
    match chosen:
        case TopologyFormat.nav2:
            written = write_nav2(routing, file, storey=storey, building=building, name=name)
        case TopologyFormat.rmf:
            written = [write_rmf_nav(routing, file, name=name, building=building, storey=storey)]
        case TopologyFormat.png:
            written = _write_pictures(topology, views, file, name)
        case _:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
            written = [file]
    if json_ and chosen is not TopologyFormat.json:
        print(json.dumps([str(path) for path in written]))
    else:
        for path in written:
            cli.out.print(str(path))


def _format(file: Path | None, given: TopologyFormat | None, as_json: bool) -> TopologyFormat:
    if given is None and file is not None:
        given = _ENDINGS.get(file.suffix.lower())
        if given is None:
            raise typer.BadParameter(
                f"{file.name}: its ending stands for no format: give --format, one of "
                f"{', '.join(TopologyFormat)}"
            )
    if given is None:
        return TopologyFormat.json if as_json else TopologyFormat.dot
    if file is None and given not in (TopologyFormat.dot, TopologyFormat.json):
        raise typer.BadParameter(f"--format {given} is written to a file: give -o FILE")
    return given


def _topology_as_json(topology: Topology, storey: str | None = None) -> dict[str, Any]:
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


def _plain(entity: Place | PlaceConnector) -> dict[str, Any]:
    """The attributes without the id, which has a meaning only in the database."""
    from dataclasses import asdict

    return {key: value for key, value in asdict(entity).items() if key != "id"}


def _write_pictures(
    topology: Topology, views: list[StoreyView], file: Path, name: str
) -> list[Path]:
    from navgrid.map_file import file_name
    from planner.exchange.picture import topology_plan

    written = []
    for view in views:
        path, title = file, f"{name}: topology"
        if len(views) > 1:
            ending = f"{file_name(view.name)}{file.suffix or '.png'}"
            path = file.with_name(f"{file.stem}.{ending}")
        if view.name != name:
            title = f"{name}, {view.name}: topology"
        written.append(topology_plan(topology, view, path, title=title))
    return written
