"""The commands `semmap grasp`, `place`, `push` and `manipulation`."""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from semmap import cli

if TYPE_CHECKING:
    from semmap.manipulation.arm_motions import ArmMotion

__all__ = ["grasp_command", "manipulation", "place_command", "push_command"]

# NumPy and the libraries of the extra are slow to import: the functions below import what they use.

Gripper = Annotated[
    str | None,
    typer.Option(help="Name of a stored gripper, or a URDF; by default the preferred one."),
]
Robot = Annotated[
    str | None, typer.Option(help="Only what its arm reaches: a stored robot, or the URDF of one.")
]
Base = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,YAW[,Z]", help="Where the robot stands; by default its pose in the map."
    ),
]
State = Annotated[
    str | None,
    typer.Option(help="Its joints before the motion, as JSON; by default at rest."),
]
Limit = Annotated[int, typer.Option(min=1, help="The most rows.")]
PLANNED = 40
"""Actions within reach among which one is chosen whose motion is free."""

COLUMNS = ("entity", "approach", "expected", "attempts", "width", "x", "y", "z", "contributor")
PLACE_COLUMNS = ("entity", "on", "approach", "expected", "attempts", "clearance", "x", "y", "z")
PUSH_COLUMNS = ("entity", "direction", "expected", "attempts", "x", "y", "z", "contributor")


