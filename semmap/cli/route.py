"""`semmap route`: the quickest route between two places, objects or points."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.option_group import grouped
from semmap.cli.options import AssumeSizes
from semmap.cli.output import place_progress, print_folded
from semmap.cli.texts import numbers

if TYPE_CHECKING:
    from planner.route import Route, RouteStep
    from semmap.geometry.pose import Pose


@dataclass(frozen=True)
class Conditions:
    """Who goes, when, and what counts."""

    robot: str | None = Option(None, help="Class of robots (semmap robot), with costmaps.")
    avoid: list[str] = Option((), help="Avoid this place, door, region, type; repeatable.")
    at: datetime | None = Option(None, help="Moment for rules that have hours; by default now.")
    rules: Path | None = Option(None, help="YAML file: what places, doors and regions cost.")


@grouped
def route_command(
    *,
    start: str = Argument(metavar="FROM", help="A room, an object in one, or X,Y or X,Y,Z."),
    goal: str = Argument(
        metavar="TO", help="As FROM, or a type or label: kitchen; a region: home."
    ),
    map_name: cli.MapName = None,
    conditions: Conditions,
    count: int = Option(1, "-k", help="Number of routes, the quickest first."),
    locked: bool = Option(False, "--locked", help="The robot unlocks doors."),
    closed: bool = Option(True, help="The robot opens closed doors."),
    outside: bool = Option(False, "--outside", help="The robot may leave the building."),
    drawn: bool = Option(False, "--graph", help="On imported Nav2 edges or Open-RMF lanes."),
    assume_sizes: AssumeSizes = False,
    rooms: bool = Option(False, "--rooms", help="Print only the rooms on the route, with commas."),
    json_: cli.Json = False,
) -> None:
    """Find the quickest route: its doors in order, each with an approach and a leave pose."""
    if drawn and count != 1:
        raise typer.BadParameter("--graph finds one route: leave out -k")
    given = {"unlocks": locked, "outside": outside, "opens": closed}
    abilities = {name: value for name, value in given.items() if value == (name != "opens")}
    options: Any = vars(conditions) | {"assume_sizes": assume_sizes} | abilities
    ends = _location(start), _location(goal)
    with cli.chosen_map(map_name) as house:
        with place_progress(quiet=json_ or rooms) as progress:
            if count == 1:
                found = [house.route(*ends, drawn=drawn, progress=progress, **options)]
            else:
                found = house.routes(*ends, count, progress=progress, **options)
        unknown = found[0].without_geometry(assume_sizes=assume_sizes)
        assumed = sorted({*found[0].without_geometry()} - {*unknown}) if assume_sizes else []
    notes = {"no_geometry": unknown, "assumed_sizes": assumed}
    if rooms:
        print(",".join(found[0].places))
    elif json_:
        others = {"alternatives": [_route_as_json(r) for r in found[1:]]} if count > 1 else {}
        print(json.dumps(_route_as_json(found[0]) | notes | others))
    else:
        _show_routes(found, notes, conditions.robot is not None)


def _show_routes(
    found: Sequence[Route], without_shape: Mapping[str, Sequence[str]], timed: bool
) -> None:
    from semmap.query.geometry_notes import names_note

    for number, route in enumerate(found, 1):
        if len(found) > 1:
            cli.out.print(f"{number}.")
        _show_route(route, timed=timed)
    for key, names in without_shape.items():
        if names:
            cli.out.print(names_note(names, key), style="yellow")


def _location(word: str) -> str | Pose:
    """A point in metres from numbers with commas; other words stand for entities."""
    from semmap.geometry.pose import Pose

    try:
        x, y, *z = numbers(word, "a point")
    except ValueError:
        return word
    return word if len(z) > 1 else Pose(x, y, *z)


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
        "transitions": [step_as_json(step) for step in route.transitions],
        "steps": [
            step_as_json(step)
            | {"seconds": step.seconds, "metres": step.metres}
            | {"frame": step.frame, "map": step.map}
            for step in route.steps
        ],
    }


def step_as_json(step: RouteStep) -> dict[str, Any]:
    """A step as plain values; poses are x, y, z and quaternion."""
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
    cli.out.print(f"{route.start} -> {route.goal}: {doors or 'no door'} ({took})")


def readable_pose(pose: Pose | None) -> str:
    """Return a place, metres, and where the front points, in words."""
    if pose is None:
        return "anywhere"
    heading = (round(math.degrees(pose.yaw)) + 179) % 360 - 179
    return f"{pose.x:.2f} {pose.y:.2f} {pose.z:.2f}; {heading}°"
