"""Options that commands about grids and robots share."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from semmap.api.map import Map

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


def fields_of(house: Map, names: list[str] | None, no_fields: bool) -> list[str] | None:
    """Return the fields that options choose, None for all; note those whose sources ended."""
    from navgrid.readers.fields import LIVE
    from semmap import cli

    if no_fields and names:
        raise ValueError("--field and --no-fields exclude each other: give one of them")
    if no_fields:
        return []
    ended = [] if names else house.ended_fields
    if ended:
        cli.err.print(
            f"fields of sources without an update for {LIVE:.0f} s, not used: {', '.join(ended)}",
            style="yellow",
        )
    return names or None
