"""The commands `semmap teach`, `observe`, `where` and `belief`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli

# NumPy, Shapely and SQLAlchemy are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from sqlalchemy import Connection

    from semmap.belief.identify import Detection

__all__ = ["belief", "observe_command", "teach_command", "where_command"]

At = Annotated[
    datetime | None, typer.Option(help="At this time (ISO 8601, local without a zone); else now.")
]


def teach_command(
    files: Annotated[list[Path], typer.Argument(help="JSON or Map.xml; - for standard input.")],
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Teach the map: knowledge, relations, actions, objects and where they were seen.

    Each file is stored as a whole or not at all.
    """
    from semmap.belief.store.teaching import teach
    from semmap.belief.teaching import parse_teaching, read_teaching

    counts = []
    with cli.open_database() as db:
        chosen = db.map(map_name)
        for path in files:
            if str(path) == "-":
                teaching = parse_teaching(_json(sys.stdin.read(), "standard input"))
            else:
                teaching = read_teaching(path)
            counts.append({"file": str(path)} | teach(chosen.connection, teaching))
    if json_:
        cli.print_json(counts)
        return
    for count in counts:
        parts = [f"{n} {part}" for part, n in count.items() if part != "file" and n]
        print(f"{count['file']}: {', '.join(parts) or 'nothing new'}")


