"""The commands `semmap teach`, `observe`, `where` and `belief`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.cli.option_group import grouped
from semmap.cli.texts import json_value, numbers

# NumPy, Shapely and SQLAlchemy are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.belief.believed_places import BelievedPlaces
    from semmap.belief.identify import Detection

At = Annotated[
    datetime | None, Option(help="At this time (ISO 8601, local without a zone); else now.")
]
Names = Annotated[list[str], Argument(metavar="NAME...")]
Occlusion = Annotated[
    bool,
    Option("--occlusion", help="The larger ones of NAMES may hide the smaller ones."),
]
OBSERVED = ("object", "place", "seen", "visible")
COLUMNS = ("place", "probability", "holder", "last_seen", "last_missed")


def teach_command(
    files: list[Path] = Argument(help="JSON or Map.xml; - for standard input."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Teach the map: knowledge, relations, actions, objects and where they were seen.

    Each file is stored as a whole or not at all.
    """
    counts: list[dict[str, Any]] = []
    with cli.open_database() as db:
        chosen = db.map(map_name)
        for path in files:
            stdin = str(path) == "-"
            given = json_value(sys.stdin.read(), "standard input") if stdin else path
            counts.append({"file": str(path)} | chosen.teach(given))
    if json_:
        cli.print_json(counts)
        return
    for count in counts:
        parts = [f"{n} {part}" for part, n in count.items() if part != "file" and n]
        print(f"{count['file']}: {', '.join(parts) or 'nothing new'}")


