"""Options that several commands have."""

from typing import Annotated

from typer import Option

MapName = Annotated[
    str | None,
    Option("--map", envvar="SEMMAP_MAP", help="The map; not needed where there is one only."),
]
Json = Annotated[bool, Option("--json", help="Print JSON.")]
VoxelSize = Annotated[float, Option(help="Edge of a voxel in metres.")]