def grasp_command(
    name: Annotated[
        str | None, typer.Argument(help="An object, or a type: any such object.")
    ] = None,
    for_: Annotated[
        str | None, typer.Option("--for", metavar="FUNCTION", help="Any object for: drinking.")
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="The object at a point; metres.")
    ] = None,
    shape: Annotated[
        str | None,
        typer.Option(metavar="SHAPE=SIZES", help="A shape alone: cylinder=0.03,0.1; metres."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Of --at (0.05) and of each size of --shape (0.01); metres."),
    ] = None,
    gripper: Gripper = None,
    kind: Annotated[
        str, typer.Option(help="grasp, or stored: place, push, turn, open, put.")
    ] = "grasp",
    stored: Annotated[
        bool, typer.Option("--stored", help="Only what is stored: generate and store nothing.")
    ] = False,
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="Also grasps that touch what is around.")
    ] = False,
    robot: Robot = None,
    base: Base = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Plan the arm's motion to the first grasp.")
    ] = False,
    state: State = None,
    limit: Limit = 10,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show how to grasp an object: stored grasps, the best first, else generated ones.

    semmap grasp cup --gripper pr2; semmap grasp --for drinking; semmap grasp --at 1.2,0.5,0.8
    semmap grasp cup1 --robot tiago --base 1.2,0.4,1.57 --plan
    """
    from semmap.manipulation.linked import fitting_rows
    from semmap.manipulation.reader import actions_by_shape, actions_on
    from semmap.manipulation.retrieval import find_grasps

    if sum(given is not None for given in (name, for_, at, shape)) != 1:
        raise typer.BadParameter("give NAME, or one of --for, --at and --shape")
    _check_robot(robot, base, state, plan=plan)
    if robot is not None and (shape or gripper or stored or unchecked or kind != "grasp"):
        raise typer.BadParameter("--robot is for grasps with its own gripper, of objects")
    with cli.open_database() as db:
        session = db.session if shape else db.map(map_name).connection
        with session.transaction():
            chosen = _gripper(session, gripper)
            if shape is not None:
                kind_of, sizes = _shape(shape)
                rows = actions_by_shape(
                    session,
                    kind_of,
                    sizes,
                    tolerance=0.01 if tolerance is None else tolerance,
                    gripper=chosen,
                    kind=kind,
                    limit=limit,
                )
                problems = [] if rows else [f"no {kind} of a similar {kind_of} is stored"]
            else:
                asked: dict[str, Any] = {
                    "name": name,
                    "function": for_,
                    "point": None if at is None else _numbers(at, "--at"),
                    "tolerance": 0.05 if tolerance is None else tolerance,
                    "gripper": chosen,
                    "limit": limit,
                }
                if robot is not None:
                    rows, problems = _reached(session, asked, robot, base, state, plan=plan)
                elif stored or kind != "grasp":
                    rows, problems = fitting_rows(session, actions_on(session, kind=kind, **asked))
                    if not rows and not problems:
                        problems = [f"no {kind} is stored for such an object"]
                else:
                    found = find_grasps(session, **asked, check=not unchecked)
                    rows, problems = found.rows, found.problems
                    for entity in found.generated:
                        print(f"{entity}: grasps generated and stored", file=sys.stderr)
    if not rows and not problems:
        problems = [f"the map has no {name or f'object for {for_}'}"]
    columns = COLUMNS[shape is not None :]
    if any(row.get("link") is not None for row in rows):
        columns = (*columns, "link")
    _show(rows, problems, json_, columns)


def _reached(
    session: Any,
    asked: dict[str, Any],
    robot: str,
    base: str | None,
    state: str | None,
    *,
    plan: bool,
) -> tuple[list[dict[str, Any]], list[str]]:
    """Grasps that a robot reaches, the one of the motion first; and why there is none."""
    from semmap.manipulation.arm_motions import plan_grasp
    from semmap.manipulation.automata import reachable_rows
    from semmap.manipulation.retrieval import find_grasps

    used = _Used.of(session, robot, base)
    limit = asked["limit"]
    found = find_grasps(session, **asked | {"gripper": used.gripper, "limit": 1000})
    most = max(limit, PLANNED) if plan else limit
    rows = reachable_rows(found.rows, used.arm, used.base, most)
    if found.rows and not rows:
        where = f"{used.base.x:g}, {used.base.y:g}"
        problem = f"{used.name} reaches none of {len(found.rows)} free grasps from ({where})"
        return [], [*found.problems, problem]
    if not plan or not rows:
        return rows, found.problems
    motion = plan_grasp(session, used.name, used.base, rows, state=_state(state))
    rows, problems = _moved(
        motion, used.name, rows, ("to_pre_grasp", "approach_positions", "retreat_positions")
    )
    return rows, [*found.problems, *problems]


class _Used(NamedTuple):
    """A robot that acts: its name, gripper and arm, and where it stands."""

    name: str
    gripper: str
    arm: Any
    base: Any

    @classmethod
    def of(cls, session: Any, robot: str, base: str | None) -> _Used:
        """A stored robot, or that of a URDF, which is stored first."""
        from semmap.manipulation.automata import base_pose, register_robot, stored_arm

        if robot.endswith((".urdf", ".xml")):
            robot = register_robot(session, Path(robot))
        gripper, arm = stored_arm(session, robot)
        at = base_pose(session, robot, None if base is None else _numbers(base, "--base"))
        return cls(robot, gripper, arm, at)


def _check_robot(
    robot: str | None,
    base: str | None,
    state: str | None,
    *,
    plan: bool,
    gripper: str | None = None,
) -> None:
    if robot is None and (plan or base or state):
        raise typer.BadParameter("--base, --plan and --state are for a --robot")
    if robot is not None and gripper is not None:
        raise typer.BadParameter("--robot has its own gripper: give one of --robot and --gripper")


def _moved(
    motion: ArmMotion | None, robot: str, rows: Sequence[Any], keys: Sequence[str]
) -> tuple[list[dict[str, Any]], list[str]]:
    """The row of a motion with its positions under these keys; and why there is none."""
    if motion is None:
        return [], [f"{robot}: no motion to one of {len(rows)} within reach was found"]
    told: dict[str, Any] = {"joints": list(motion.joints), "path": motion.path}
    pieces = (motion.to_pre_grasp, motion.approach, motion.after, motion.back)
    told |= {
        key: positions.tolist()
        for key, positions in zip((*keys, "back_positions"), pieces, strict=True)
        if len(positions)
    }
    how = "stored before" if motion.reused else f"planned in {motion.seconds:.1f} s"
    count = len(motion.to_pre_grasp)
    print(f"path {motion.path}: {count} positions, {how}; then straight on", file=sys.stderr)
    return [motion.row | told], []


def _state(given: str | None) -> dict[str, float]:
    try:
        state = {} if given is None else {k: float(v) for k, v in json.loads(given).items()}
    except (ValueError, AttributeError, TypeError):
        raise typer.BadParameter(
            f'--state takes JSON, {{"joint": 0.5}}, with a number for each joint, not {given}'
        ) from None
    return state


def place_command(
    name: Annotated[str, typer.Argument(help="The object.")],
    on: Annotated[str, typer.Option("--on", help="What it is put on, such as a table.")],
    gripper: Gripper = None,
    towards: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Spots near this point first; metres.")
    ] = None,
    robot: Robot = None,
    base: Base = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Plan the arm's motion, with the object in the gripper.")
    ] = False,
    state: State = None,
    limit: Limit = 10,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show where and how to put an object down: stored places, the best first, else generated.

    semmap place cup1 --on table; semmap place cup1 --on table --gripper pr2 --towards 1.2,0.5
    semmap place cup1 --on table --robot tiago --base 1.2,0.4,1.57 --plan
    """
    from semmap.manipulation.arm_motions import plan_place
    from semmap.manipulation.places import find_places

    point = None if towards is None else _numbers(towards, "--towards")
    if point is not None and len(point) != 2:
        raise typer.BadParameter(f"--towards takes X,Y, not {towards}")
    _check_robot(robot, base, state, plan=plan, gripper=gripper)
    with cli.open_database() as db:
        session = db.map(map_name).connection
        with session.transaction():
            used = None if robot is None else _Used.of(session, robot, base)
            found = find_places(
                session,
                name,
                on,
                gripper=_gripper(session, gripper) if used is None else used.gripper,
                towards=point,
                arm=used and used.arm,
                base=used and used.base,
                limit=max(limit, PLANNED) if plan else limit,
            )
            rows, problems = found.rows, found.problems
            if used is not None and plan and rows:
                motion = plan_place(session, used.name, used.base, rows, state=_state(state))
                keys = ("to_pre_place", "approach_positions", "retreat_positions")
                rows, problems = _moved(motion, used.name, rows, keys)
    if found.generated:
        print(f"{name}: places generated and stored", file=sys.stderr)
    _show(rows, problems, json_, PLACE_COLUMNS, "spot")


