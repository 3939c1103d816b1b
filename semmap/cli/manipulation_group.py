"""The commands `semmap manipulation ...`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.manipulation import Gripper, Limit
from semmap.cli.texts import numbers

manipulation = typer.Typer(
    no_args_is_help=True, help="Grippers, shapes, outcomes, and sharing of manipulation knowledge."
)


@manipulation.command("add-gripper")
def add_gripper(
    urdf: Path = Argument(help="URDF of a gripper, or of a robot that has one."),
    name: str | None = Option(None, help="By default that of the robot."),
    palm: str | None = Option(None, help="The link that holds the fingers; by default the first."),
    prefer: bool | None = Option(None, help="Meant where none is named; the first one is."),
) -> None:
    """Store the gripper of a URDF, for which grasps are stored and generated."""
    with cli.open_database() as db:
        print(db.add_gripper(urdf, name, palm=palm, prefer=prefer))


@manipulation.command("add-robot")
def add_robot(
    urdf: Path = Argument(help="URDF of a robot with an arm and a gripper."),
    name: str | None = Option(None, help="By default that in the URDF."),
    palm: str | None = Option(None, help="The link that holds the fingers; by default the first."),
    state: str | None = Option(
        None,
        help="Joint positions with which it drives and carries: JSON, a file, or a state of "
        "its SRDF; by default, some that keep the arm near the robot.",
    ),
) -> None:
    """Store a robot with its arm, gripper and sensors, for --robot and missions of its class."""
    with cli.open_database() as db:
        print(db.add_manipulator(urdf, name, palm=palm, posture=state))


@manipulation.command()
def robots(
    can: list[str] | None = Option(
        None, help="Only those able to: grasp, push, ..., see, feel; repeatable."
    ),
    json_: cli.Json = False,
) -> None:
    """List the stored robots with their grippers and sensors, and what they are able to do.

    semmap manipulation robots --can grasp --can see
    """
    with cli.open_database() as db:
        rows = db.list_manipulators(can or ())
    if not json_:
        lists = ("sensors", "capabilities")
        rows = [row | {key: ", ".join(row[key]) for key in lists} for row in rows]
    cli.show_table(rows, json_, ("name", "gripper", "sensor", "sensors", "capabilities"))


@manipulation.command()
def grippers(json_: cli.Json = False) -> None:
    """List the stored grippers."""
    with cli.open_database() as db:
        rows = db.list_grippers()
    for row in rows:
        row |= {key: round(row[key], 4) for key in ("opening", "depth")}
    cli.show_table(rows, json_, ("name", "form", "opening", "depth", "preferred", "actions"))


@manipulation.command()
def shapes(
    names: list[str] | None = Argument(None, metavar="[NAME]...", help="By default all objects."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Find and store the primitive of each model of the map: sphere, cylinder, cone, cuboid."""
    with cli.open_database() as db:
        found = db.map(map_name).find_shapes(names or None)
    for problem in found.problems:
        print(problem, file=sys.stderr)
    rows = found.rows
    for row in rows:
        row["inliers"] = row["inliers"] and round(row["inliers"], 3)
        row["size"] = [round(v, 4) for v in row["size"]]
    if not json_:
        rows = [row | {"size": " x ".join(f"{v:g}" for v in row["size"])} for row in rows]
    cli.show_table(rows, json_, ("entity", "shape", "size", "inliers"))


@manipulation.command()
def record(
    name: str = Argument(help="The object."),
    action: int = Argument(help="The action_id that `semmap grasp --json` prints."),
    outcome: str = Argument(help="completed or error."),
    kind: str = Option("grasp", help="grasp, place, push, turn, open or put."),
    instead_of: int | None = Option(None, help="The action that failed and is replaced."),
    robot: str | None = Option(None, help="The agent that acted."),
    message: str | None = Option(None, help="Why it failed."),
    simulated: bool = Option(False, "--simulated", help="It counts less."),
    map_name: cli.MapName = None,
) -> None:
    """Store how an attempt ended; later queries propose what succeeds most."""
    told: Any = {"kind": kind, "instead_of": instead_of, "robot": robot}
    told |= {"message": message, "simulated": simulated}
    with cli.open_database() as db:
        task = db.map(map_name).record_attempt(name, action, outcome, **told)
    print(f"task {task}: {outcome}")


