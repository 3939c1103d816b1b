"""The command line: `semmap`, with what other packages register through entry points."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import psycopg
import sqlalchemy.exc
import typer
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars
from rich.table import Table
from rich.text import Text
from sqlalchemy import Connection, Engine

from semmap.commands import Commands
from semmap.database import DatabaseError, as_reader, connect
from semmap.database.commands import app as database_commands
from semmap.ingest.world import WorldError
from semmap.query import entries
from semmap.terminal import SafeConsole, guard_streams

if TYPE_CHECKING:
    from semmap.ingest.importer import ImportSummary

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="One semantic map in PostGIS: what is where, what it means, how to get there.",
)
app.add_typer(database_commands, name="db")

# Brackets and colons are parts of names: no markup, no emoji.
_console = partial(SafeConsole, markup=False, emoji=False, highlight=False, soft_wrap=True)
out = _console(width=None if sys.stdout.isatty() else 160)  # a file or pipe has no width to fit
err = _console(stderr=True)

MapName = Annotated[
    str | None, typer.Option("--map", envvar="SEMMAP_MAP", help="The map; by default the newest.")
]
Json = Annotated[bool, typer.Option("--json", help="Answer as JSON.")]


class State:
    """What the options before the command said."""

    url: str | None = None
    context: typer.Context | None = None


@app.callback()
def _main(
    context: typer.Context,
    db: Annotated[
        str | None,
        typer.Option("--db", envvar="SEMMAP_DB", help="Database URL; by default the embedded one."),
    ] = None,
) -> None:
    State.url, State.context = db, context
    guard_streams()


def engine() -> Engine:
    """The database that the user chose; closed when the command ends."""
    chosen = connect(State.url)
    if State.context is not None:
        State.context.call_on_close(chosen.dispose)
    return chosen


@contextmanager
def database() -> Iterator[Engine]:
    """The database that the user chose, while it lasts."""
    chosen = connect(State.url)
    try:
        yield chosen
    finally:
        chosen.dispose()


@contextmanager
def open_map(name: str | None) -> Iterator[Connection]:
    """A connection that sees the map of that name, the newest one where None."""
    with database() as engine, engine.connect() as connection:
        choose_map(connection, name)
        yield connection


def choose_map(connection: Connection, name: str | None) -> None:
    """Let this connection's views show the map of that name, the newest one where None."""
    known = [
        row[0] for row in connection.exec_driver_sql("SELECT name FROM map ORDER BY id").fetchall()
    ]
    if not known:
        raise typer.BadParameter("there is no map yet: semmap import FILE makes one")
    if name is not None and name not in known:
        raise typer.BadParameter(f"there is no map {name}; there are: {', '.join(known)}")
    connection.exec_driver_sql(
        "SELECT set_config('semmap.map', %(name)s, false)", {"name": name or known[-1]}
    )


def print_json(value: Any) -> None:
    """An answer as JSON, what JSON has no form for as PostgreSQL writes it."""
    print(json.dumps(entries.plain(value), allow_nan=False))


def show_rows(columns: list[str], rows: list[tuple[Any, ...]], as_json: bool) -> None:
    """Rows as a table, or as JSON objects; a repeated column becomes label, label_2."""
    names = entries.unique_names(columns)
    if as_json:
        print_json([dict(zip(names, row, strict=True)) for row in rows])
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in names:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*("" if v is None else entries.readable(v) for v in row))
    out.print(table)
    err.print(f"{len(rows)} row{'' if len(rows) == 1 else 's'}", style="dim")


