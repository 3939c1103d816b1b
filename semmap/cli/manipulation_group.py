"""The commands `semmap manipulation ...`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from typer import Argument

from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json
from semmap.cli.output import show_table

TASKS = ("id", "kind", "entity", "robot", "outcome", "action_id", "contributor", "message")


@command_of("Database.list_manipulators", can="--can")
def _robots(call: MethodCall, json_: Json = False) -> None:
    """List the stored robots with their grippers and sensors, and what they are able to do.

    semmap manipulation robots --can grasp --can see
    """
    rows = call()
    if not json_:
        lists = ("sensors", "capabilities")
        rows = [row | {key: ", ".join(row[key]) for key in lists} for row in rows]
    show_table(rows, json_, ("name", "gripper", "sensor", "sensors", "capabilities"))


@command_of("Database.list_grippers")
def _grippers(call: MethodCall, json_: Json = False) -> None:
    rows = call()
    for row in rows:
        row |= {key: round(row[key], 4) for key in ("opening", "depth")}
    show_table(rows, json_, ("name", "form", "opening", "depth", "force", "preferred", "actions"))


@command_of("Map.find_shapes", names="[NAME]...")
def _shapes(call: MethodCall, json_: Json = False) -> None:
    found = call()
    for problem in found.problems:
        print(problem, file=sys.stderr)
    rows = found.rows
    for row in rows:
        row["inliers"] = row["inliers"] and round(row["inliers"], 3)
        row["size"] = [round(v, 4) for v in row["size"]]
    if not json_:
        rows = [row | {"size": " x ".join(f"{v:g}" for v in row["size"])} for row in rows]
    show_table(rows, json_, ("entity", "shape", "size", "inliers"))


@command_of("Map.practise", open_="--open")
def _try(call: MethodCall, json_: Json = False) -> None:
    """Try actions on an object in simulation until one succeeds, and store what was learned.

    Grasps by default; with --on, --push, --open or --turn places, pushes, or ways to open or turn.
    """
    told: tuple[str, ...] = ("moved", "outcome", "stored")
    if "on" in call.values or call.values["push"]:
        told = ("off", "tilted", "outcome")
    elif call.values["open_"] or call.values["turn"]:
        told = ("opened", "outcome")
    show_table(call(), json_, ("action_id", "family", *told))


@command_of("Database.import_grasps", grippers="--gripper HAND=GRIPPER")
def _import_grasps(call: MethodCall) -> None:
    print(_counted(call()))


@command_of("Database.export_manipulation")
def _export(call: MethodCall) -> None:
    print(f"{call.values['path']}: {_counted(call())}")


@command_of("Database.import_manipulation", path=None)
def _import(call: MethodCall, files: list[Path] = Argument(help="Signed files.")) -> None:
    """Store the knowledge of signed files: each as a whole, from those whom you trust."""
    for file in files:
        print(f"{file}: {_counted(call(path=file))}")


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.items())


manipulation_command = group(
    printed("Database.add_gripper", "{0}"),
    printed("Database.add_manipulator", "{0}", posture="--state"),
    _robots,
    _grippers,
    _shapes,
    printed("Map.record_attempt", "task {0}: {outcome}"),
    _try,
    printed("Map.list_manipulations", TASKS),
    _import_grasps,
    _export,
    _import,
    printed("Database.manipulation_key", "{0}"),
    printed("Database.trust_contributor", ""),
    printed(
        "Database.list_contributors", ("name", "trust", "actions", "attempts", "latest", "key")
    ),
)
