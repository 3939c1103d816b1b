"""Options that several commands have."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

MapName = Annotated[
    str | None,
    typer.Option("--map", envvar="SEMMAP_MAP", help="The map; not needed where there is one only."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]

# of grids and robots

Urdf = Annotated[Path, typer.Option("--robot", help="The robot's URDF.")]
State = Annotated[
    str | None,
    typer.Option(
        help='Joint positions as JSON, {"arm_1_joint": 0.5}, a file, or a state of its SRDF; by '
        "default the stored posture, or one near its axis that is found."
    ),
]
Parts = Annotated[
    Path | None, typer.Option(help="YAML that groups links into parts; by default found.")
]
MaxStep = Annotated[float, typer.Option(help="The highest step that it drives over, metres.")]
MaxSlope = Annotated[float, typer.Option(help="The steepest slope that it climbs, degrees.")]
PolicyFile = Annotated[
    Path | None, typer.Option("--policy", help="YAML: which entity goes on which layer.")
]
Moment = Annotated[
    datetime | None,
    typer.Option("--at", help="Leave out regions that do not hold then; by default now."),
]
FieldNames = Annotated[
    list[str] | None,
    typer.Option("--field", help="Only this field of the map; may be repeated. By default all."),
]
NoFields = Annotated[bool, typer.Option("--no-fields", help="Leave out the fields of the map.")]
AssumeSizes = Annotated[
    bool,
    typer.Option("--assume-sizes", help="Give objects without geometry a typical box."),
]
FromVoxels = Annotated[
    bool,
    typer.Option("--from-voxels", help="Take voxels from the mirror, not meshes."),
]
VoxelSize = Annotated[
    float, typer.Option(help="Edge of the mirror's voxels, metres, with --from-voxels.")
]
Storey = Annotated[str | None, typer.Option(help="Only this storey.")]

# of plans and simulated missions

DomainFile = Annotated[
    Path | None, typer.Option("--domain", help="YAML file of additional actions.")
]
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