def where_command(
    names: Annotated[list[str], typer.Argument(metavar="NAME...")],
    at: At = None,
    limit: Annotated[int, typer.Option(help="The most rows in a table; JSON has all.")] = 10,
    draw: Annotated[
        Path | None, typer.Option(help="Draw a heat map on the floor plan to this PNG.")
    ] = None,
    storey: Annotated[
        str | None, typer.Option(help="For --draw; by default the most probable one.")
    ] = None,
    occlusion: Annotated[
        bool,
        typer.Option("--occlusion", help="The larger ones of NAMES may hide the smaller ones."),
    ] = False,
    moves: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Objects of mobility 1 move once in this time; sightings keep their value.",
        ),
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show where objects or agents probably are."""
    from semmap.belief.estimates import belief_with_motion, belief_with_occlusion
    from semmap.belief.motion import MotionModel
    from semmap.belief.store.beliefs import where
    from semmap.cli.regions import zoned

    if draw is not None and len(names) > 1:
        raise typer.BadParameter("--draw is for one name")
    if occlusion and moves is not None:
        raise typer.BadParameter("choose --occlusion or --moves: no model has both")
    motion = None if moves is None else MotionModel(moves)
    moment = zoned(at)
    with cli.open_database() as db:
        session = db.map(map_name).connection
        found = {name: where(session, name, moment) for name in names}
        estimates = {}
        if occlusion:
            estimates = belief_with_occlusion(session, names, moment)
        elif motion is not None:
            estimates = belief_with_motion(session, names, motion, moment)
    for name, estimate in estimates.items():
        for row in found[name]:
            row["probability"] = estimate[row["place"]]
        found[name].sort(key=lambda row: -row["probability"])
    columns = ("place", "probability", "holder", "last_seen", "last_missed")
    if json_:
        cli.print_json(
            [
                {
                    "name": name,
                    "belief": [{key: row[key] for key in (*columns, "prior")} for row in rows],
                }
                for name, rows in found.items()
            ]
        )
    else:
        for name, rows in found.items():
            _show(name, rows, limit, columns, titled=len(found) > 1)
    if draw is not None:
        print(_draw(names[0], found[names[0]], draw, storey, map_name), file=sys.stderr)


def _show(
    name: str, rows: Sequence[dict[str, Any]], limit: int, columns: Sequence[str], titled: bool
) -> None:
    """The most probable places as a table, and how much the others have together."""
    shown = [
        row | {key: row[key] and row[key].isoformat(" ", "seconds") for key in columns[3:]}
        for row in rows[:limit]
    ]
    if len(rows) > limit:
        rest = sum(row["probability"] for row in rows[limit:])
        other = dict.fromkeys(columns) | {
            "place": f"({len(rows) - limit} other places)",
            "probability": rest,
        }
        shown.append(other)
    if titled:
        print(f"{name}:")
    for row in shown:
        row["probability"] = round(row["probability"], 4)
    cli.show_table(shown, False, columns)


def _draw(
    name: str, rows: Sequence[dict[str, Any]], path: Path, storey: str | None, map_name: str | None
) -> str:
    from semmap.belief.heat_map import heat_map
    from semmap.belief.reader import read_places
    from semmap.draw.view import storey_view
    from semmap.query.storey_reader import read_storeys

    found = {row["place"]: row["probability"] for row in rows}
    with cli.open_map(map_name) as connection:
        places = read_places(connection, name)
        best = max(places, key=lambda place: found.get(place.name, 0.0), default=None)
        chosen = storey or (best.storey if best else None)
        scenes = read_storeys(connection, chosen)
    if not scenes:
        raise ValueError("the map has no storey to draw")
    here = [place for place in places if chosen is None or place.storey in (chosen, None)]
    return str(heat_map(storey_view(scenes[0]), here, found, path, name=name))


def observe_command(
    name: Annotated[str | None, typer.Argument(help="The object or agent.")] = None,
    place: Annotated[str | None, typer.Argument(help="Where it was looked for.")] = None,
    missed: Annotated[bool, typer.Option("--missed", help="It was not seen there.")] = False,
    point: Annotated[
        str | None, typer.Option(help="X,Y,Z of a detection, instead of a place; metres.")
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="The agent in whose frame --point or --view is.")
    ] = None,
    view: Annotated[
        str | None, typer.Option(help="X,Y,Z,YAW,PITCH of a camera (radians): what it shows.")
    ] = None,
    seen: Annotated[
        list[str] | None, typer.Option(help="--view: NAME=X,Y,Z that it detected; repeatable.")
    ] = None,
    looked_for: Annotated[
        list[str] | None,
        typer.Option("--looked-for", help="--view: NAME that it would detect; repeatable."),
    ] = None,
    cloud: Annotated[
        Path | None,
        typer.Option(
            help="--view: points in the optical frame (PLY, NPY), in which --looked-for are found."
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(help="--cloud: NAME of furniture to remove from the points, such as a shelf."),
    ] = None,
    opening: Annotated[
        float, typer.Option(help="--view: horizontal opening angle, radians.")
    ] = 1.05,
    range_: Annotated[
        float, typer.Option("--range", help="--view: how far the detector sees, metres.")
    ] = 5.0,
    visible: Annotated[float, typer.Option(help="The share of the place in view.")] = 1.0,
    hit: Annotated[float | None, typer.Option(help="P(seen | there) of the detector.")] = None,
    false_alarm: Annotated[
        float | None, typer.Option(help="P(seen | not there) of the detector.")
    ] = None,
    at: At = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Store what was seen where, or was looked for and not seen.

    semmap observe mug1 table1; semmap observe mug1 table1 --missed; semmap observe mug1 --point
    1,2,0.8 --frame robot1; semmap observe --view 1,2,1.2,0,0.4 --looked-for mug1; semmap observe
    --view 1,2,1.2,0,0.4 --cloud view.ply --looked-for mug1
    """
    from semmap.belief.looks import observe_point
    from semmap.belief.reader import is_wide
    from semmap.belief.store.beliefs import add_observations
    from semmap.cli.regions import zoned

    if sum(given is not None for given in (place, point, view)) != 1 or (view is None) != (
        name is not None
    ):
        raise typer.BadParameter("give NAME and PLACE, or NAME and --point, or --view alone")
    if cloud is not None and (view is None or seen):
        raise typer.BadParameter("--cloud needs --view, and finds what --seen would state")
    if without and cloud is None:
        raise typer.BadParameter("--without needs --cloud")
    values: dict[str, Any] = {"hit": hit, "false_alarm": false_alarm}
    moment = zoned(at)
    with cli.engine().begin() as connection:
        cli.choose_map(connection, map_name)
        if view is not None:
            rows = _observe_view(
                connection,
                view,
                seen or [],
                looked_for or [],
                frame,
                opening,
                range_,
                moment,
                values,
                cloud,
                without or [],
            )
        elif point is not None:
            assert name is not None
            if missed:
                raise typer.BadParameter("--missed is for a place")
            there = _numbers(point, 3, "--point")
            rows = [observe_point(connection, name, there, frame=frame, at=moment, **values)]
        else:
            wide = is_wide(connection, str(place))
            row = {"object": name, "place": place, "seen": not missed, "inside": wide, "at": moment}
            row |= {"visible": visible, "observer": frame} | values
            add_observations(connection, [row])
            rows = [row]
    columns = ("object", "place", "seen", "visible")
    cli.show_table([{"visible": 1.0} | row for row in rows], json_, columns)


