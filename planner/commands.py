"""What the planner adds to the command line: `semmap route` and `semmap demo`."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from navgrid.commands import open_map
from planner.robot_class import RobotClass
from planner.route import NoRouteError, Route
from planner.source import read_places_like, read_topology
from planner.topology import UnknownPlaceError
from semmap import cli
from semmap.geometry.pose import Pose

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the planner's commands."""
    app.command("route")(route_command)
    app.command("demo")(demo_command)


def route_command(
    start: Annotated[str, typer.Argument(metavar="FROM", help="A room, or a thing in one.")],
    goal: Annotated[
        str, typer.Argument(metavar="TO", help="A room, a thing in one, or a label: kitchen.")
    ],
    map_name: cli.MapName = None,
    locked: Annotated[bool, typer.Option("--locked", help="The robot unlocks doors.")] = False,
    closed: Annotated[
        bool, typer.Option("--closed/--no-closed", help="The robot opens closed doors.")
    ] = True,
    outside: Annotated[bool, typer.Option("--outside", help="It may go outside.")] = False,
    rooms: Annotated[
        bool, typer.Option("--rooms", help="Only the rooms that it leads through, with commas.")
    ] = False,
    json_: cli.Json = False,
) -> None:
    """Find the doors to pass from room to room, in order, each with its two poses."""
    with open_map(map_name) as connection:
        topology = read_topology(connection)
        starts, goals = (read_places_like(connection, topology, said) for said in (start, goal))
    for said, found in ((start, starts), (goal, goals)):
        if not found:
            raise UnknownPlaceError(said, topology.places)
    if len(starts) > 1:
        raise ValueError(f"{start} may be {', '.join(sorted(starts))}; name one of them")
    best: Route | None = None
    why: NoRouteError | None = None
    network = topology.network(RobotClass(opens=closed, unlocks=locked, outside=outside))
    for place in sorted(goals):  # of several kitchens the nearest
        try:
            found_ = network.route(network.site(starts[0]), network.site(place))
        except NoRouteError as error:
            why = why or error
            continue
        if best is None or found_.seconds < best.seconds:
            best = found_
    if best is None:
        assert why is not None
        raise why
    if rooms:
        print(",".join(dict.fromkeys([best.start, *(step.to_place for step in best.steps)])))
    elif json_:
        print(json.dumps(route_as_json(best)))
    else:
        show_route(best)


def route_as_json(found: Route) -> dict[str, Any]:
    """The route as plain values: its doors, and all its steps; poses as x, y, z and quaternion."""
    return {
        "from": found.start,
        "to": found.goal,
        "cost": found.seconds,
        "walked": found.metres,
        "doors": [
            {
                "name": step.connector.name,
                "from": step.from_place,
                "to": step.to_place,
                "approach": _plain(step.approach),
                "leave": _plain(step.leave),
            }
            for step in found.doors
            if step.connector is not None
        ],
        "steps": [
            {
                "behaviour": step.behaviour,
                "connector": step.connector.name if step.connector else None,
                "elevator": step.elevator,
                "from": step.from_place,
                "to": step.to_place,
                "approach": _plain(step.approach),
                "leave": _plain(step.leave),
            }
            for step in found.steps
        ],
    }


def _plain(pose: Pose | None) -> dict[str, float] | None:
    return None if pose is None else asdict(pose)


def show_route(found: Route) -> None:
    """The route as a table."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("step", "by", "from", "to", "approach (x, y, z; heading)", "leave"):
        table.add_column(name)
    for step in found.steps:
        by = step.elevator if step.connector is None else step.connector.name
        table.add_row(step.behaviour, by, step.from_place, step.to_place, _readable(step.approach),
                      _readable(step.leave))  # fmt: skip
    if found.steps:
        cli.out.print(table)
    doors = ", ".join(s.connector.name for s in found.doors if s.connector is not None)
    cli.out.print(f"{found.start} -> {found.goal}: {doors or 'no door'} ({found.metres:.1f} m)")


def _readable(pose: Pose | None) -> str:
    if pose is None:
        return "anywhere"
    return f"{pose.x:.2f} {pose.y:.2f} {pose.z:.2f}; {math.degrees(pose.yaw):.0f}°"


def demo_command(
    world: Annotated[
        list[Path] | None, typer.Argument(help="World files; by default the office.")
    ] = None,
    start: Annotated[str | None, typer.Option("--from", help="Room to start in.")] = None,
    goal: Annotated[str | None, typer.Option("--to", help="Room to go to.")] = None,
    folder: Annotated[Path, typer.Option("--output", "-o", help="For maps and pictures.")] = Path(
        "out/demo"
    ),
) -> None:
    """Import a world, ask it, write its grids, find a route, and draw it all."""
    from planner.demo import run_demo  # slow to load, as all that draws

    run_demo(world or [], folder, start=start, goal=goal, say=cli.out.print)
