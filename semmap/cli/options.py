"""Options that several commands have."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

from typer import Option

MapName = Annotated[
    str | None,
    Option("--map", envvar="SEMMAP_MAP", help="The map; not needed where there is one only."),
]
Json = Annotated[bool, Option("--json", help="Print JSON.")]

# of grids and robots

Urdf = Annotated[Path, Option("--robot", help="The robot's URDF.")]
State = Annotated[
    str | None,
    Option(
        help='Joint positions as JSON, {"arm_1_joint": 0.5}, a file, or a state of its SRDF; by '
        "default the stored posture, or one near its axis that is found."
    ),
]
Parts = Annotated[Path | None, Option(help="YAML that groups links into parts; by default found.")]
MaxStep = Annotated[float, Option(help="The highest step that it drives over, metres.")]
MaxSlope = Annotated[float, Option(help="The steepest slope that it climbs, degrees.")]
PolicyFile = Annotated[
    Path | None, Option("--policy", help="YAML: which entity goes on which layer.")
]
Moment = Annotated[
    datetime | None,
    Option("--at", help="Leave out regions that do not hold then; by default now."),
]
FieldNames = Annotated[
    list[str] | None,
    Option("--field", help="Only this field of the map; may be repeated. By default all."),
]
NoFields = Annotated[bool, Option("--no-fields", help="Leave out the fields of the map.")]
AssumeSizes = Annotated[
    bool,
    Option("--assume-sizes", help="Give objects without geometry a typical box."),
]
FromVoxels = Annotated[
    bool,
    Option("--from-voxels", help="Take voxels from the mirror, not meshes."),
]
VoxelSize = Annotated[
    float, Option(help="Edge of the mirror's voxels, metres, with --from-voxels.")
]
Storey = Annotated[str | None, Option(help="Only this storey.")]

# of plans and simulated missions

DomainFile = Annotated[Path | None, Option("--domain", help="YAML file of additional actions.")]
Start = Annotated[
    str | None,
    Option("--from", help="Room in which the robot starts; by default its room."),
]
Agent = Annotated[str, Option("--agent", help="Name of the robot in the map.")]
RobotName = Annotated[str | None, Option("--robot", help="Class of the robot (semmap robot).")]
Speed = Annotated[float, Option(help="Speed of the simulated clock; 1 is real time.")]
Fail = Annotated[
    list[str] | None,
    Option(help="'door5 locked', 'Lift 1 broken', 'pickup fails twice', 'drop fails .1'"),
]
Seed = Annotated[int, Option(help="Seed of random failures and detections.")]
Put = Annotated[
    list[str] | None,
    Option("--put", help="'mug on table1': where an object truly is; repeatable."),
]
WorldFile = Annotated[
    Path | None,
    Option(help="File with the state of the simulation; several robots may share it."),
]
Apply = Annotated[
    bool, Option("--apply", help="Write what happens into the map; by default into a copy.")
]