def push_command(
    name: Annotated[str, typer.Argument(help="The object.")],
    gripper: Gripper = None,
    distance: Annotated[float, typer.Option(help="How far it is pushed; metres.")] = 0.1,
    robot: Robot = None,
    base: Base = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Plan the arm's motion to the first push, and along it.")
    ] = False,
    state: State = None,
    limit: Limit = 10,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show how to push an object along what it stands on: stored pushes, else generated ones.

    semmap push book --distance 0.2; semmap push book --robot tiago --base 1.2,0.4,1.57 --plan
    """
    from semmap.manipulation.arm_motions import plan_push
    from semmap.manipulation.pushes import find_pushes

    _check_robot(robot, base, state, plan=plan, gripper=gripper)
    with cli.open_database() as db:
        session = db.map(map_name).connection
        with session.transaction():
            used = None if robot is None else _Used.of(session, robot, base)
            found = find_pushes(
                session,
                name,
                gripper=_gripper(session, gripper) if used is None else used.gripper,
                distance=distance,
                arm=used and used.arm,
                base=used and used.base,
                limit=max(limit, PLANNED) if plan else limit,
            )
            rows, problems = found.rows, found.problems
            if used is not None and plan and rows:
                motion = plan_push(session, used.name, used.base, rows, state=_state(state))
                keys = ("to_pre_push", "approach_positions", "push_positions")
                rows, problems = _moved(motion, used.name, rows, keys)
    if found.generated:
        print(f"{name}: pushes generated and stored", file=sys.stderr)
    _show(rows, problems, json_, PUSH_COLUMNS)


def _show(
    rows: list[dict[str, Any]],
    problems: Sequence[str],
    json_: bool,
    columns: Sequence[str],
    where: str = "pose",
) -> None:
    """Print actions, with the position of one of their poses; exit with 1 where there is none."""
    for problem in problems:
        print(problem, file=sys.stderr)
    if json_:
        cli.print_json([_plain(row) for row in rows])
    elif rows:
        cli.show_table([_short(row, where) for row in rows], False, columns)
    if not rows:
        raise typer.Exit(1)


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """A row for JSON: poses as seven numbers (x, y, z, qx, qy, qz, qw)."""
    poses = ("pose", "pre_pose", "post_pose", "model_pose", "spot", "end")
    return {
        key: list(value) if key in poses and value is not None else value
        for key, value in row.items()
    }


def _short(row: dict[str, Any], where: str) -> dict[str, Any]:
    pose = row[where] or (None, None, None)
    places = {axis: v if v is None else round(v, 3) for axis, v in zip("xyz", pose, strict=False)}
    numbers = ("expected", "width", "clearance", "link")
    rounded = {key: row[key] and round(row[key], 3) for key in numbers if key in row}
    return {"attempts": 0, "contributor": None} | row | places | rounded


def _gripper(session: Any, given: str | None) -> str | None:
    """The name of a gripper; that of a URDF is stored first."""
    from semmap.manipulation.retrieval import register_gripper

    if given is None or not given.endswith((".urdf", ".xml")):
        return given
    return register_gripper(session, Path(given))


def _shape(given: str) -> tuple[str, list[float]]:
    kind, equals, sizes = given.partition("=")
    if not equals:
        raise typer.BadParameter(f"--shape takes SHAPE=SIZES, such as sphere=0.04, not {given}")
    return kind, _numbers(sizes, "--shape")


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(v) for v in text.split(",")]
    except ValueError:
        raise typer.BadParameter(
            f"{option} takes numbers with commas between, not {text}"
        ) from None


manipulation = typer.Typer(
    no_args_is_help=True, help="Grippers, shapes, outcomes, and sharing of manipulation knowledge."
)


@manipulation.command("add-gripper")
def add_gripper(
    urdf: Annotated[Path, typer.Argument(help="URDF of a gripper, or of a robot that has one.")],
    name: Annotated[str | None, typer.Option(help="By default that of the robot.")] = None,
    palm: Annotated[
        str | None, typer.Option(help="The link that holds the fingers; by default the first.")
    ] = None,
    prefer: Annotated[
        bool | None,
        typer.Option("--prefer/--no-prefer", help="Meant where none is named; the first one is."),
    ] = None,
) -> None:
    """Store the gripper of a URDF, for which grasps are stored and generated."""
    from semmap.manipulation.retrieval import register_gripper

    with cli.open_database() as db:
        print(register_gripper(db.session, urdf, name, palm=palm, preferred=prefer))


@manipulation.command("add-robot")
def add_robot(
    urdf: Annotated[Path, typer.Argument(help="URDF of a robot with an arm and a gripper.")],
    name: Annotated[str | None, typer.Option(help="By default that in the URDF.")] = None,
    palm: Annotated[
        str | None, typer.Option(help="The link that holds the fingers; by default the first.")
    ] = None,
    state: Annotated[
        str | None,
        typer.Option(
            help="Joint positions with which it drives and carries: JSON, a file, or a state of "
            "its SRDF; by default, some that keep the arm near the robot."
        ),
    ] = None,
) -> None:
    """Store a robot with its arm, gripper and sensors, for --robot and missions of its class."""
    from semmap.manipulation.automata import register_robot
    from semmap.robot.joint_positions import joints_of

    posture = None if state is None else joints_of(urdf, state)
    with cli.open_database() as db:
        print(register_robot(db.session, urdf, name, palm=palm, posture=posture))


@manipulation.command()
def robots(
    can: Annotated[
        list[str] | None,
        typer.Option(help="Only those able to: grasp, push, ..., see, feel; repeatable."),
    ] = None,
    json_: cli.Json = False,
) -> None:
    """List the stored robots with their grippers and sensors, and what they are able to do.

    semmap manipulation robots --can grasp --can see
    """
    from semmap.manipulation.reader import list_automata

    with cli.open_database() as db:
        rows = list_automata(db.session, can or ())
    if not json_:
        lists = ("sensors", "capabilities")
        rows = [row | {key: ", ".join(row[key]) for key in lists} for row in rows]
    cli.show_table(rows, json_, ("name", "gripper", "sensor", "sensors", "capabilities"))


@manipulation.command()
def grippers(json_: cli.Json = False) -> None:
    """List the stored grippers."""
    from semmap.manipulation.reader import list_grippers

    with cli.open_database() as db:
        rows = list_grippers(db.session)
    for row in rows:
        row |= {key: round(row[key], 4) for key in ("opening", "depth")}
    cli.show_table(rows, json_, ("name", "form", "opening", "depth", "preferred", "actions"))


@manipulation.command()
def shapes(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="By default all objects.")
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Find and store the primitive of each model of the map: sphere, cylinder, cone, cuboid."""
    from semmap.manipulation.store.shapes import store_shapes

    with cli.open_database() as db:
        rows, problems = store_shapes(db.map(map_name).connection, names or None)
    for problem in problems:
        print(problem, file=sys.stderr)
    for row in rows:
        row["inliers"] = row["inliers"] and round(row["inliers"], 3)
        row["size"] = [round(v, 4) for v in row["size"]]
    if not json_:
        rows = [row | {"size": " x ".join(f"{v:g}" for v in row["size"])} for row in rows]
    cli.show_table(rows, json_, ("entity", "shape", "size", "inliers"))


