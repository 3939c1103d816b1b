"""The commands about maps and their entities, and `semmap sql`."""

from __future__ import annotations

import sys
from dataclasses import asdict

import typer
from typer import Option

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of, printed
from semmap.cli.options import Json, MapName
from semmap.cli.output import print_json, readable, show_rows, show_table

COLUMNS = ("name", "kind", "type", "label", "holder", "storey", "x", "y", "z")
SEVERITIES = ("error", "warning", "note")

maps_command = printed("Database.list_maps", ("name", "entities", "rooms", "crs", "created_at"))
use_command = printed("Database.use", "{name}: the map of this user's commands from now on")
types_command = printed("Map.types", ("name", "parents", "origin", "entities"))


@command_of("Map.find", type="[TYPE]", name=None, on=None, limit=None)
def ls_command(
    call: MethodCall,
    incomplete: bool = Option(False, help="Only what lacks a part."),
    guessed: bool = Option(False, help="Only those whose type is guessed from a name."),
    json_: Json = False,
) -> None:
    """List entities: of a type, with properties, in a room or box, near a point.

    --near takes X,Y,Z or a name; the nearest comes first.
    """
    if incomplete:
        show_table(call.handle.incomplete(), json_, ("name", "kind", "missing"))
    elif guessed:
        found = call.handle.guessed_types()
        show_table(found, json_, ("name", "type", "confidence", "model"))
    else:
        if "within" in call.values and "near" not in call.values:
            raise ValueError("--within needs --near: a point X,Y,Z or a name")
        distance = ("distance",) if "near" in call.values else ()
        show_table(call.handle.table(**call.values), json_, (*COLUMNS, *distance))


@command_of("Map.describe")
def show_command(call: MethodCall, json_: Json = False) -> None:
    """Show all that the map has of one entity; with --at, also where it was then."""
    known = call()
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
    cli.out.print(table)


@command_of("Map.check")
def check_command(
    call: MethodCall,
    fix: bool = Option(False, "--fix", help="Show what repairs each finding."),
    yes: bool = Option(False, "--yes", help="With --fix: derive what is stale; nothing moves."),
    json_: Json = False,
) -> None:
    """Judge a map: physics, rooms, doors, inventory; exit code 1 if there are errors."""
    if yes and not fix:
        raise typer.BadParameter("--yes needs --fix")
    found = call()
    if yes and (fixed := call.handle.fix(found)):
        cli.err.print(f"{fixed} fixed; what is left:")
        found = call()
    if json_:
        print_json([asdict(finding) for finding in found])
    else:
        for finding in found:
            print(finding)
            if fix:
                print(f"  fix: {finding.fix}")
        grades = [(grade, sum(f.severity == grade for f in found)) for grade in SEVERITIES]
        cli.err.print(", ".join(f"{n} {grade}{'' if n == 1 else 's'}" for grade, n in grades))
    if any(finding.severity == "error" for finding in found):
        raise typer.Exit(1)


@command_of("Database.sql", write="--write/--no-write")
def sql_command(call: MethodCall, map_name: MapName = None, json_: Json = False) -> None:
    """Run a SQL statement, or - for standard input; one that reads, unless --write is given."""
    if call.values["statement"] == "-":
        call.values["statement"] = sys.stdin.read()
    found = call() if map_name is None else call.handle.map(map_name).sql(**call.values)
    for note in found.notes:
        cli.err.print(note, style="dim")
    show_rows(list(found.columns), found, json_)


@command_of("Database.changes", since="[CURSOR]")
def changes_command(call: MethodCall, json_: Json = False) -> None:
    """Show what changed since a cursor of an earlier call, and the cursor for the next one."""
    cursor, rows = call()
    if json_:
        print_json({"cursor": cursor, "changes": rows})
        return
    show_table(rows, False, ("id", "at", "map", "what", "entities"))
    print(f"cursor {cursor}")


@command_of("Database.drop_map", name="MAP")
def drop_command(call: MethodCall, yes: bool = Option(False, "--yes", help="Do not ask.")) -> None:
    """Delete a map and all that is in it."""
    name = call.values["name"]
    call.handle.map(name)
    if not yes:
        typer.confirm(f"Delete the map {name} with all its entities?", abort=True)
    print(f"{name}: {call()} entities deleted")
