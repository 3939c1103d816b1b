"""`semmap robot`: the classes of robots in a database."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.option_group import grouped
from semmap.cli.options import Ground, Parts, State, Urdf
from semmap.cli.output import print_folded
from semmap.cli.texts import numbers

if TYPE_CHECKING:
    from planner.robot_class import RobotClass

robot = typer.Typer(no_args_is_help=True, help="Classes of robots: their shape and abilities.")


@dataclass(frozen=True)
class Abilities:
    """What a robot is able to do and may do."""

    capacity: int = Option(1, help="Number of objects that it carries at once.")
    behaviours: list[str] | None = Option(
        None, "--behaviour", help="A behaviour that it has; repeatable; else all."
    )
    permissions: list[str] = Option(
        (), "--permission", help="A permission that it has; repeatable."
    )
    opens: bool = Option(True, help="It opens closed doors.")
    unlocks: bool = Option(False, help="It unlocks locked doors.")
    outside: bool = Option(False, help="It may leave the building.")


@robot.command()
@grouped
def add(
    *,
    name: Annotated[str, Argument(help="Name of the class.")],
    urdf: Urdf,
    state: State = None,
    parts: Parts = None,
    speed: float = Option(0.5, help="Metres a second on clear ground."),
    ground: Ground,
    reach: str = Option("0.2,0.8", help="Distance of objects that it takes: MIN,MAX metres."),
    heights: str = Option("0.0,1.6", help="Height of objects that it takes: MIN,MAX metres."),
    abilities: Abilities,
    json_: cli.Json = False,
) -> None:
    """Add a class of robots from a URDF, or replace the class of this name."""
    asked: Any = {"parts": parts, "speed": speed} | vars(ground) | vars(abilities)
    asked["reach"] = numbers(reach, "--reach MIN,MAX", 2)
    asked["heights"] = numbers(heights, "--heights MIN,MAX", 2)
    with cli.open_database() as db:
        chosen = db.driving_posture(urdf, state, parts)
        added = db.add_robot(name, urdf, posture=chosen.joints, **asked)
    _show([added], json_)
    if not json_:
        cli.out.print(str(chosen))


@robot.command()
def ls(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the classes of robots."""
    with cli.chosen_map(map_name) as house:
        _show([*house.robots.values()], json_)


@robot.command()
def rm(name: str = Argument(help="Name of the class to delete.")) -> None:
    """Delete a class of robots and its travel times."""
    with cli.open_database() as db:
        db.delete_robot(name)


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
    lines = []
    for r in robots:
        shape = ", ".join(f"{p.name} {p.interval[0]:.2f} to {p.interval[1]:.2f} m" for p in r.parts)
        reach = f"{r.reach[0]:g} to {r.reach[1]:g} m"
        lines.append((r.name, shape or "no shape", f"{r.speed:g}", reach, str(r.capacity)))
    print_folded(("robot", "parts", "m/s", "reaches", "carries"), lines)