@manipulation.command()
def record(
    name: Annotated[str, typer.Argument(help="The object.")],
    action: Annotated[int, typer.Argument(help="The action_id that `semmap grasp --json` prints.")],
    outcome: Annotated[str, typer.Argument(help="completed or error.")],
    kind: Annotated[str, typer.Option(help="grasp, place, push, turn, open or put.")] = "grasp",
    instead_of: Annotated[
        int | None, typer.Option("--instead-of", help="The action that failed and is replaced.")
    ] = None,
    robot: Annotated[str | None, typer.Option(help="The agent that acted.")] = None,
    message: Annotated[str | None, typer.Option(help="Why it failed.")] = None,
    simulated: Annotated[bool, typer.Option("--simulated", help="It counts less.")] = False,
    map_name: cli.MapName = None,
) -> None:
    """Store how an attempt ended; later queries propose what succeeds most."""
    from semmap.manipulation.store.tasks import record_task

    with cli.open_database() as db:
        task = record_task(
            db.map(map_name).connection,
            name,
            kind,
            action=action,
            outcome=outcome,
            instead_of=instead_of,
            robot=robot,
            message=message,
            simulated=simulated,
        )
    print(f"task {task}: {outcome}")


@manipulation.command("try")
def try_command(
    name: Annotated[str, typer.Argument(help="The object.")],
    gripper: Gripper = None,
    tries: Annotated[int, typer.Option(min=1, help="The most attempts.")] = 12,
    mass: Annotated[
        float | None, typer.Option(help="kg; by default the object's property, else by volume.")
    ] = None,
    friction: Annotated[float, typer.Option(help="Between the pads and the object.")] = 0.5,
    on: Annotated[
        str | None, typer.Option(metavar="NAME", help="Try places of the object on this one.")
    ] = None,
    push: Annotated[bool, typer.Option("--push", help="Try pushes of the object.")] = False,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Try actions on an object in simulation until one succeeds, and store what was learned.

    Grasps by default; with --on or --push, places or pushes.
    """
    from semmap.manipulation.practice import practise, practise_places, practise_pushes

    if on is not None and push:
        raise typer.BadParameter("give one of --on and --push")
    values: dict[str, Any] = {"tries": tries, "mass": mass, "friction": friction}
    columns = ("action_id", "family", "off", "tilted", "outcome")
    with cli.open_database() as db:
        session = db.map(map_name).connection
        if on is not None:
            rows = practise_places(session, name, on, gripper, **values)
        elif push:
            rows = practise_pushes(session, name, gripper, **values)
        else:
            rows = practise(session, name, gripper, **values)
            columns = ("action_id", "family", "moved", "outcome", "stored")
    cli.show_table(rows, json_, columns)


@manipulation.command()
def tasks(limit: Limit = 20, map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the newest manipulations of the map with their outcomes."""
    from semmap.manipulation.reader import list_tasks

    with cli.open_database() as db:
        rows = list_tasks(db.map(map_name).connection, limit)
    columns = ("id", "kind", "entity", "robot", "outcome", "action_id", "contributor", "message")
    cli.show_table(rows, json_, columns)


@manipulation.command("import-grasps")
def import_grasps(
    files: Annotated[
        list[Path], typer.Argument(help="CSV, JSON or pg_dump of grasps and of their models.")
    ],
    gripper: Annotated[
        list[str] | None,
        typer.Option("--gripper", metavar="HAND=GRIPPER", help="A stored gripper; repeatable."),
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z,QX,QY,QZ,QW",
            help="The grasp frame in the frame of the file's hand; by default the same.",
        ),
    ] = None,
    scale: Annotated[float, typer.Option(help="Metres per unit: 0.001 for millimetres.")] = 1.0,
) -> None:
    """Store grasps of the Household Objects Database, or of a file with its columns."""
    from semmap.manipulation.household_objects import import_household_grasps

    hands = dict(pair.split("=", 1) for pair in gripper or () if "=" in pair)
    if len(hands) != len(gripper or ()):
        raise typer.BadParameter("--gripper takes HAND=GRIPPER")
    pose = None if tool is None else _numbers(tool, "--tool")
    with cli.open_database() as db:
        counts = import_household_grasps(db.session, files, hands, tool=pose, scale=scale)
    print(", ".join(f"{count} {what}" for what, count in counts.items()))


