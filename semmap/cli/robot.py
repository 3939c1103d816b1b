"""`semmap robot`: the classes of robots in a database."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json
from semmap.cli.output import print_folded

if TYPE_CHECKING:
    from planner.robot_class import RobotClass


@command_of(
    "Database.add_robot",
    urdf="--robot",
    posture="--state",
    reach="MIN,MAX",
    heights="MIN,MAX",
    behaviours="--behaviour",
    permissions="--permission",
    unlocks="--unlocks/--no-unlocks",
    outside="--outside/--no-outside",
)
def _add(call: MethodCall, json_: Json = False) -> None:
    """Add a class of robots from a URDF, or replace the class of this name."""
    posture = call.values.pop("posture", None)
    chosen = call.handle.driving_posture(call.values["urdf"], posture, call.texts["parts"])
    _show([call(posture=chosen.joints)], json_)
    if not json_:
        print(chosen)


@command_of("Map.robots")
def _ls(call: MethodCall, json_: Json = False) -> None:
    """List the classes of robots."""
    _show([*call().values()], json_)


def _show(robots: Sequence[RobotClass], json_: bool) -> None:
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


robot_command = group(
    _add,
    _ls,
    printed("Database.delete_robot", ""),
)
