"""The program `semmap`: its own commands, thin layers over the Python API."""

from __future__ import annotations

import gc
import math
import os
import sys
from collections.abc import Iterable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import typer
from typer import Argument, Option

from semmap.cli.chosen import CliOptions, open_database
from semmap.cli.database_commands import app as database_commands
from semmap.cli.options import Json, MapName
from semmap.cli.plugin_group import PluginGroup
from semmap.cli.texts import key_values, numbers
from semmap.error import Error
from semmap.terminal import guard_streams

if TYPE_CHECKING:
    from semmap.api.database import Database
    from semmap.ingest.importer import ImportSummary


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"semmap {version('semmap')}")
        raise typer.Exit


def _main(
    db: str | None = Option(
        None, envvar="SEMMAP_DB", help="Database URL; by default the embedded one."
    ),
    version: bool = Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print it and end."
    ),
) -> None:
    CliOptions.url = db
    guard_streams()


def import_(
    files: list[Path] = Argument(help="SDF, building.yaml, IFC, GeoJSON, meshes, map.yaml, ..."),
    map_name: MapName = None,
    geometry: str = Option("visual", help="Of SDF models: visual or collision."),
    as_: str = Option("object", "--as", help="A mesh file is: object, room, or scene of nodes."),
    strict: bool = Option(False, help="Take nothing if anything is left out."),
    source: str | None = Option(None, help="Name under which a repeat finds it."),
    model_path: list[Path] | None = Option(
        None, help="Folder of SDF models, searched first; repeatable."
    ),
    scale: float = Option(1.0, help="Metres per unit of a mesh file: 0.001 for millimetres."),
    define: bool = Option(False, help="Add types of features that the map does not have."),
    find_rooms: bool = Option(False, help="Of a map without rooms: find them in its walls."),
    json_: Json = False,
) -> None:
    """Read world files into the map: each in one transaction, repeatable."""
    from semmap.cli.output import StageBars, print_json

    if geometry not in ("visual", "collision") or as_ not in ("object", "room", "scene"):
        raise typer.BadParameter("--geometry is visual or collision, --as is object, room or scene")
    if not 0 < scale < math.inf:
        raise typer.BadParameter(f"--scale is a number above 0, not {scale:g}")
    if other := [folder for folder in model_path or () if not folder.is_dir()]:
        raise typer.BadParameter(f"--model-path: {other[0]} is not a folder")
    summaries: list[ImportSummary] = []
    options: Any = {"geometry": geometry, "mesh_as": as_, "strict": strict, "source": source}
    options |= {"model_path": model_path or (), "scale": scale, "define": define}
    with open_database(migrate=True) as db:
        for path in files:
            options["find_rooms"] = find_rooms and path is files[-1]
            with StageBars() as bars:
                summary = db.import_file(path, map=map_name, progress=bars.report, **options)
            summaries.append(summary)
            map_name = map_name or summary.map
        _name_roomless(db, {summary.map for summary in summaries})
    if json_:
        print_json([summary.as_json() for summary in summaries])
        return
    for summary in summaries:
        print_summary(summary)


def _name_roomless(db: Database, maps: Iterable[str]) -> None:
    from semmap.cli.output import err

    for name in sorted(maps):
        if not db.map(name).rooms:
            err.print(
                f"map {name} has no rooms: semmap rooms find --map {name} finds them in walls"
            )


def print_summary(s: ImportSummary) -> None:
    """Print what came in, and what was left out and why."""
    from rich.text import Text

    from semmap.cli.output import out
    from semmap.ingest.naming import SURE

    kinds = ", ".join(f"{n} {kind}{'' if n == 1 else 's'}" for kind, n in s.kinds.items())
    bold = partial(Text, style="bold")
    out.print(
        Text.assemble(bold(Path(s.source).name), " -> map ", bold(s.map), ": ", kinds or "nothing")
    )
    out.print(
        f"  {s.added} added, {s.changed} changed, {s.removed} removed, {s.unchanged} unchanged; "
        f"{s.models} new meshes, {s.triangles:,} triangles; {s.holders} holders derived; "
        f"{s.seconds:.1f} s"
    )
    if s.guessed:
        unsure = [f"{g['name']} {g['type']}" for g in s.guessed if g["confidence"] < SURE]
        some = f", {len(unsure)} of them uncertain ({', '.join(unsure[:3])})" if unsure else ""
        text = f"{len(s.guessed)} types guessed from names{some}; to list them: semmap ls --guessed"
        out.print(f"  {text}")
    for note in s.notes:
        out.print(f"  note: {note}", style="dim")
    if s.skipped:
        out.print(f"  left out: {len(s.skipped)}", style="yellow")
        for skipped in s.skipped:
            text = f"    {skipped.element}: {skipped.problem}. {skipped.fix}"
            out.print(text, style="yellow")


