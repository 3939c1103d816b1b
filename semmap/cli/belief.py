"""The commands `semmap teach`, `ask`, `observe`, `where` and `belief`."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Argument, Option

from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json
from semmap.cli.output import print_json, show_table
from semmap.cli.texts import detections, json_value, numbers

if TYPE_CHECKING:
    from semmap.belief.believed_places import BelievedPlaces
    from semmap.belief.calibration import Calibration
    from semmap.belief.store.learning import LearnedBelief

OBSERVED = ("object", "place", "seen", "visible")
COLUMNS = ("place", "probability", "holder", "last_seen", "last_missed")
STATED = {"frame", "at", "hit", "false_alarm"}
DETECTION = "TYPE=X,Y,Z[,W,D,H]"


@command_of("Map.teach", teaching=None)
def teach_command(
    call: MethodCall,
    files: list[str] = Argument(
        help="JSON or Map.xml, or a sentence in quotation marks; - for standard input."
    ),
    json_: Json = False,
) -> None:
    """Teach the map: sentences, knowledge, relations, actions, objects and where they were seen.

    Each file is stored as a whole or not at all.

    semmap teach breakfast.json; semmap teach "the mug is on the table"
    """
    counts: list[dict[str, Any]] = []
    for text in files:
        given = json_value(sys.stdin.read(), "standard input") if text == "-" else text
        counts.append({"file": text} | call(teaching=given))
    if json_:
        print_json(counts)
        return
    for count in counts:
        parts = [f"{n} {part}" for part, n in count.items() if part != "file" and n]
        print(f"{count['file']}: {', '.join(parts) or 'nothing new'}")


@command_of("Map.ask", start="--from")
def ask_command(call: MethodCall, json_: Json = False) -> None:
    """Answer a sentence of the map's grammar: a question, a command or a statement.

    semmap ask "where is the mug"; semmap ask "bring the mug to the kitchen"
    """
    answer = call()
    print_json(answer.as_json()) if json_ else print(answer.text)


@command_of("Map.beliefs", names="NAME...", moves="SECONDS")
def where_command(
    call: MethodCall,
    limit: int = Option(10, help="The most rows in a table; JSON has all."),
    draw: Path | None = Option(
        None, help="Draw a heat map on the floor plan to this .png, .svg or .pdf."
    ),
    storey: str | None = Option(None, help="For --draw; by default the most probable one."),
    json_: Json = False,
) -> None:
    """Show where objects or agents probably are, or any of a type.

    semmap where mug1; semmap where sodacan
    """
    if draw is not None and len(call.values["names"]) > 1:
        raise typer.BadParameter("--draw is for one name")
    found = [*call().values()]
    _show_beliefs(found, limit, json_)
    if draw is not None:
        picture = call.handle.draw(storey, belief=found[0])
        print(picture.save(draw), file=sys.stderr)


def _show_beliefs(found: Sequence[BelievedPlaces], limit: int, json_: bool) -> None:
    """Print beliefs as JSON, or the most probable places of each as a table."""
    if json_:
        columns = (*COLUMNS, "prior")
        told = [
            {"name": one.name, "belief": [{key: row[key] for key in columns} for row in one.rows]}
            for one in found
        ]
        print_json(told)
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
    show_table(shown, False, COLUMNS)


@command_of(
    "Map.observe_view", view="[--view X,Y,Z,YAW,PITCH]", seen="NAME=X,Y,Z", furthest="--range"
)
def observe_command(
    call: MethodCall,
    name: str | None = Argument(None, help="The object or agent."),
    place: str | None = Argument(None, help="Where it was looked for."),
    missed: bool = Option(False, "--missed", help="It was not seen there."),
    point: str | None = Option(None, help="X,Y,Z of a detection, instead of a place; metres."),
    visible: float = Option(1.0, help="The share of the place in view."),
    detected: list[str] = Option(
        (), metavar=DETECTION, help="A detection of one view, known or new; metres; repeatable."
    ),
    json_: Json = False,
) -> None:
    """Store what was seen where, or was looked for and not seen.

    semmap observe mug1 table1 --missed; semmap observe mug1 --point 1,2,0.8 --frame robot1
    semmap observe --view 1,2,1.2,0,0.4 --cloud view.ply --looked-for mug1
    semmap observe --detected mug=1.2,3.4,0.8 --detected mug=6.1,0.9,0.5,0.08,0.08,0.1
    """
    view = call.values.get("view")
    if detected:
        if name or place or point or view:
            raise typer.BadParameter("--detected takes no NAME, place or view beside it")
        stated = {key: call.values[key] for key in STATED & call.values.keys()}
        told = call.handle.observe_objects(detections(detected, "--detected"), **stated)
        if not json_:
            told = [row | {"may_be": _all_of(row["may_be"])} for row in told]
        show_table(told, json_, ("object", "new", "probability", "place", "may_be"))
        return
    if [place, point, view].count(None) != 2 or (view is None) == (name is None):
        raise typer.BadParameter("give NAME and PLACE, or NAME and --point, or --view alone")
    if view is None and call.values.keys() & {"cloud", "without"}:
        raise typer.BadParameter("--cloud and --without are for --view")
    if point is not None and missed:
        raise typer.BadParameter("--missed is for a place")
    look = {"seen": not missed, "visible": visible}
    rows = [_observed(call, name, place, point, **look)] if name is not None else call()
    show_table([{"visible": 1.0} | row for row in rows], json_, OBSERVED)


def _all_of(shares: dict[str, float]) -> str:
    """What a detection may be, without what is improbable."""
    return ", ".join(f"{name} {share:.2f}" for name, share in shares.items() if share >= 0.005)


def _observed(
    call: MethodCall, name: str, place: str | None, point: str | None, **seen: Any
) -> dict[str, Any]:
    """Store a look for one object at a place, or a detection of it at a point."""
    rates = {key: call.values[key] for key in STATED & call.values.keys()}
    frame = rates.pop("frame", None)
    if point is None:
        found = call.handle.observe(name, place, observer=frame, **seen, **rates)
    else:
        found = call.handle.observe_point(name, numbers(point, "--point", 3), frame=frame, **rates)
    return dict(found)


@command_of("Map.which")
def _which(call: MethodCall, json_: Json = False) -> None:
    """Show which object of a type was in or on a place.

    semmap belief which mug table1 --at 2026-01-31T18:00
    """
    rows = [{"object": name, "probability": round(p, 4)} for name, p in call().items()]
    show_table(rows, json_, ("object", "probability"))


@command_of("Map.how_to")
def _how(call: MethodCall, json_: Json = False) -> None:
    rows = [{"action": a.name, "cause": a.cause, "effect": a.effect} for a in call()]
    show_table(rows, json_, ("action", "cause", "effect"))


def _show_kept(kept: Sequence[str]) -> None:
    """Print that a teaching was taken back, and what stays."""
    print("taken back" + (f"; used or changed since, and kept: {', '.join(kept)}" if kept else ""))


@command_of("Map.learn_belief", hold_out="DAYS", time_zone="ZONE")
def _learn(
    call: MethodCall,
    draw: Path | None = Option(
        None, help="Draw the calibration of the days held out to this .png, .svg or .pdf."
    ),
    limit: int = Option(20, help="The most lifts in a table; JSON has all."),
    json_: Json = False,
) -> None:
    """Learn where things are kept, how often they move, and what looks see, from the history.

    semmap belief learn --time-zone Europe/Berlin; semmap belief learn --hold-out 7
    """
    if draw is not None and not call.values.get("hold_out"):
        raise typer.BadParameter("--draw is for --hold-out")
    found = call()
    if json_:
        print_json(found.as_json())
    else:
        print(f"{found.things} things, {found.statements} statements, {found.looks} looks")
        most = sorted(found.lifts, key=lambda row: -abs(math.log(row["lift"])))[:limit]
        show_table(_rounded(most), False, ("subject", "about", "word", "lift", "seen", "expected"))
        if found.detectors:
            names = ("observer", "within", "hit", "false_alarm", "there", "elsewhere")
            show_table(_rounded(found.detectors), False, names)
        for name, one in _judged(found).items():
            print(f"{name}: calibration error {one.error:.3f}, log score {one.log_score:.4f}")
    if draw is not None:
        from semmap.belief.calibration import draw_calibrations

        print(draw_calibrations(_judged(found), draw), file=sys.stderr)


def _judged(found: LearnedBelief) -> dict[str, Calibration]:
    """How well the days held out were known, by what was learned."""
    curves = {
        "nothing learned": found.before,
        "learned, without hours": found.without_hours,
        "learned": found.after,
    }
    return {name: one for name, one in curves.items() if one is not None}


def _rounded(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows for a table, their numbers with four digits."""
    return [
        {key: float(f"{v:.4g}") if isinstance(v, float) else v for key, v in row.items()}
        for row in rows
    ]


