"""`semmap route`: the quickest route between two places, objects or points."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli
from semmap.cli.grid_options import AssumeSizes
from semmap.cli.place_progress import place_progress

if TYPE_CHECKING:
    from planner.live_topology import LiveTopology
    from planner.robot_class import RobotClass
    from planner.route import Route, RouteStep
    from semmap.geometry.pose import Pose

__all__ = ["readable_pose", "route_command"]


def route_command(
    start: Annotated[
        str, typer.Argument(metavar="FROM", help="A room, an object in one, or X,Y or X,Y,Z.")
    ],
    goal: Annotated[
        str,
        typer.Argument(metavar="TO", help="As FROM, or a type or label: kitchen; a region: home."),
    ],
    map_name: cli.MapName = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Class of robots (semmap robot) with costmaps and times."),
    ] = None,
    avoid: Annotated[
        list[str] | None,
        typer.Option("--avoid", help="Avoid this place, door, region or type; repeatable."),
    ] = None,
    at: Annotated[
        datetime | None, typer.Option(help="Moment for rules that have hours; by default now.")
    ] = None,
    rules: Annotated[
        Path | None, typer.Option(help="YAML file: what places, doors and regions cost.")
    ] = None,
    count: Annotated[int, typer.Option("-k", help="Number of routes, the quickest first.")] = 1,
    locked: Annotated[bool, typer.Option("--locked", help="The robot unlocks doors.")] = False,
    closed: Annotated[
        bool, typer.Option("--closed/--no-closed", help="The robot opens closed doors.")
    ] = True,
    outside: Annotated[
        bool, typer.Option("--outside", help="The robot may leave the building.")
    ] = False,
    graph: Annotated[
        bool,
        typer.Option("--graph", help="On the drawn graph: imported Nav2 edges or Open-RMF lanes."),
    ] = False,
    assume_sizes: AssumeSizes = False,
    rooms: Annotated[
        bool, typer.Option("--rooms", help="Print only the rooms on the route, with commas.")
    ] = False,
    json_: cli.Json = False,
) -> None:
    """Find the quickest route: its doors in order, each with an approach and a leave pose."""
    from planner.cost_rules import CostRules
    from planner.readers.drawn_graph import read_drawn_graph
    from planner.robot_class import RobotClass
    from planner.route_planner import RoutePlanner
    from semmap.query.geometry_notes import names_note, read_names_without_geometry

    if graph and count != 1:
        raise typer.BadParameter("--graph finds one route: leave out -k")
    if assume_sizes and robot is None:
        raise typer.BadParameter("--assume-sizes is for the costmaps of a robot: add --robot")
    able = RobotClass(opens=closed, unlocks=locked, outside=outside)
    quiet = json_ or rooms
    with _live_topology(map_name, robot or able, assume_sizes, quiet=quiet) as live:
        planner = RoutePlanner.of_live(live, rules=None if rules is None else CostRules.read(rules))
        if robot is not None and (locked or outside or not closed):
            planner.graph = _graph_with_abilities(live, able)
        ends, moment = (_location(start), _location(goal)), at or datetime.now()
        if graph:
            with live.snapshot() as connection:
                drawn = read_drawn_graph(connection, live.topology)
            found = [planner.route_on(drawn, *ends, avoid=avoid or (), at=moment)]
        elif count == 1:
            found = [planner.route(*ends, avoid=avoid or (), at=moment)]
        else:
            found = planner.alternatives(*ends, count, avoid=avoid or (), at=moment)
        places = [*dict.fromkeys([found[0].start, *(s.to_place for s in found[0].steps)])]
        with live.snapshot() as connection:
            unknown = read_names_without_geometry(connection, places)
            sized = read_names_without_geometry(connection, places, assume_sizes=True)
        assumed = sorted({*unknown} - {*sized}) if assume_sizes else []
        unknown = sized if assume_sizes else unknown
    if rooms:
        print(",".join(places))
    elif json_:
        answer = _route_as_json(found[0]) | {"no_geometry": unknown, "assumed_sizes": assumed}
        if count > 1:
            answer["alternatives"] = [_route_as_json(r) for r in found[1:]]
        print(json.dumps(answer))
    else:
        for number, route in enumerate(found, 1):
            if count > 1:
                cli.out.print(f"{number}.")
            _show_route(route, timed=robot is not None)
        for names, key in ((unknown, "no_geometry"), (assumed, "assumed_sizes")):
            if names:
                cli.out.print(names_note(names, key), style="yellow")


@contextmanager
def _live_topology(
    map_name: str | None, robot: str | RobotClass, assume_sizes: bool, *, quiet: bool
) -> Iterator[LiveTopology]:
    """The present topology; shows the progress while travel times are measured."""
    from planner.live_topology import LiveTopology
    from semmap.query.map_handle import MapHandle

    with cli.database() as engine:
        with place_progress(quiet=quiet) as progress:
            live = LiveTopology(
                MapHandle(engine, map_name), robot, progress=progress, assume_sizes=assume_sizes
            )
        yield live


def _graph_with_abilities(live: LiveTopology, able: RobotClass) -> Any:
    """The routing graph of the same robots with additional abilities."""
    from dataclasses import replace

    from planner.routing_graph import RoutingGraph

    graph, robot = live.graph, live.graph.robot
    robot = replace(
        robot,
        opens=robot.opens and able.opens,
        unlocks=robot.unlocks or able.unlocks,
        outside=robot.outside or able.outside,
    )
    return RoutingGraph(live.topology, robot, graph.costs, durations=graph.durations)


def _location(word: str) -> str | Pose:
    """A point in metres from numbers with commas; other words stand for entities."""
    from semmap.geometry.pose import Pose

    try:
        numbers = [float(v) for v in word.split(",")]
    except ValueError:
        return word
    if len(numbers) in (2, 3) and all(map(math.isfinite, numbers)):
        return Pose(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0)
    return word


def _route_as_json(route: Route) -> dict[str, Any]:
    """The route as plain values; poses are x, y, z and quaternion."""
    return {
        "from": route.start,
        "to": route.goal,
        "cost": route.seconds,
        "seconds": route.seconds,
        "metres": route.metres,
        "doors": [
            {
                "name": step.connector.name,
                "from": step.from_place,
                "to": step.to_place,
                "approach": _plain(step.approach),
                "leave": _plain(step.leave),
            }
            for step in route.doors
            if step.connector is not None
        ],
        "transitions": [_step_as_json(step) for step in route.transitions],
        "steps": [
            _step_as_json(step)
            | {"seconds": step.seconds, "metres": step.metres}
            | {"frame": step.frame, "map": step.map}
            for step in route.steps
        ],
    }


def _step_as_json(step: RouteStep) -> dict[str, Any]:
    return {
        "behaviour": step.behaviour,
        "connector": step.connector.name if step.connector else None,
        "elevator": step.elevator,
        "from": step.from_place,
        "to": step.to_place,
        "approach": _plain(step.approach),
        "leave": _plain(step.leave),
    }


def _plain(pose: Pose | None) -> dict[str, float] | None:
    return None if pose is None else pose._asdict()


def _show_route(route: Route, *, timed: bool = False) -> None:
    """Print a route as a table; with all steps and their durations if `timed`."""
    from rich.table import Table

    steps = route.steps if timed else route.transitions
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("step", "by", "from", "to", "approach (x, y, z; heading)", "leave"):
        table.add_column(name)
    if timed:
        table.add_column("seconds", justify="right")
    for step in steps:
        by = step.elevator if step.connector is None else step.connector.name
        if step.behaviour == "switch_map":
            by = step.map
        row = [step.behaviour, by or "", step.from_place, step.to_place]
        row += [readable_pose(step.approach), readable_pose(step.leave)]
        table.add_row(*row, *([f"{step.seconds:.1f}"] if timed else []))
    if steps:
        cli.out.print(table)
    doors = ", ".join(s.connector.name for s in route.doors if s.connector is not None)
    took = f"{route.metres:.1f} m" + (f", {route.seconds:.0f} s" if timed else "")
    cli.out.print(f"{route.start} -> {route.goal}: {doors or 'no door'} ({took})")


def readable_pose(pose: Pose | None) -> str:
    """Return a place, metres, and where the front points, in words."""
    if pose is None:
        return "anywhere"
    heading = (round(math.degrees(pose.yaw)) + 179) % 360 - 179
    return f"{pose.x:.2f} {pose.y:.2f} {pose.z:.2f}; {heading}°"
