"""How a command is told a robot: its URDF, its joints, what it drives over."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from semmap.robot import Part, load_robot, robot_parts

__all__ = ["MaxSlope", "MaxStep", "Parts", "State", "Urdf", "parts_of"]

Urdf = Annotated[Path, typer.Option("--robot", help="The robot's URDF.")]
State = Annotated[
    str | None, typer.Option(help='Joint positions as JSON, {"arm_1_joint": 0.5}, or a file.')
]
Parts = Annotated[
    Path | None, typer.Option(help="YAML that groups links into parts; by default found.")
]
MaxStep = Annotated[float, typer.Option(help="Metres it drives over.")]
MaxSlope = Annotated[float, typer.Option(help="Degrees it climbs.")]


def parts_of(robot: Path, state: str | None = None, parts: Path | None = None) -> list[Part]:
    """The parts of a URDF's robot for joint positions given as JSON or a file of it."""
    joints: object = {}
    if state is not None:
        said = state
        if not state.lstrip().startswith("{"):
            try:
                said = Path(state).read_text("utf-8")
            except OSError as error:
                raise ValueError(f"--state {state}: no JSON and no file: {error}") from None
        try:
            joints = json.loads(said)
        except json.JSONDecodeError as error:
            raise ValueError(f"--state: no JSON: {error}") from None
    if not isinstance(joints, dict) or not all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in joints.values()
    ):
        raise ValueError('--state: give joint positions as {"joint": number}')
    return robot_parts(load_robot(robot), joints, parts)
