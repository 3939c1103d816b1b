"""The commands `semmap grasp`, `place` and `push`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.option_group import grouped
from semmap.cli.texts import numbers

if TYPE_CHECKING:
    from semmap.manipulation.found_actions import FoundActions

# NumPy and the libraries of the extra are slow to import: the functions below import what they use.

Gripper = Annotated[
    str | None,
    Option(help="Name of a stored gripper, or a URDF; by default the preferred one."),
]
Limit = Annotated[int, Option(min=1, help="The most rows.")]


COLUMNS = ("entity", "approach", "expected", "attempts", "width", "x", "y", "z", "contributor")
PLACE_COLUMNS = ("entity", "on", "approach", "expected", "attempts", "clearance", "x", "y", "z")
PUSH_COLUMNS = ("entity", "direction", "expected", "attempts", "x", "y", "z", "contributor")


@dataclass(frozen=True)
class Acting:
    """A robot that acts, and whether its motion is planned."""

    robot: str | None = Option(
        None, help="Only what its arm reaches: a stored robot, or the URDF of one."
    )
    base: str | None = Option(
        None, metavar="X,Y,YAW[,Z]", help="Where the robot stands; by default its pose in the map."
    )
    plan: bool = Option(False, "--plan", help="Plan the arm's motion to the first grasp.")
    state: str | None = Option(
        None, help="Its joints before the motion, as JSON; by default at rest."
    )

    def arguments(self, gripper: str | None = None) -> dict[str, Any]:
        """What `Map.grasps` and others take of a robot."""
        robot, state = self.robot, self.state
        if robot is None and (self.plan or self.base or state):
            raise typer.BadParameter("--base, --plan and --state are for a --robot")
        if robot is not None and gripper is not None:
            raise typer.BadParameter(
                "--robot has its own gripper: give one of --robot and --gripper"
            )
        try:
            joints = {k: float(v) for k, v in json.loads(state).items()} if state else None
        except (ValueError, AttributeError, TypeError):
            raise typer.BadParameter(
                f'--state takes JSON, {{"joint": 0.5}}, with a number for each joint, not {state}'
            ) from None
        where = None if self.base is None else numbers(self.base, "--base")
        return {"robot": robot, "base": where, "plan": self.plan, "state": joints}


@dataclass(frozen=True)
class Placing(Acting):
    """A robot with an object in its gripper."""

    plan: bool = Option(False, "--plan", help="Plan the arm's motion with the object.")


@dataclass(frozen=True)
class Pushing(Acting):
    """A robot that pushes."""

    plan: bool = Option(False, "--plan", help="Plan the arm's motion to and along the first push.")


@grouped
def grasp_command(
    *,
    name: str | None = Argument(None, help="An object, or a type: any such object."),
    for_: str | None = Option(None, "--for", metavar="FUNCTION", help="Any object for: drinking."),
    at: str | None = Option(None, metavar="X,Y,Z", help="The object at a point; metres."),
    shape: str | None = Option(
        None, metavar="SHAPE=SIZES", help="A shape alone: cylinder=0.03,0.1; metres."
    ),
    tolerance: float | None = Option(
        None, help="Of --at (0.05) and of each size of --shape (0.01); metres."
    ),
    gripper: Gripper = None,
    kind: str = Option("grasp", help="grasp, or stored: place, push, turn, open, put."),
    stored: bool = Option(False, "--stored", help="Only what is stored: generate nothing."),
    unchecked: bool = Option(False, "--unchecked", help="Also grasps that touch what is around."),
    acting: Acting,
    limit: Limit = 10,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show how to grasp an object: stored grasps, the best first, else generated ones.

    semmap grasp cup --gripper pr2; semmap grasp --for drinking; semmap grasp --at 1.2,0.5,0.8
    semmap grasp cup1 --robot tiago --base 1.2,0.4,1.57 --plan
    """
    if sum(given is not None for given in (name, for_, at, shape)) != 1:
        raise typer.BadParameter("give NAME, or one of --for, --at and --shape")
    robot = acting.arguments()
    if acting.robot is not None and (shape or gripper or stored or unchecked or kind != "grasp"):
        raise typer.BadParameter("--robot is for grasps with its own gripper, of objects")
    asked: Any = {"gripper": gripper, "kind": kind, "limit": limit, "tolerance": tolerance}
    with cli.open_database() as db:
        if shape is not None:
            found = db.grasps_of_shape(*_shape(shape), **asked)
        else:
            asked |= {"for_": for_, "at": None if at is None else numbers(at, "--at")}
            asked |= {"stored": stored, "check": not unchecked}
            found = db.map(map_name).grasps(name, **asked, **robot)
    made = "grasps" if acting.robot is None else ""
    _show(found, json_, COLUMNS[shape is not None :], made)


