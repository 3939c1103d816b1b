"""Options that commands about grids and robots share."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from navgrid.field_layer import FieldVoxels
    from semmap.geometry.voxels import Voxels
    from semmap.robot import Part

__all__ = [
    "AssumeSizes",
    "FieldNames",
    "FromVoxels",
    "MaxSlope",
    "MaxStep",
    "Moment",
    "NoFields",
    "Parts",
    "PolicyFile",
    "State",
    "Urdf",
    "VoxelSize",
    "fields_of",
    "moment_of",
    "parts_of",
    "voxels_of",
]

Urdf = Annotated[Path, typer.Option("--robot", help="The robot's URDF.")]
State = Annotated[
    str | None,
    typer.Option(
        help='Joint positions as JSON, {"arm_1_joint": 0.5}, a file, or a state of its SRDF.'
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


def voxels_of(connection: Any, from_voxels: bool, voxel_size: float) -> dict[int, Voxels] | None:
    """Return the voxels of the map as options choose them; None for its meshes."""
    from navgrid.readers.fields import read_mirror

    return read_mirror(connection, voxel_size) if from_voxels else None


def fields_of(connection: Any, names: list[str] | None, no_fields: bool) -> dict[str, FieldVoxels]:
    """Return the fields of the current map as options choose them.

    Raises
    ------
    ValueError
        Both options are given.
    LookupError
        There is no field of a given name.
    """
    from navgrid.readers.fields import LIVE, read_ended_fields, read_fields
    from semmap import cli

    if no_fields and names:
        raise ValueError("--field and --no-fields exclude each other: give one of them")
    if no_fields:
        return {}
    ended = [] if names else read_ended_fields(connection)
    if ended:
        cli.err.print(
            f"fields of sources without an update for {LIVE:.0f} s, not used: {', '.join(ended)}",
            style="yellow",
        )
    return read_fields(connection, names or None)


def moment_of(at: datetime | None) -> datetime:
    """Return the moment that an option names, in the local time zone by default; now for None."""
    if at is None:
        return datetime.now(UTC)
    return at if at.tzinfo else at.astimezone()


def parts_of(robot: Path, state: str | None = None, parts: Path | None = None) -> list[Part]:
    """Return the parts of a robot as options describe it.

    Parameters
    ----------
    robot : the URDF
    state : str, optional
        Joint positions as JSON, the name of a file that holds them, or that of a state in the
        SRDF of the robot.
    parts : Path, optional
        YAML that groups links into parts.

    Raises
    ------
    ValueError
        The state is not JSON of numbers, or the robot has no such joint or link.
    """
    from semmap.robot import load_robot, robot_parts  # loads trimesh
    from semmap.robot.joint_positions import joints_of

    return robot_parts(load_robot(robot), joints_of(robot, state), parts)
