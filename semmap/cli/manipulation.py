"""The commands `semmap grasp`, `place`, `push`, `open` and `turn`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Option

from semmap.cli.chosen import open_database
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json
from semmap.cli.output import print_json, show_table
from semmap.cli.texts import numbers

if TYPE_CHECKING:
    from semmap.manipulation.found_actions import FoundActions

COLUMNS = ("entity", "approach", "expected", "attempts", "width", "x", "y", "z", "contributor")
UNKNOWN_COLUMNS = ("approach", "expected", "width", "x", "y", "z")
PLACE_COLUMNS = ("entity", "on", "approach", "expected", "attempts", "clearance", "x", "y", "z")
PUSH_COLUMNS = ("entity", "direction", "expected", "attempts", "x", "y", "z", "contributor")
PART_COLUMNS = ("entity", "approach", "family", "expected", "attempts", "travel", "x", "y", "z")
BASE = "X,Y,YAW[,Z]"
HINGE, SLIDE = "X,Y,Z,DX,DY,DZ", "DX,DY,DZ"


@command_of("Map.grasps", name="[NAME]", for_="FUNCTION", check="--unchecked", base=BASE)
def grasp_command(
    call: MethodCall,
    shape: str | None = Option(
        None, metavar="SHAPE=SIZES", help="A shape alone: cylinder=0.03,0.1; metres."
    ),
    cloud: Path | None = Option(
        None, metavar="FILE", help="A cloud, z up (PLY, NPY): what stands there at --at."
    ),
    json_: Json = False,
) -> None:
    """Show how to grasp an object: stored grasps, the best first, else generated ones.

    semmap grasp cup --gripper pr2; semmap grasp --for drinking; semmap grasp --at 1.2,0.5,0.8
    semmap grasp cup1 --robot tiago --base 1.2,0.4,1.57 --plan
    semmap grasp --shape cylinder=0.03,0.1; semmap grasp --cloud scan.ply --at 0.1,0.2,0.75
    """
    if cloud is not None:
        if call.values.get("at") is None or shape is not None:
            raise typer.BadParameter("--cloud goes with --at: a point on the object")
        names = _alone(call, "--cloud", "at", "tolerance", "gripper", "limit")
        given = {key: call.texts[key] for key in names} | {"at": call.values["at"]}
        with open_database() as db:
            _show(db.grasps_in_cloud(cloud, **given), json_, UNKNOWN_COLUMNS, "")
        return
    if [shape, *map(call.values.get, ("name", "for_", "at"))].count(None) != 3:
        raise typer.BadParameter("give NAME, or one of --for, --at and --shape")
    if shape is None:
        made_for = None if "robot" in call.values else "grasps"
        _show(call(), json_, COLUMNS, made_for)
        return
    names = _alone(call, "--shape", "tolerance", "gripper", "kind", "limit", "stored")
    given = {key: call.texts[key] for key in names}
    with open_database() as db:
        _show(db.grasps_of_shape(*_shape(shape), **given), json_, COLUMNS[1:], "")


@command_of("Map.places", on="--on", base=BASE)
def place_command(call: MethodCall, json_: Json = False) -> None:
    """Show where and how to put an object down: stored places, the best first, else generated.

    semmap place cup1 --on table; semmap place cup1 --on table --gripper pr2 --towards 1.2,0.5
    semmap place cup1 --on table --robot tiago --base 1.2,0.4,1.57 --plan
    """
    _show(call(), json_, PLACE_COLUMNS, "places", "spot")


@command_of("Map.pushes", base=BASE)
def push_command(call: MethodCall, json_: Json = False) -> None:
    """Show how to push an object along what it stands on: stored pushes, else generated ones.

    semmap push book --distance 0.2; semmap push book --robot tiago --base 1.2,0.4,1.57 --plan
    """
    _show(call(), json_, PUSH_COLUMNS, "pushes")


@command_of("Map.openings", hinge=HINGE, slide=SLIDE, base=BASE)
def open_command(call: MethodCall, json_: Json = False) -> None:
    """Show how to open a door or drawer by its handle: stored ways, else generated ones.

    semmap open drawer1; semmap open door --hinge 1.2,0.4,0,0,0,1 --travel 1.57
    semmap open drawer1 --robot tiago --base 1.2,0.4,1.57 --plan
    """
    _show(call(), json_, PART_COLUMNS, "ways to open it")


@command_of("Map.turns", hinge=HINGE, base=BASE)
def turn_command(call: MethodCall, json_: Json = False) -> None:
    """Show how to push a door about its hinge with closed fingers; an open door is closed.

    semmap turn door; semmap turn door --robot tiago --base 1.2,0.4,1.57 --plan
    """
    _show(call(), json_, PART_COLUMNS, "ways to turn it")


def _alone(call: MethodCall, option: str, *names: str) -> tuple[str, ...]:
    """The options that go with one for an unknown object; BadParameter if others are given."""
    others = call.texts | {"kind": call.texts["kind"] != "grasp"}  # which is the default
    if any(read for key, read in others.items() if key not in names):
        *first, last = (f"--{name}" for name in names)
        raise typer.BadParameter(f"{option} goes with {', '.join(first)} and {last}")
    return names


def _show(
    found: FoundActions, json_: bool, columns: Sequence[str], made: str | None, where: str = "pose"
) -> None:
    """Print actions, with the position of one of their poses; exit with 1 where there is none.

    `made` names those that were generated: empty where they are not stored, None where that is not
    told.
    """
    for entity in () if made is None else found.generated:
        how = f"{made} generated and stored" if made else "grasps generated, none is stored"
        print(f"{entity}: {how}", file=sys.stderr)
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
        print_json([*found])
    elif found.rows:
        show_table([_short(row, where) for row in found], False, columns)
    if not found.rows:
        raise typer.Exit(1)


def _short(row: dict[str, Any], where: str) -> dict[str, Any]:
    pose = row[where] or (None, None, None)
    places = {axis: v if v is None else round(v, 3) for axis, v in zip("xyz", pose, strict=False)}
    rounded = {
        key: row[key] and round(row[key], 3)
        for key in ("expected", "width", "clearance", "link", "travel")
        if key in row
    }
    return {"attempts": 0, "contributor": None} | row | places | rounded


def _shape(given: str) -> tuple[str, tuple[float, ...]]:
    kind, equals, sizes = given.partition("=")
    if not equals:
        raise typer.BadParameter(f"--shape takes SHAPE=SIZES, such as sphere=0.04, not {given}")
    return kind, numbers(sizes, "--shape")