@grouped
def place_command(
    *,
    name: str = Argument(help="The object."),
    on: str = Option(..., "--on", help="What it is put on, such as a table."),
    gripper: Gripper = None,
    towards: str | None = Option(None, metavar="X,Y", help="Spots near this point first; metres."),
    acting: Placing,
    limit: Limit = 10,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show where and how to put an object down: stored places, the best first, else generated.

    semmap place cup1 --on table; semmap place cup1 --on table --gripper pr2 --towards 1.2,0.5
    semmap place cup1 --on table --robot tiago --base 1.2,0.4,1.57 --plan
    """
    point = None if towards is None else numbers(towards, "--towards")
    if point is not None and len(point) != 2:
        raise typer.BadParameter(f"--towards takes X,Y, not {towards}")
    robot = acting.arguments(gripper)
    with cli.open_database() as db:
        found = db.map(map_name).places(
            name, on, gripper=gripper, towards=point, limit=limit, **robot
        )
    _show(found, json_, PLACE_COLUMNS, "places", "spot")


@grouped
def push_command(
    *,
    name: str = Argument(help="The object."),
    gripper: Gripper = None,
    distance: float = Option(0.1, help="How far it is pushed; metres."),
    acting: Pushing,
    limit: Limit = 10,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show how to push an object along what it stands on: stored pushes, else generated ones.

    semmap push book --distance 0.2; semmap push book --robot tiago --base 1.2,0.4,1.57 --plan
    """
    robot = acting.arguments(gripper)
    with cli.open_database() as db:
        found = db.map(map_name).pushes(
            name, gripper=gripper, distance=distance, limit=limit, **robot
        )
    _show(found, json_, PUSH_COLUMNS, "pushes")


def _show(
    found: FoundActions, json_: bool, columns: Sequence[str], made: str, where: str = "pose"
) -> None:
    """Print actions, with the position of one of their poses; exit with 1 where there is none.

    `made` names those that were generated; it is empty where that is not told.
    """
    for entity in found.generated if made else ():
        print(f"{entity}: {made} generated and stored", file=sys.stderr)
    if (motion := found.motion) is not None:
        how = "stored before" if motion.reused else f"planned in {motion.seconds:.1f} s"
        count = len(motion.to_pre_grasp)
        text = f"path {motion.path}: {count} positions, {how}; then straight on"
        print(text, file=sys.stderr)
    for problem in found.problems:
        print(problem, file=sys.stderr)
    of_grasps = "width" in columns
    if of_grasps and any(row.get("link") is not None for row in found):
        columns = (*columns, "link")
    if json_:
        cli.print_json([*found])
    elif found.rows:
        cli.show_table([_short(row, where) for row in found], False, columns)
    if not found.rows:
        raise typer.Exit(1)


def _short(row: dict[str, Any], where: str) -> dict[str, Any]:
    pose = row[where] or (None, None, None)
    places = {axis: v if v is None else round(v, 3) for axis, v in zip("xyz", pose, strict=False)}
    rounded = {
        key: row[key] and round(row[key], 3)
        for key in ("expected", "width", "clearance", "link")
        if key in row
    }
    return {"attempts": 0, "contributor": None} | row | places | rounded


def _shape(given: str) -> tuple[str, tuple[float, ...]]:
    kind, equals, sizes = given.partition("=")
    if not equals:
        raise typer.BadParameter(f"--shape takes SHAPE=SIZES, such as sphere=0.04, not {given}")
    return kind, numbers(sizes, "--shape")