@app.command("import")
def import_(
    files: Annotated[list[Path], typer.Argument(help="SDF, building.yaml, GeoJSON, meshes, ...")],
    map_name: MapName = None,
    geometry: Annotated[str, typer.Option(help="Of SDF models: visual or collision.")] = "visual",
    as_: Annotated[str, typer.Option("--as", help="A mesh file is an: object or room.")] = "object",
    strict: Annotated[bool, typer.Option(help="Take nothing if anything is left out.")] = False,
    source: Annotated[str | None, typer.Option(help="Name under which a repeat finds it.")] = None,
    json_: Json = False,
) -> None:
    """Read world files into the map: each in one transaction, repeatable."""
    from semmap.ingest.importer import import_file  # parsers of meshes are slow to load

    if geometry not in ("visual", "collision") or as_ not in ("object", "room"):
        raise typer.BadParameter("--geometry is visual or collision, --as is object or room")
    summaries: list[ImportSummary] = []
    database = engine()
    for path in files:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
                   TimeElapsedColumn())  # fmt: skip
        with Bars(*columns, console=err, transient=True) as bars:
            tasks: dict[str, TaskID] = {}

            def report(
                stage: str, done: int, total: int,
                bars: Bars = bars, tasks: dict[str, TaskID] = tasks,
            ) -> None:  # fmt: skip
                if stage not in tasks:
                    tasks[stage] = bars.add_task(stage)
                bars.update(tasks[stage], completed=done, total=total or None)

            summaries.append(
                import_file(
                    database,
                    path,
                    map_name=map_name,
                    geometry="collision" if geometry == "collision" else "visual",
                    mesh_as="room" if as_ == "room" else "object",
                    strict=strict,
                    source=source,
                    progress=report,
                )
            )
        map_name = map_name or summaries[-1].map
    if json_:
        print(json.dumps([s.as_json() for s in summaries], default=str))
        return
    for summary in summaries:
        print_summary(summary)


def print_summary(s: ImportSummary) -> None:
    """What came in, and what was left out and why."""
    kinds = ", ".join(f"{n} {kind}{'' if n == 1 else 's'}" for kind, n in s.kinds.items())
    bold = partial(Text, style="bold")
    out.print(Text.assemble(bold(Path(s.source).name), " -> map ", bold(s.map), ": ",
                            kinds or "nothing"))  # fmt: skip
    out.print(
        f"  {s.added} added, {s.changed} changed, {s.removed} removed, {s.unchanged} unchanged; "
        f"{s.models} new meshes, {s.triangles:,} triangles; {s.holders} holders derived; "
        f"{s.seconds:.1f} s"
    )
    for note in s.notes:
        out.print(f"  note: {note}", style="dim")
    if s.skipped:
        out.print(f"  left out: {len(s.skipped)}", style="yellow")
        for skipped in s.skipped:
            text = f"    {skipped.element}: {skipped.problem}. {skipped.fix}"
            out.print(text, style="yellow")


@app.command()
def maps(json_: Json = False) -> None:
    """List the maps."""
    with engine().connect() as connection:
        show_rows(*entries.maps(connection), json_)


@app.command()
def ls(
    type_: Annotated[str | None, typer.Argument(metavar="TYPE", help="With its subtypes.")] = None,
    map_name: MapName = None,
    in_: Annotated[str | None, typer.Option("--in", help="Held by this room or thing.")] = None,
    label: Annotated[str | None, typer.Option(help="Property label, such as kitchen.")] = None,
    where: Annotated[
        list[str] | None, typer.Option(help="KEY=VALUE of the properties; repeatable.")
    ] = None,
    near: Annotated[str | None, typer.Option(help="X,Y,Z or a name: nearest first.")] = None,
    within: Annotated[float | None, typer.Option(help="Metres from --near.")] = None,
    box: Annotated[str | None, typer.Option(help="X0,Y0,Z0,X1,Y1,Z1 in the map's frame.")] = None,
    incomplete: Annotated[bool, typer.Option(help="Only what lacks a part.")] = False,
    json_: Json = False,
) -> None:
    """List entities: of a type, with properties, in a room or box, near a point."""
    with engine().connect() as connection:
        choose_map(connection, map_name)
        if incomplete:
            show_rows(*entries.incomplete(connection), json_)
            return
        question = entries.Question(
            type=type_,
            inside=in_,
            label=label,
            where=where or [],
            near=near,
            within=within,
            box=box,
        )
        show_rows(*entries.find(connection, question), json_)


