"""`semmap route`: which doors lead there, each with its two poses."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress
from rich.table import Table

from planner.ask import Said
from planner.live import Live
from planner.robot_class import RobotClass
from planner.route import Route, Step
from planner.rules import Rules
from semmap import cli
from semmap.geometry.pose import Pose

__all__ = ["follow", "route_as_json", "route_command", "said", "show_route"]


def route_command(
    start: Annotated[
        str, typer.Argument(metavar="FROM", help="A room, a thing in one, or X,Y or X,Y,Z.")
    ],
    goal: Annotated[
        str,
        typer.Argument(metavar="TO", help="As FROM, or a type or label: kitchen; a region: home."),
    ],
    map_name: cli.MapName = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="A class of robots (semmap robot): its costmaps, its times."),
    ] = None,
    avoid: Annotated[
        list[str] | None,
        typer.Option("--avoid", help="Not through this place, door, region or type; repeatable."),
    ] = None,
    at: Annotated[
        datetime | None, typer.Option(help="When: rules have hours. By default now.")
    ] = None,
    rules: Annotated[
        Path | None, typer.Option(help="What ways cost by what things mean; YAML.")
    ] = None,
    count: Annotated[int, typer.Option("-k", help="So many routes, the best first.")] = 1,
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
    able = RobotClass(opens=closed, unlocks=locked, outside=outside)
    said_rules = None if rules is None else Rules.read(rules)
    with follow(map_name, robot or able, said_rules, quiet=json_ or rooms) as live:
        if robot is not None and (locked or outside or not closed):
            mine = live.network.robot
            changed = replace(mine, opens=mine.opens and closed, unlocks=mine.unlocks or locked,
                              outside=mine.outside or outside)  # fmt: skip
            live.network = live.topology.network(
                changed, times=live.network.times, walks=live.network.walks
            )
        moment = at or datetime.now()
        found = live.asker().route(said(start), said(goal), avoid=avoid or (), at=moment, k=count)
    if rooms:
        print(",".join(dict.fromkeys([found[0].start, *(s.to_place for s in found[0].steps)])))
    elif json_:
        answer = route_as_json(found[0])
        if count > 1:
            answer["alternatives"] = [route_as_json(r) for r in found[1:]]
        print(json.dumps(answer))
    else:
        for number, route in enumerate(found, 1):
            if count > 1:
                cli.out.print(f"{number}.")
            show_route(route, timed=robot is not None)


@contextmanager
def follow(
    map_name: str | None,
    robot: str | RobotClass | None,
    rules: Rules | None = None,
    *,
    quiet: bool = False,
) -> Iterator[Live]:
    """The topology as it is now; shows which places are measured where that takes a while."""
    with cli.database() as engine:
        with Progress(console=cli.out, transient=True, disable=quiet) as bar:
            task = bar.add_task("measuring walks", total=None, visible=False)

            def progress(place: str, number: int, total: int) -> None:
                bar.update(task, description=place, completed=number, total=total, visible=True)

            live = Live(engine, map_name, robot, rules=rules, progress=progress)
        yield live


def said(word: str) -> Said:
    """What a word on the command line means: numbers with commas are a point, metres."""
    parts = word.split(",")
    try:
        numbers = [float(v) for v in parts]
    except ValueError:
        return word
    if len(numbers) in (2, 3) and all(map(math.isfinite, numbers)):
        return Pose(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0)
    return word


def route_as_json(found: Route) -> dict[str, Any]:
    """The route as plain values: its doors, its steps, and its stages, which are all of it.

    Poses are x, y, z and quaternion; `cost` is `seconds`, `walked` is `metres`.
    """
    return {
        "from": found.start,
        "to": found.goal,
        "cost": found.seconds,
        "walked": found.metres,
        "seconds": found.seconds,
        "metres": found.metres,
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
        "steps": [_step(step) for step in found.steps],
        "stages": [
            _step(s)
            | {"seconds": s.seconds, "metres": s.metres, "frame": s.frame, "map": s.map}
            for s in found.stages
        ],
    }  # fmt: skip


def _step(step: Step) -> dict[str, Any]:
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


def show_route(found: Route, *, timed: bool = False) -> None:
    """The route as a table; with the walks and how long all takes, where it is `timed`."""
    steps: Sequence[Step] = found.stages if timed else found.steps
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("step", "by", "from", "to", "approach (x, y, z; heading)", "leave"):
        table.add_column(name)
    if timed:
        table.add_column("seconds", justify="right")
    for step in steps:
        by = step.elevator if step.connector is None else step.connector.name
        cells = [step.behaviour, by or "", step.from_place, step.to_place,
                 _readable(step.approach), _readable(step.leave)]  # fmt: skip
        if step.behaviour == "switch_map":
            cells[1] = step.map
        table.add_row(*cells, *([f"{step.seconds:.1f}"] if timed else []))
    if steps:
        cli.out.print(table)
    doors = ", ".join(s.connector.name for s in found.doors if s.connector is not None)
    took = f"{found.metres:.1f} m" + (f", {found.seconds:.0f} s" if timed else "")
    cli.out.print(f"{found.start} -> {found.goal}: {doors or 'no door'} ({took})")


def _readable(pose: Pose | None) -> str:
    if pose is None:
        return "anywhere"
    heading = (round(math.degrees(pose.yaw)) + 179) % 360 - 179
    return f"{pose.x:.2f} {pose.y:.2f} {pose.z:.2f}; {heading}°"