@manipulation.command("export")
def export_command(
    file: Path,
    name: Annotated[
        str | None, typer.Option(help="Of the contributor; by default that of this machine.")
    ] = None,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="With outcomes of simulated robots.")
    ] = False,
) -> None:
    """Write what this database learned to a signed file, for other robots."""
    from semmap.manipulation.store.bundle import export_bundle

    with cli.open_database() as db:
        counts = export_bundle(db.session, file, name or socket.gethostname(), simulated=simulated)
    print(f"{file}: {', '.join(f'{count} {what}' for what, count in counts.items())}")


@manipulation.command("import")
def import_command(files: list[Path]) -> None:
    """Store the knowledge of signed files: each as a whole, from those whom you trust."""
    from semmap.manipulation.store.bundle import import_bundle

    with cli.open_database() as db:
        for file in files:
            counts = import_bundle(db.session, file)
            print(f"{file}: {', '.join(f'{count} {what}' for what, count in counts.items())}")


@manipulation.command()
def key() -> None:
    """Print the public key with which `export` signs; others trust it."""
    from semmap.manipulation.signing import own_key, public_key

    print(public_key(own_key()).hex())


@manipulation.command("trust")
def trust_command(
    name: str,
    key: Annotated[str, typer.Argument(help="64 digits that `semmap manipulation key` prints.")],
    level: Annotated[float, typer.Option(help="How much outcomes count; 0: refuse bundles.")] = 1.0,
) -> None:
    """Trust a contributor, so that its files can be imported."""
    from semmap.manipulation.store.bundle import trust

    with cli.open_database() as db:
        trust(db.session, name, key, level)


@manipulation.command()
def contributors(json_: cli.Json = False) -> None:
    """List whose knowledge the database has, and how much it is trusted."""
    from semmap.manipulation.reader import list_contributors

    with cli.open_database() as db:
        rows = list_contributors(db.session)
    cli.show_table(rows, json_, ("name", "trust", "actions", "attempts", "latest", "key"))