def where_command(
    names: Names,
    at: At = None,
    limit: int = Option(10, help="The most rows in a table; JSON has all."),
    draw: Path | None = Option(None, help="Draw a heat map on the floor plan to this PNG."),
    storey: str | None = Option(None, help="For --draw; by default the most probable one."),
    occlusion: Occlusion = False,
    moves: float | None = Option(
        None,
        metavar="SECONDS",
        help="Objects of mobility 1 move once in this time; by default a day.",
    ),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show where objects or agents probably are, or any of a type.

    semmap where mug1; semmap where sodacan
    """
    if draw is not None and len(names) > 1:
        raise typer.BadParameter("--draw is for one name")
    if occlusion and moves is not None:
        raise typer.BadParameter("choose --occlusion or --moves: no model has both")
    with cli.open_database() as db:
        house = db.map(map_name)
        found = house.beliefs(names, at, occlusion=occlusion, moves=moves)
        _show_beliefs([*found.values()], limit, json_)
        if draw is not None:
            print(house.draw_belief(found[names[0]], draw, storey=storey), file=sys.stderr)


def _show_beliefs(found: Sequence[BelievedPlaces], limit: int, json_: bool) -> None:
    """Print beliefs as JSON, or the most probable places of each as a table."""
    if json_:
        columns = (*COLUMNS, "prior")
        told = [
            {"name": one.name, "belief": [{key: row[key] for key in columns} for row in one.rows]}
            for one in found
        ]
        cli.print_json(told)
        return
    for one in found:
        if len(found) > 1:
            print(f"{one.name}:")
        _show_places(one.rows, limit)


def _show_places(rows: Sequence[dict[str, Any]], limit: int) -> None:
    """The most probable places as a table, and how much the others have together."""
    shown = [
        row | {key: row[key] and row[key].isoformat(" ", "seconds") for key in COLUMNS[3:]}
        for row in rows[:limit]
    ]
    if len(rows) > limit:
        rest = sum(row["probability"] for row in rows[limit:])
        others = {"place": f"({len(rows) - limit} other places)", "probability": rest}
        shown.append(dict.fromkeys(COLUMNS) | others)
    for row in shown:
        row["probability"] = round(row["probability"], 4)
    cli.show_table(shown, False, COLUMNS)


@dataclass(frozen=True)
class LookOptions:
    """A look for one thing at a place, a detection of it at a point, or the view of a camera."""

    name: str | None = Argument(None, help="The object or agent.")
    place: str | None = Argument(None, help="Where it was looked for.")
    missed: bool = Option(False, "--missed", help="It was not seen there.")
    point: str | None = Option(None, help="X,Y,Z of a detection, instead of a place; metres.")
    frame: str | None = Option(None, help="The agent in whose frame --point or --view is.")
    view: str | None = Option(None, help="X,Y,Z,YAW,PITCH of a camera (radians): what it shows.")
    seen: list[str] = Option((), help="--view: NAME=X,Y,Z that it detected; repeatable.")
    looked_for: list[str] = Option((), help="--view: NAME that it would detect; repeatable.")
    cloud: Path | None = Option(
        None,
        help="--view: points in the optical frame (PLY, NPY), in which --looked-for are found.",
    )
    without: list[str] = Option(
        (), help="--cloud: NAME of furniture to remove from the points, such as a shelf."
    )
    opening: float = Option(1.05, help="--view: horizontal opening angle, radians.")
    range_: float = Option(5.0, "--range", help="--view: how far the detector sees, metres.")
    visible: float = Option(1.0, help="The share of the place in view.")

    def check(self) -> None:
        """Raise typer.BadParameter if its options exclude each other."""
        name, view = self.name, self.view
        if [self.place, self.point, view].count(None) != 2 or (view is None) == (name is None):
            raise typer.BadParameter("give NAME and PLACE, or NAME and --point, or --view alone")
        if view is None and (self.cloud is not None or self.without):
            raise typer.BadParameter("--cloud and --without are for --view")
        if self.point is not None and self.missed:
            raise typer.BadParameter("--missed is for a place")

    def store(self, house: Map, **rates: Any) -> list[dict[str, Any]]:
        """Store it in a map; what was observed."""
        name, frame = str(self.name), self.frame
        if self.view is not None:
            rates |= {"opening": self.opening, "furthest": self.range_, "without": self.without}
            rates |= {"frame": frame, "cloud": self.cloud, "seen": _detected(self.seen)}
            return house.observe_view(numbers(self.view, "--view", 5), self.looked_for, **rates)
        if self.point is not None:
            there = numbers(self.point, "--point", 3)
            return [house.observe_point(name, there, frame=frame, **rates)]
        rates |= {"seen": not self.missed, "visible": self.visible, "observer": frame}
        return [house.observe(name, str(self.place), **rates)]


@grouped
def observe_command(
    *,
    look: LookOptions,
    detected: list[str] | None = Option(
        None,
        metavar="TYPE=X,Y,Z[,W,D,H]",
        help="A detection of one view, known or new; metres; repeatable.",
    ),
    hit: float | None = Option(None, help="P(seen | there) of the detector."),
    false_alarm: float | None = Option(None, help="P(seen | not there) of the detector."),
    at: At = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Store what was seen where, or was looked for and not seen.

    semmap observe mug1 table1; semmap observe mug1 table1 --missed; semmap observe mug1 --point
    1,2,0.8 --frame robot1; semmap observe --view 1,2,1.2,0,0.4 --looked-for mug1; semmap observe
    --view 1,2,1.2,0,0.4 --cloud view.ply --looked-for mug1; semmap observe --detected
    mug=1.2,3.4,0.8 --detected mug=6.1,0.9,0.5,0.08,0.08,0.1
    """
    if detected:
        given = [look.name, look.place, look.point, look.view, hit, false_alarm]
        if given != [None] * len(given):
            raise typer.BadParameter("--detected takes no NAME, place, view or rates beside it")
        found = [_detection(text) for text in detected]
        with cli.chosen_map(map_name) as house:
            told = house.observe_objects(found, frame=look.frame, at=at)
        cli.show_table(told, json_, ("object", "new", "probability", "place"))
        return
    look.check()
    with cli.chosen_map(map_name) as house:
        rows = look.store(house, hit=hit, false_alarm=false_alarm, at=at)
    cli.show_table([{"visible": 1.0} | row for row in rows], json_, OBSERVED)


def _detected(seen: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """The points of ``NAME=X,Y,Z`` by name."""
    detected = {}
    for given in seen:
        name, equals, where = given.partition("=")
        if not equals or not name:
            raise typer.BadParameter(f"--seen takes NAME=X,Y,Z, not {given}")
        if name in detected:
            raise typer.BadParameter(f"--seen has {name} twice: one thing is at one place")
        detected[name] = numbers(where, "--seen", 3)
    return detected


belief = typer.Typer(
    no_args_is_help=True, help="Beliefs for other programs: messages, ProbLog, fields, grammars."
)


class GrammarFormat(StrEnum):
    """Of grammars."""

    gbnf = "gbnf"
    jsgf = "jsgf"


@belief.command()
def initial(names: Names, at: At = None, map_name: cli.MapName = None) -> None:
    """Print the initial belief as JSON: locations, and a distribution for each name."""
    with cli.open_database() as db:
        cli.print_json(db.map(map_name).initial_belief(names, at))


@belief.command()
def how(
    goal: str,
    given: list[str] | None = Option(None, help="What holds already; repeatable."),
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show the taught actions that bring about a goal, the first one first."""
    with cli.open_database() as db:
        chain = db.map(map_name).how_to(goal, given or ())
    rows = [{"action": a.name, "cause": a.cause, "effect": a.effect} for a in chain]
    cli.show_table(rows, json_, ("action", "cause", "effect"))


@belief.command()
def identify(
    seen: list[str] = Argument(
        metavar="TYPE=X,Y,Z[,W,D,H]...", help="Detections of one view; metres."
    ),
    frame: str | None = Option(None, help="The agent in whose frame they are."),
    moves: float = Option(
        86_400.0, metavar="SECONDS", help="Objects of mobility 1 move once in this time."
    ),
    new: float = Option(0.05, help="Expected number of objects at a place that the map lacks."),
    at: At = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Tell which known objects were detected, perhaps moved, and which are new.

    semmap belief identify mug=1.2,3.4,0.8 mug=6.1,0.9,0.5,0.08,0.08,0.1
    """
    detections = [_detection(text) for text in seen]
    with cli.chosen_map(map_name) as house:
        found = house.identify(detections, frame=frame, at=at, moves=moves, new=new)
    rows = [
        {"seen": text, "place": one.place, "object": name, "probability": round(probability, 4)}
        for text, one in zip(seen, found, strict=True)
        for name, probability in [*one.known.items(), (None if json_ else "(new)", one.new)]
    ]
    cli.show_table(rows, json_, ("seen", "place", "object", "probability"))


def _detection(text: str) -> Detection:
    from semmap.belief.identify import Detection

    type_, _, values = text.partition("=")
    count = 6 if values.count(",") > 2 else 3
    x, y, z, *sides = numbers(values, f"TYPE=X,Y,Z[,W,D,H]: {text!r}", count)
    return Detection(type_, (x, y, z), (sides[0], sides[1], sides[2]) if sides else None)


@belief.command()
def grammar(
    format_: GrammarFormat = Option(GrammarFormat.gbnf, "--format"),
    map_name: cli.MapName = None,
) -> None:
    """Print a grammar of the names that the map knows, for a speech recogniser."""
    with cli.open_database() as db:
        print(db.map(map_name).grammar(format_.value))


@belief.command()
def field(
    name: str,
    keep_as: str | None = Option(None, "--keep", help="Name of the field; by default belief-NAME."),
    voxel_size: float = Option(0.05, help="Edge of a voxel in metres."),
    at: At = None,
    map_name: cli.MapName = None,
) -> None:
    """Store a belief as a field of probabilities, for queries and costmaps."""
    with cli.chosen_map(map_name) as house:
        made = house.belief_field(name, keep_as, voxel_size=voxel_size, at=at)
    size = f"{made['voxels']} voxels of {voxel_size:g} m"
    print(f"field {made['field']}, version {made['version']}: {size}")


@belief.command()
def export(
    names: Names,
    problog: bool = Option(False, "--problog", help="As a ProbLog program."),
    occlusion: Occlusion = False,
    at: At = None,
    map_name: cli.MapName = None,
) -> None:
    """Print priors and observations for another program."""
    if not problog:
        raise typer.BadParameter("name the format: --problog")
    with cli.open_database() as db:
        print(db.map(map_name).export_belief(names, occlusion=occlusion, at=at))