def maps(json_: Json = False) -> None:
    """List the maps."""
    from semmap.cli.output import show_table

    with open_database() as db:
        show_table(db.list_maps(), json_, ("name", "entities", "rooms", "crs", "created_at"))


def use(name: str = Argument(metavar="MAP")) -> None:
    """Choose the map that commands take when none is named."""
    with open_database() as db:
        db.use(name)
    print(f"{name}: the map of this user's commands from now on")


def types(map_name: MapName = None, json_: Json = False) -> None:
    """List the semantic types, and how many entities of the map are of each."""
    from semmap.cli.output import show_table

    with open_database() as db:
        show_table(db.map(map_name).types(), json_, ("name", "parents", "origin", "entities"))


ENTITY_COLUMNS = ("name", "kind", "type", "label", "holder", "storey", "x", "y", "z")


def ls(
    type_: str | None = Argument(None, metavar="TYPE", help="With its subtypes."),
    map_name: MapName = None,
    in_: str | None = Option(None, "--in", help="Held by this room or object, also indirectly."),
    label: str | None = Option(None, help="Property label, such as kitchen."),
    where: list[str] | None = Option(None, help="KEY=VALUE of the properties; repeatable."),
    near: str | None = Option(None, help="X,Y,Z or a name: nearest first."),
    within: float | None = Option(None, help="Metres from --near."),
    box: str | None = Option(None, help="X0,Y0,Z0,X1,Y1,Z1 in the map's frame."),
    incomplete: bool = Option(False, help="Only what lacks a part."),
    guessed: bool = Option(False, help="Only those whose type is guessed from a name."),
    json_: Json = False,
) -> None:
    """List entities: of a type, with properties, in a room or box, near a point."""
    from semmap.cli.output import show_table

    with open_database() as db:
        chosen = db.map(map_name)
        if incomplete:
            show_table(chosen.incomplete(), json_, ("name", "kind", "missing"))
            return
        if guessed:
            show_table(chosen.guessed_types(), json_, ("name", "type", "confidence", "model"))
            return
        if within is not None and near is None:
            raise ValueError("--within needs --near: a point X,Y,Z or a name")
        point = numbers(near, "--near", 3) if near is not None and "," in near else near
        asked: Any = {"in_": in_, "label": label, "where": key_values(where, "--where")}
        asked |= {"near": point, "within": within}
        asked |= {"box": None if box is None else numbers(box, "--box", 6)}
        rows = chosen.table(type_, **asked)
    show_table(rows, json_, ENTITY_COLUMNS if near is None else (*ENTITY_COLUMNS, "distance"))


def show(
    name: str,
    map_name: MapName = None,
    at: str | None = Option(None, help="Where it was at this time (ISO 8601)."),
    json_: Json = False,
) -> None:
    """Show all that the map has of one entity."""
    from semmap.cli.output import out, print_json, readable

    with open_database() as db:
        known = db.map(map_name).describe(name, None if at is None else _time(at))
    if json_:
        print_json(known)
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for key, value in known.items():
        if value not in (None, [], {}):
            table.add_row(key, readable(value))
    out.print(table)


