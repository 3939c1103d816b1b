"""Options that several commands have."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Option

MapName = Annotated[
    str | None,
    Option("--map", envvar="SEMMAP_MAP", help="The map; not needed where there is one only."),
]
Json = Annotated[bool, Option("--json", help="Print JSON.")]

Urdf = Annotated[Path, Option("--robot", help="The robot's URDF.")]
State = Annotated[
    str | None,
    Option(
        help='Joint positions as JSON, {"arm_1_joint": 0.5}, a file, or a state of its SRDF; by '
        "default the stored posture, or one near its axis that is found."
    ),
]
Parts = Annotated[Path | None, Option(help="YAML that groups links into parts; by default found.")]
PolicyFile = Annotated[
    Path | None, Option("--policy", help="YAML: which entity goes on which layer.")
]
AssumeSizes = Annotated[
    bool,
    Option("--assume-sizes", help="Give objects without geometry a typical box."),
]
Storey = Annotated[str | None, Option(help="Only this storey.")]

DomainFile = Annotated[Path | None, Option("--domain", help="YAML file of additional actions.")]


@dataclass(frozen=True)
class Ground:
    """What a robot drives over."""

    max_step: float = Option(0.02, help="The highest step that it drives over, metres.")
    max_slope: float = Option(6.0, help="The steepest slope that it climbs, degrees.")