@app.command()
def show(name: str, map_name: MapName = None, at: Annotated[
    str | None, typer.Option(help="Where it was at this time (ISO 8601).")] = None,
    json_: Json = False,
) -> None:  # fmt: skip
    """Show all that the map knows of one entity."""
    with engine().connect() as connection:
        choose_map(connection, map_name)
        known = entries.describe(connection, name, at)
    if json_:
        print_json(known)
        return
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for key, value in known.items():
        if value not in (None, [], {}):
            table.add_row(key, entries.readable(value))
    out.print(table)


SUPERUSER_NOTE = (
    "note: this login is a superuser, and a hostile statement could take that right back; "
    "to read what others wrote, log in as a reader (docs/semmap.md)"
)


def _reading() -> Engine:
    """The database that the user chose; an embedded one by a login that can only read."""
    chosen = engine()
    reader = as_reader(chosen)
    if reader is None:
        return chosen
    if State.context is not None:
        State.context.call_on_close(reader.dispose)
    return reader


@app.command()
def sql(
    statement: Annotated[str, typer.Argument(help="SQL, or - for standard input.")],
    map_name: MapName = None,
    write: Annotated[bool, typer.Option(help="Let the statement change the map.")] = False,
    json_: Json = False,
) -> None:
    """Run a SQL statement; one that reads, unless --write is given."""
    if statement == "-":
        statement = sys.stdin.read()
    with (engine() if write else _reading()).begin() as connection:
        if not write and entries.is_superuser(connection):
            err.print(SUPERUSER_NOTE, style="dim")
        if connection.exec_driver_sql("SELECT EXISTS (SELECT FROM map)").scalar() or map_name:
            choose_map(connection, map_name)
        columns, rows = entries.run_sql(connection, statement, write=write)
    show_rows(columns, rows, json_)


@app.command()
def changes(
    since: Annotated[str | None, typer.Argument(help="A cursor from an earlier call.")] = None,
    json_: Json = False,
) -> None:
    """What changed since a cursor, and the cursor to ask with next time."""
    with engine().begin() as connection:
        cursor, columns, rows = entries.changes(connection, since)
    if json_:
        rows_ = [dict(zip(columns, row, strict=True)) for row in rows]
        print_json({"cursor": cursor, "changes": rows_})
        return
    show_rows(columns, rows, False)
    out.print(f"cursor {cursor}")


@app.command()
def drop(name: str, yes: Annotated[bool, typer.Option("--yes", help="Don't ask.")] = False) -> None:
    """Delete a map and all that is in it."""
    if not yes:
        typer.confirm(f"Delete the map {name} with all its entities?", abort=True)
    with engine().begin() as connection:
        n = connection.exec_driver_sql("SELECT drop_map(%(name)s)", {"name": name}).scalar()
    out.print(f"{name}: {n} entities deleted")


def main() -> None:
    """Run the command line; an expected error is one line and exit code 2."""
    guard_streams()
    try:
        app()
    except (WorldError, DatabaseError, LookupError, ValueError) as error:
        message = error.args[0] if isinstance(error, LookupError) and error.args else error
        err.print(f"error: {message}", style="red")
        sys.exit(2)
    except (sqlalchemy.exc.DBAPIError, psycopg.Error) as error:
        cause = error.orig if isinstance(error, sqlalchemy.exc.DBAPIError) else error
        message = str(cause).strip()
        if isinstance(cause, psycopg.Error) and cause.diag.message_primary:
            message = ". ".join(filter(None, (cause.diag.message_primary, cause.diag.message_hint)))
        if isinstance(cause, psycopg.errors.ReadOnlySqlTransaction):
            message += ". Add --write to let the statement change the map"
        err.print(f"error: {message}", style="red")
        sys.exit(2)