def check(
    map_name: MapName = None,
    fix: bool = Option(False, "--fix", help="Show what repairs each finding."),
    yes: bool = Option(False, "--yes", help="With --fix: derive what is stale; nothing moves."),
    json_: Json = False,
) -> None:
    """Judge a map: physics, rooms, doors, inventory; exit code 1 if there are errors."""
    from dataclasses import asdict

    from semmap.cli.output import err, out, print_json

    if yes and not fix:
        raise typer.BadParameter("--yes needs --fix")
    with open_database() as db:
        chosen = db.map(map_name)
        found = chosen.check()
        if yes and (fixed := chosen.fix(found)):
            err.print(f"{fixed} fixed; what is left:")
            found = chosen.check()
    if json_:
        print_json([asdict(finding) for finding in found])
    else:
        for finding in found:
            out.print(str(finding))
            if fix:
                out.print(f"  fix: {finding.fix}")
        grades = [(grade, sum(f.severity == grade for f in found)) for grade in SEVERITIES]
        err.print(", ".join(f"{n} {grade}{'' if n == 1 else 's'}" for grade, n in grades))
    if any(finding.severity == "error" for finding in found):
        raise typer.Exit(1)


SEVERITIES = ("error", "warning", "note")


def sql(
    statement: str = Argument(help="SQL, or - for standard input."),
    map_name: MapName = None,
    write: bool = Option(False, help="Let the statement change the map."),
    json_: Json = False,
) -> None:
    """Run a SQL statement; one that reads, unless --write is given."""
    from semmap.cli.output import err, show_rows

    if statement == "-":
        statement = sys.stdin.read()
    with open_database() as db:
        source = db if map_name is None else db.map(map_name)
        found = source.sql(statement, write=write)
    for note in found.notes:
        err.print(note, style="dim")
    show_rows(list(found.columns), found, json_)


def changes(
    since: str | None = Argument(None, help="A cursor from an earlier call."),
    json_: Json = False,
) -> None:
    """Show what changed since a cursor, and the cursor for the next call."""
    from semmap.cli.output import out, print_json, show_table

    with open_database() as db:
        cursor, rows = db.changes(since)
    if json_:
        print_json({"cursor": cursor, "changes": rows})
        return
    show_table(rows, False, ("id", "at", "map", "what", "entities"))
    out.print(f"cursor {cursor}")


def drop(
    name: str = Argument(metavar="MAP"),
    yes: bool = Option(False, "--yes", help="Do not ask."),
) -> None:
    """Delete a map and all that is in it."""
    from semmap.cli.output import out

    with open_database() as db:
        db.map(name)
        if not yes:
            typer.confirm(f"Delete the map {name} with all its entities?", abort=True)
        out.print(f"{name}: {db.drop_map(name)} entities deleted")


def _time(text: str) -> datetime:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f"--at takes an ISO 8601 time (2026-01-31T10:00), not {text}") from None
    return moment if moment.tzinfo else moment.astimezone()


class _Commands(PluginGroup):
    """The commands of this module and the group `db`, and those that packages add."""

    own: ClassVar = {
        "import": import_,
        "maps": maps,
        "use": use,
        "types": types,
        "ls": ls,
        "show": show,
        "check": check,
        "sql": sql,
        "changes": changes,
        "drop": drop,
        "db": database_commands,
    }


app = typer.Typer(
    cls=_Commands,
    callback=_main,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="One semantic map in PostGIS: what is where, what it means, how to get there.",
)


_NEW_OBJECTS = 10_000
"""Between looks for cycles; Python's 700 make dozens of them while modules are imported."""


def main() -> None:
    """Run the command line; an expected error is one line and exit code 2."""
    guard_streams()
    # loading it takes a tenth of a second of the processor on two cores, for threads that wait
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(_NEW_OBJECTS)
    try:
        app()
    except Exception as error:
        message = _expected(error)
        if message is None:
            raise
        from semmap.cli.output import err

        err.print(f"error: {message}", style="red")
        sys.exit(2)
    finally:
        if "ompl" not in sys.modules:  # whose bindings report what is left as leaks
            gc.freeze()  # the end of a process frees all: looking for cycles takes a tenth of it


def _expected(error: Exception) -> str | None:
    """The message for the user of an error that bad input or a missing database causes."""
    import psycopg

    cause = getattr(error, "orig", error)  # SQLAlchemy keeps the driver's error there
    if isinstance(cause, psycopg.Error):
        from semmap.query.refusal import refusal_text

        message = refusal_text(cause)
        if isinstance(cause, psycopg.errors.ReadOnlySqlTransaction):
            message += ". Add --write to let the statement change the map"
        return message
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, LookupError) and error.args:
        return str(error.args[0])
    if isinstance(error, (Error, LookupError, ValueError)):
        return str(error)
    return None
