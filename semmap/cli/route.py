"""`semmap route`: the quickest route between two places, objects or points."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from typer import Option

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json
from semmap.cli.output import place_progress, print_folded

if TYPE_CHECKING:
    from planner.route import Route
    from semmap.api.map_results import MapRoute
    from semmap.geometry.pose import Pose


@command_of(
    "Map.route",
    start="FROM",
    goal="TO",
    drawn="--graph",
    unlocks="--locked",
    outside="--outside",
    opens="--closed/--no-closed",
)
def route_command(
    call: MethodCall,
    count: int = Option(1, "-k", help="Number of routes, the quickest first."),
    rooms: bool = Option(False, "--rooms", help="Print only the rooms on the route, with commas."),
    draw: Path | None = Option(
        None, help="Draw the way on floor plans to this .png, .svg or .pdf."
    ),
    json_: Json = False,
) -> None:
    """Find the quickest route: its doors in order, each with an approach and a leave pose."""
    drawn, assume_sizes = call.values["drawn"], call.values["assume_sizes"]
    if drawn and count != 1:
        raise typer.BadParameter("--graph finds one route: leave out -k")
    with place_progress(quiet=json_ or rooms) as progress:
        if count == 1:
            found = [call(progress=progress)]
        else:
            del call.values["drawn"]
            found = call.handle.routes(count=count, progress=progress, **call.values)
    unknown = found[0].without_geometry(assume_sizes=assume_sizes)
    assumed = sorted({*found[0].without_geometry()} - {*unknown}) if assume_sizes else []
    notes = {"no_geometry": unknown, "assumed_sizes": assumed}
    if draw is not None:
        print(found[0].plot().save(draw), file=sys.stderr)
    if rooms:
        print(",".join(found[0].places))
    elif json_:
        others = {"alternatives": [r.as_json() for r in found[1:]]} if count > 1 else {}
        print(json.dumps(found[0].as_json() | notes | others))
    else:
        _show_routes(found, notes, "robot" in call.values)


def _show_routes(
    found: Sequence[MapRoute], without_shape: Mapping[str, Sequence[str]], timed: bool
) -> None:
    from semmap.query.geometry_notes import names_note

    for number, route in enumerate(found, 1):
        if len(found) > 1:
            print(f"{number}.")
        _show_route(route, timed=timed)
    if found[0].assumed_body is not None:
        cli.out.print(found[0].assumed_body, style="cyan")
    for key, names in without_shape.items():
        if names:
            cli.out.print(names_note(names, key), style="yellow")


def _show_route(route: Route, *, timed: bool = False) -> None:
    """Print a route as a table; with all steps and their durations if `timed`."""
    lines = []
    for step in route.steps if timed else route.transitions:
        by = step.elevator if step.connector is None else step.connector.name
        if step.behaviour == "switch_map":
            by = step.map
        row = [step.behaviour, by or "", step.from_place, step.to_place]
        row += [readable_pose(step.approach), readable_pose(step.leave)]
        lines.append([*row, f"{step.seconds:.1f}"])
    names = ("step", "by", "from", "to", "approach (x, y, z; heading)", "leave", "seconds")
    if lines:
        shown = len(names) if timed else -1
        print_folded(names[:shown], [line[:shown] for line in lines], right=("seconds",))
    doors = ", ".join(s.connector.name for s in route.doors if s.connector is not None)
    took = f"{route.metres:.1f} m" + (f", {route.seconds:.0f} s" if timed else "")
    print(f"{route.begin} -> {route.goal}: {doors or 'no door'} ({took})")


def readable_pose(pose: Pose | None) -> str:
    """Return a place, metres, and where the front points, in words."""
    if pose is None:
        return "anywhere"
    heading = (round(math.degrees(pose.yaw)) + 179) % 360 - 179
    return f"{pose.x:.2f} {pose.y:.2f} {pose.z:.2f}; {heading}°"