@manipulation.command("try")
def try_command(
    name: str = Argument(help="The object."),
    gripper: Gripper = None,
    tries: int = Option(12, min=1, help="The most attempts."),
    mass: float | None = Option(None, help="kg; by default the object's property, else by volume."),
    friction: float = Option(0.5, help="Between the pads and the object."),
    on: str | None = Option(None, metavar="NAME", help="Try places of the object on this one."),
    push: bool = Option(False, "--push", help="Try pushes of the object."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Try actions on an object in simulation until one succeeds, and store what was learned.

    Grasps by default; with --on or --push, places or pushes.
    """
    if on is not None and push:
        raise typer.BadParameter("give one of --on and --push")
    with cli.open_database() as db:
        rows = db.map(map_name).practise(
            name, on=on, push=push, gripper=gripper, tries=tries, mass=mass, friction=friction
        )
    grasps = on is None and not push
    told = ("moved", "outcome", "stored") if grasps else ("off", "tilted", "outcome")
    cli.show_table(rows, json_, ("action_id", "family", *told))


@manipulation.command()
def tasks(limit: Limit = 20, map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the newest manipulations of the map with their outcomes."""
    with cli.open_database() as db:
        rows = db.map(map_name).list_manipulations(limit)
    columns = ("id", "kind", "entity", "robot", "outcome", "action_id", "contributor", "message")
    cli.show_table(rows, json_, columns)


@manipulation.command("import-grasps")
def import_grasps(
    files: list[Path] = Argument(help="CSV, JSON or pg_dump of grasps and of their models."),
    gripper: list[str] | None = Option(
        None, metavar="HAND=GRIPPER", help="A stored gripper; repeatable."
    ),
    tool: str | None = Option(
        None,
        metavar="X,Y,Z,QX,QY,QZ,QW",
        help="The grasp frame in the frame of the file's hand; by default the same.",
    ),
    scale: float = Option(1.0, help="Metres per unit: 0.001 for millimetres."),
) -> None:
    """Store grasps of the Household Objects Database, or of a file with its columns."""
    hands = dict(pair.split("=", 1) for pair in gripper or () if "=" in pair)
    if len(hands) != len(gripper or ()):
        raise typer.BadParameter("--gripper takes HAND=GRIPPER")
    pose = None if tool is None else numbers(tool, "--tool")
    with cli.open_database() as db:
        counts = db.import_grasps(files, hands, tool=pose, scale=scale)
    print(_counted(counts))


@manipulation.command("export")
def export_command(
    file: Path,
    name: str | None = Option(None, help="Of the contributor; by default that of this machine."),
    simulated: bool = Option(False, "--simulated", help="With outcomes of simulated robots."),
) -> None:
    """Write what this database learned to a signed file, for other robots."""
    with cli.open_database() as db:
        counts = db.export_manipulation(file, name or None, simulated=simulated)
    print(f"{file}: {_counted(counts)}")


@manipulation.command("import")
def import_command(files: list[Path]) -> None:
    """Store the knowledge of signed files: each as a whole, from those whom you trust."""
    with cli.open_database() as db:
        for file in files:
            print(f"{file}: {_counted(db.import_manipulation(file))}")


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.items())


@manipulation.command()
def key() -> None:
    """Print the public key with which `export` signs; others trust it."""
    from semmap.api.database import Database

    print(Database.manipulation_key())


@manipulation.command("trust")
def trust_command(
    name: str,
    key: str = Argument(help="64 digits that `semmap manipulation key` prints."),
    level: float = Option(1.0, help="How much outcomes count; 0: refuse bundles."),
) -> None:
    """Trust a contributor, so that its files can be imported."""
    with cli.open_database() as db:
        db.trust_contributor(name, key, level)


@manipulation.command()
def contributors(json_: cli.Json = False) -> None:
    """List whose knowledge the database has, and how much it is trusted."""
    with cli.open_database() as db:
        rows = db.list_contributors()
    cli.show_table(rows, json_, ("name", "trust", "actions", "attempts", "latest", "key"))
