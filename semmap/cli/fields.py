"""The commands `semmap fields`: query, watch, store and export what space contains."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli
from semmap.cli.chosen_fields import chosen_fields
from semmap.cli.field_service import add_service_commands

if TYPE_CHECKING:
    from semmap.api.space_answer import SpaceAnswer

fields = typer.Typer(no_args_is_help=True, help="What space contains, voxel by voxel.")

add_service_commands(fields)

VoxelSize = Annotated[float, typer.Option(help="Edge of a voxel in metres.")]


@fields.command(context_settings={"ignore_unknown_options": True})  # a point may begin with -
def at(
    point: Annotated[str, typer.Argument(help="X,Y,Z in the frame of the map, metres.")],
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show which entities have the voxel at a point: objects, rooms, regions and agents."""
    place = _point(point)
    with chosen_fields(map_name, voxel_size) as found:
        rows = found.at(*place)
    cli.show_rows(["name", "kind"], rows, json_)


@fields.command()
def ls(voxel_size: VoxelSize = 0.05, map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the entities that have voxels, with their number and volume in cubic metres."""
    with chosen_fields(map_name, voxel_size) as found:
        rows = found.ls()
    cli.show_rows(["name", "kind", "voxels", "volume"], rows, json_)


@fields.command("query")
def query_command(
    text: Annotated[str | None, typer.Argument(help="SPARQL; see docs/fields_language.md.")] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="Read it from a file.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File for the map of STORE (.vdb).")
    ] = None,
    keep_as: Annotated[
        str | None, typer.Option("--keep", help="Store the map of STORE under this name.")
    ] = None,
    limit: Annotated[int, typer.Option(help="The most rows in a table; JSON has all.")] = 50,
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Query the fields of the map: occupied and free space, rooms, regions, stored fields.

    What nothing states, such as where people look without a source of gazes, is an error.
    """
    asked = _text(text, file, "query")
    with chosen_fields(map_name, voxel_size) as found:
        answer = found.query(asked, limit=None if json_ else limit, output=output, keep=keep_as)
    if json_:
        rows = {"variables": answer.names, "rows": answer.rows}
        print(json.dumps(answer.stored or (rows if answer.truth is None else answer.truth)))
    elif answer.truth is not None:
        print("yes" if answer.truth else "no")
    elif answer.stored is not None:
        _show_stored(answer.stored)
    else:
        _show_rows(answer)


def _text(text: str | None, file: Path | None, kind: str) -> str:
    if (text is None) == (file is None):
        raise ValueError(f"give the {kind} as an argument, or a file with it by --file")
    return str(text) if file is None else file.read_text(encoding="utf-8")


@fields.command("update")
def update_command(
    text: Annotated[str | None, typer.Argument(help="INSERT or DELETE in SPARQL.")] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="Read it from a file.")] = None,
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Insert and delete regions of entities; the map keeps them.

    A blank node, or a name that is not in the map, becomes a region of the map.
    """
    asked = _text(text, file, "update")
    with chosen_fields(map_name, voxel_size) as found:
        changes = found.update(asked)
    if json_:
        print(json.dumps(changes._asdict()))
        return
    for node, name in changes.new.items():
        cli.out.print(f"{node} is {name}")
    cli.out.print(f"changed: {', '.join(changes.changed) or 'nothing'}")


@fields.command()
def kept(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the stored fields with their versions."""
    with chosen_fields(map_name) as found:
        rows = found.kept()
    cli.show_rows(["name", "property", "about", "voxels", "versions"], rows, json_)


@fields.command()
def forget(name: str, map_name: cli.MapName = None) -> None:
    """Delete a stored field with all its versions."""
    with chosen_fields(map_name) as found:
        found.forget(name)


@fields.command()
def watch(
    voxel_size: VoxelSize = 0.05,
    seconds: Annotated[
        float | None, typer.Option(help="Stop after this time; by default never.")
    ] = None,
    save_every: Annotated[
        float | None,
        typer.Option(help="Seconds between saves of the voxels, from which later commands start."),
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Follow the map; show and publish the relations between entities that begin and end.

    Other programs receive them on the channel `semmap_events` of the database.
    """
    with (
        suppress(KeyboardInterrupt),
        chosen_fields(map_name, voxel_size) as found,
        found.watch(seconds=seconds, save_every=save_every) as events,
    ):
        if not json_:
            cli.out.print(f"{events.count} relations are true; Ctrl-C stops")
        for event in events:
            print(json.dumps(event) if json_ else _sentence(event), flush=True)


def _sentence(event: dict[str, Any]) -> str:
    verb = "begins" if event["event"] == "begin" else "ends"
    return f"{event['subject']} {event['relation']} {event['object']} {verb}"


@fields.command()
def export(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the files.")],
    kept_name: Annotated[
        str | None, typer.Option("--kept", help="Export this stored field instead.")
    ] = None,
    version: Annotated[
        int | None, typer.Option(help="Version of the stored field; by default the newest.")
    ] = None,
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Write the voxels of all entities: OpenVDB, the sets of entities, and points."""
    with chosen_fields(map_name, voxel_size) as found:
        done = found.export(folder, kept_name, version)
    if json_:
        print(json.dumps(done))
    else:
        what = f"{folder}: {done['voxels']} voxels of {done['voxel_size']:g} m"
        more = f"{kept_name} version {done['version']}" if kept_name else _entities(done)
        cli.out.print(f"{what}, {more}")


def _entities(done: dict[str, Any]) -> str:
    return (
        f"{done['entities']} entities in {done['sets']} sets, "
        f"{done['bytes_per_voxel']} bytes per voxel"
    )


def _point(text: str) -> list[float]:
    import math

    try:
        place = [float(v) for v in text.split(",")]
    except ValueError:
        place = []
    if len(place) != 3 or not all(map(math.isfinite, place)):
        raise ValueError(f"{text} is not a point: give X,Y,Z, three numbers with commas between")
    return place


def _show_rows(answer: SpaceAnswer) -> None:
    rows = [tuple(_readable(value) for value in row) for row in answer]
    cli.show_rows(list(answer.names), rows, False)
    if answer.total > len(rows):
        print(f"{answer.total - len(rows)} more rows: use --limit or --json")


def _readable(value: Any) -> Any:
    if isinstance(value, (tuple, list)):
        return " ".join(f"{v:.3f}" for v in value)
    return round(value, 6) if isinstance(value, float) else value


def _show_stored(stored: dict[str, Any]) -> None:
    where = f", written to {stored['file']}" if "file" in stored else ""
    if "kept" in stored:
        where += f", stored as {stored['kept']}, version {stored['version']}"
    cli.out.print(f"{stored['property']}: {stored['voxels']} voxels{where}")
