"""Options that commands about grids and robots share."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from semmap.robot import Part

__all__ = [
    "MaxSlope",
    "MaxStep",
    "Moment",
    "Parts",
    "PolicyFile",
    "State",
    "Urdf",
    "moment_of",
    "parts_of",
]

Urdf = Annotated[Path, typer.Option("--robot", help="The robot's URDF.")]
State = Annotated[
    str | None, typer.Option(help='Joint positions as JSON, {"arm_1_joint": 0.5}, or a file.')
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
        Joint positions as JSON, or the name of a file that holds them.
    parts : Path, optional
        YAML that groups links into parts.

    Raises
    ------
    ValueError
        The state is not JSON of numbers, or the robot has no such joint or link.
    """
    from semmap.robot import load_robot, robot_parts  # loads trimesh

    return robot_parts(load_robot(robot), {} if state is None else _joints(state), parts)


def _joints(state: str) -> dict[str, float]:
    text = state
    if not state.lstrip().startswith("{"):
        try:
            text = Path(state).read_text("utf-8")
        except OSError as error:
            raise ValueError(
                f'--state {state}: is neither JSON nor a file ({error}); give {{"joint": number}}'
            ) from None
    try:
        joints = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f'--state: is not JSON ({error}); give {{"joint": number}}') from None
    if not isinstance(joints, dict) or not all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in joints.values()
    ):
        raise ValueError('--state: give joint positions as {"joint": number}')
    return joints
