"""`semmap robot`: the classes of robots that a database knows."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any

import typer
from rich.table import Table

from navgrid.options import MaxSlope, MaxStep, Parts, State, Urdf, parts_of
from navgrid.terrain import DriveLimits
from planner.robot_class import RobotClass
from planner.source.robot_class import (
    delete_robot_class,
    keep_robot_class,
    read_robot_class,
    read_robot_names,
)
from planner.times import Times
from semmap import cli
from semmap.number_list import parse_numbers

__all__ = ["robot"]

robot = typer.Typer(no_args_is_help=True, help="Classes of robots: their shape and abilities.")


@robot.command()
def add(
    name: Annotated[str, typer.Argument(help="What to call the class.")],
    urdf: Urdf,
    state: State = None,
    parts: Parts = None,
    speed: Annotated[float, typer.Option(help="Metres a second on clear ground.")] = 0.5,
    max_step: MaxStep = 0.02,
    max_slope: MaxSlope = 6.0,
    reach: Annotated[
        str, typer.Option(help="How near and how far what it takes may be: MIN,MAX metres.")
    ] = "0.2,0.8",
    heights: Annotated[
        str, typer.Option(help="How low and how high what it takes may be: MIN,MAX metres.")
    ] = "0.0,1.6",
    capacity: Annotated[int, typer.Option(help="How many things it carries at once.")] = 1,
    behaviour: Annotated[
        list[str] | None, typer.Option(help="What it is able to do; repeatable. By default all.")
    ] = None,
    permission: Annotated[
        list[str] | None, typer.Option(help="What it is allowed; repeatable.")
    ] = None,
    opens: Annotated[bool, typer.Option(help="It opens closed doors.")] = True,
    unlocks: Annotated[bool, typer.Option(help="It unlocks locked doors.")] = False,
    outside: Annotated[bool, typer.Option(help="It may go outside.")] = False,
    json_: cli.Json = False,
) -> None:
    """Add a class of robots from a URDF, or replace the one of that name."""
    near = parse_numbers(reach, 2, "--reach MIN,MAX")
    high = parse_numbers(heights, 2, "--heights MIN,MAX")
    limits = DriveLimits(max_step, math.radians(max_slope))
    robot = RobotClass(
        name, tuple(parts_of(urdf, state, parts)), limits, speed,
        None if behaviour is None else frozenset(behaviour), frozenset(permission or ()), opens,
        unlocks, outside, (near[0], near[1]), (high[0], high[1]), capacity,
    )  # fmt: skip
    with cli.database() as engine, engine.begin() as connection:
        keep_robot_class(connection, robot, Times())
    _show([robot], json_)


@robot.command()
def ls(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the classes of robots."""
    with cli.open_map(map_name) as connection:
        names = read_robot_names(connection)
        found = [read_robot_class(connection, name)[1] for name in names]
    _show(found, json_)


@robot.command()
def rm(name: Annotated[str, typer.Argument(help="The class to forget.")]) -> None:
    """Forget a class of robots, and how long its ways are."""
    with cli.database() as engine, engine.begin() as connection:
        delete_robot_class(connection, name)


def _show(robots: list[RobotClass], json_: bool) -> None:
    rows: list[dict[str, Any]] = [
        {
            "name": r.name,
            "parts": {p.name: list(p.interval) for p in r.parts},
            "speed": r.speed,
            "reach": list(r.reach),
            "heights": list(r.heights),
            "capacity": r.capacity,
            "behaviours": None if r.behaviours is None else sorted(r.behaviours),
            "permissions": sorted(r.permissions),
        }
        for r in robots
    ]
    if json_:
        print(json.dumps(rows))
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("robot", "parts", "m/s", "reaches", "carries"):
        table.add_column(column)
    for r in robots:
        shape = ", ".join(f"{p.name} {p.interval[0]:.2f} to {p.interval[1]:.2f} m" for p in r.parts)
        table.add_row(r.name, shape or "no shape", f"{r.speed:g}",
                      f"{r.reach[0]:g} to {r.reach[1]:g} m", str(r.capacity))  # fmt: skip
    cli.out.print(table)