@command_of("Map.identify", detections=f"{DETECTION}...", moves="SECONDS")
def _identify(call: MethodCall, json_: Json = False) -> None:
    """Tell which known objects were detected, perhaps moved, and which are new.

    semmap belief identify mug=1.2,3.4,0.8 mug=6.1,0.9,0.5,0.08,0.08,0.1
    """
    rows = [
        {"seen": text, "place": one.place, "object": name, "probability": round(probability, 4)}
        for text, one in zip(call.texts["detections"], call(), strict=True)
        for name, probability in one.may_be.items()
    ]
    show_table(rows, json_, ("seen", "place", "object", "probability"))


@command_of("Map.export_belief", names="NAME...")
def _export(
    call: MethodCall, problog: bool = Option(False, "--problog", help="As a ProbLog program.")
) -> None:
    if not problog:
        raise typer.BadParameter("name the format: --problog")
    print(call())


belief_command = group(
    printed("Map.initial_belief", print_json, names="NAME..."),
    _how,
    _identify,
    _which,
    _learn,
    printed("Map.forget_learned", "{0} lifts forgotten"),
    printed("Map.list_teachings", ("id", "name", "facts", "by", "at")),
    printed("Map.undo_teaching", _show_kept),
    printed("Map.grammar", "{0}", format="--format"),
    printed(
        "Map.belief_field",
        "field {0[field]}, version {0[version]}: {0[voxels]} voxels of {voxel_size:g} m",
        keep_as="--keep",
    ),
    _export,
)