def _observe_view(
    connection: Connection,
    view: str,
    seen: Sequence[str],
    looked_for: Sequence[str],
    frame: str | None,
    opening: float,
    furthest: float,
    at: datetime | None,
    values: dict[str, Any],
    cloud: Path | None,
    without: Sequence[str],
) -> list[dict[str, Any]]:
    from semmap.belief.looks import observe_view
    from semmap.belief.reader import read_agent_pose
    from semmap.belief.views import camera_at

    if not seen and not looked_for:
        raise typer.BadParameter("--view needs --looked-for NAME, or --seen NAME=X,Y,Z")
    x, y, z, yaw, pitch = _numbers(view, 5, "--view")
    detected = {}
    for given in seen:
        name, equals, where = given.partition("=")
        if not equals or not name:
            raise typer.BadParameter(f"--seen takes NAME=X,Y,Z, not {given}")
        detected[name] = _numbers(where, 3, "--seen")
    if frame is not None:
        pose = read_agent_pose(connection, frame, at)
        x, y, z = (float(v) for v in pose.apply([[x, y, z]])[0])
        yaw += pose.yaw
        detected = {n: list(map(float, pose.apply([p])[0])) for n, p in detected.items()}
    camera = camera_at((x, y, z), yaw, pitch, field_of_view=opening)
    if cloud is not None:
        from semmap.belief.cloud_looks import observe_cloud
        from semmap.perception.cloud_file import read_cloud

        return observe_cloud(
            connection,
            camera,
            read_cloud(cloud),
            looked_for,
            without=without,
            furthest=furthest,
            at=at,
            observer=frame,
            **values,
        )
    return observe_view(
        connection,
        camera,
        looked_for,
        detected,
        furthest=furthest,
        at=at,
        observer=frame,
        **values,
    )


def _numbers(text: str, count: int, option: str) -> list[float]:
    try:
        numbers = [float(v) for v in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise typer.BadParameter(f"{option} takes {count} numbers with commas between, not {text}")
    return numbers


def _json(text: str, where: str) -> Any:
    try:
        return json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"{where}: is not valid JSON: {error}") from error


belief = typer.Typer(
    no_args_is_help=True, help="Beliefs for other programs: messages, ProbLog, fields, grammars."
)


class GrammarFormat(StrEnum):
    """Of grammars."""

    gbnf = "gbnf"
    jsgf = "jsgf"


@belief.command()
def initial(
    names: Annotated[list[str], typer.Argument(metavar="NAME...")],
    at: At = None,
    map_name: cli.MapName = None,
) -> None:
    """Print the initial belief as JSON: locations, and a distribution for each name."""
    from semmap.belief.store.beliefs import initial_belief
    from semmap.cli.regions import zoned

    with cli.open_database() as db:
        session = db.map(map_name).connection
        cli.print_json(initial_belief(session, names, zoned(at)))


