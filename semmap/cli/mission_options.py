"""Options that commands of simulated missions share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Start = Annotated[
    str | None,
    typer.Option("--from", help="Room in which the robot starts; by default its room."),
]
Agent = Annotated[str, typer.Option("--agent", help="Name of the robot in the map.")]
RobotName = Annotated[
    str | None, typer.Option("--robot", help="Class of the robot (semmap robot).")
]
Speed = Annotated[float, typer.Option(help="Speed of the simulated clock; 1 is real time.")]
Fail = Annotated[
    list[str] | None,
    typer.Option(help="'door5 locked', 'Lift 1 broken', 'pickup fails twice', 'drop fails .1'"),
]
Seed = Annotated[int, typer.Option(help="Seed of random failures and detections.")]
Put = Annotated[
    list[str] | None,
    typer.Option("--put", help="'mug on table1': where an object truly is; repeatable."),
]
WorldFile = Annotated[
    Path | None,
    typer.Option(help="File with the state of the simulation; several robots may share it."),
]
Apply = Annotated[
    bool, typer.Option("--apply", help="Write what happens into the map; by default into a copy.")
]