@belief.command()
def how(
    goal: str,
    given: Annotated[list[str] | None, typer.Option(help="What holds already; repeatable.")] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show the taught actions that bring about a goal, the first one first."""
    from semmap.belief.store.teaching import how_to

    with cli.open_database() as db:
        chain = how_to(db.map(map_name).connection, goal, given or ())
    rows = [{"action": a.name, "cause": a.cause, "effect": a.effect} for a in chain]
    cli.show_table(rows, json_, ("action", "cause", "effect"))


@belief.command()
def identify(
    seen: Annotated[
        list[str],
        typer.Argument(metavar="TYPE=X,Y,Z[,W,D,H]...", help="Detections of one view; metres."),
    ],
    frame: Annotated[str | None, typer.Option(help="The agent in whose frame they are.")] = None,
    moves: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Objects of mobility 1 move once in this time."),
    ] = 86_400.0,
    new: Annotated[
        float, typer.Option(help="Expected number of objects at a place that the map lacks.")
    ] = 0.05,
    at: At = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Tell which known objects were detected, perhaps moved, and which are new.

    semmap belief identify mug=1.2,3.4,0.8 mug=6.1,0.9,0.5,0.08,0.08,0.1
    """
    from semmap.belief.identify import identify
    from semmap.belief.motion import MotionModel
    from semmap.cli.regions import zoned

    detections = [_detection(text) for text in seen]
    with cli.open_map(map_name) as connection:
        found = identify(
            connection, detections, frame=frame, at=zoned(at), motion=MotionModel(moves), new=new
        )
    rows = [
        {"seen": text, "place": one.place, "object": name, "probability": round(probability, 4)}
        for text, one in zip(seen, found, strict=True)
        for name, probability in [*one.known.items(), (None if json_ else "(new)", one.new)]
    ]
    cli.show_table(rows, json_, ("seen", "place", "object", "probability"))


def _detection(text: str) -> Detection:
    from semmap.belief.identify import Detection

    type_, _, numbers = text.partition("=")
    count = 6 if numbers.count(",") > 2 else 3
    values = _numbers(numbers, count, f"TYPE=X,Y,Z[,W,D,H]: {text!r}")
    x, y, z, *sides = values
    return Detection(type_, (x, y, z), (sides[0], sides[1], sides[2]) if sides else None)


@belief.command()
def grammar(
    format_: Annotated[GrammarFormat, typer.Option("--format")] = GrammarFormat.gbnf,
    map_name: cli.MapName = None,
) -> None:
    """Print a grammar of the names that the map knows, for a speech recogniser."""
    from semmap.belief.grammar import write_grammar
    from semmap.belief.store.teaching import vocabulary

    with cli.open_database() as db:
        print(write_grammar(vocabulary(db.map(map_name).connection), format_))


@belief.command()
def field(
    name: str,
    keep_as: Annotated[
        str | None, typer.Option("--keep", help="Name of the field; by default belief-NAME.")
    ] = None,
    voxel_size: Annotated[float, typer.Option(help="Edge of a voxel in metres.")] = 0.05,
    at: At = None,
    map_name: cli.MapName = None,
) -> None:
    """Store a belief as a field of probabilities, for queries and costmaps."""
    from semmap.belief.belief_field import belief_map
    from semmap.belief.reader import read_places
    from semmap.belief.store.beliefs import read_belief
    from semmap.cli.regions import zoned
    from semmap.fields.store.map_store import save_map
    from semmap.fields.store.names import read_map_vocabulary

    moment = zoned(at)
    with cli.engine().begin() as connection:
        cli.choose_map(connection, map_name)
        made = belief_map(
            read_map_vocabulary(),
            read_places(connection, name),
            read_belief(connection, name, moment),
            about=name,
            voxel_size=voxel_size,
            time=moment,
        )
        chosen = keep_as or f"belief-{name}"
        version = save_map(connection, chosen, made)
    print(f"field {chosen}, version {version}: {len(made)} voxels of {voxel_size:g} m")


@belief.command()
def export(
    names: Annotated[list[str], typer.Argument(metavar="NAME...")],
    problog: Annotated[bool, typer.Option("--problog", help="As a ProbLog program.")] = False,
    occlusion: Annotated[
        bool,
        typer.Option("--occlusion", help="The larger ones of NAMES may hide the smaller ones."),
    ] = False,
    at: At = None,
    map_name: cli.MapName = None,
) -> None:
    """Print priors and observations for another program."""
    from semmap.belief.estimates import known_volumes
    from semmap.belief.problog_program import problog_program
    from semmap.belief.reader import read_columns, read_model
    from semmap.cli.regions import zoned

    if not problog:
        raise typer.BadParameter("name the format: --problog")
    with cli.open_database() as db:
        session = db.map(map_name).connection
        columns, model = read_columns(session, names, zoned(at)), read_model(session)
    print(
        problog_program(
            columns.prior,
            columns.observations,
            columns.mobility,
            columns.objects,
            columns.places,
            known_volumes(columns) if occlusion else None,
            model=model,
        )
    )
