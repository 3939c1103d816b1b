"""The commands `semmap fields`: what space contains, and the service and sources of it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from semmap import cli
from semmap.api.spatial_fields import SpatialFields
from semmap.cli.texts import json_value, key_values, numbers

if TYPE_CHECKING:
    import threading

    from semmap.api.spatial_fields import SpaceAnswer

fields = typer.Typer(no_args_is_help=True, help="What space contains, voxel by voxel.")
source = typer.Typer(no_args_is_help=True, help="Sources of the running service.")
fields.add_typer(source, name="source")

VoxelSize = Annotated[float, Option(help="Edge of a voxel in metres.")]


@contextmanager
def chosen_fields(map_name: str | None, voxel_size: float = 0.05) -> Iterator[SpatialFields]:
    """The fields of the chosen map; its database is opened where no service answers."""
    with ExitStack() as stack:
        yield SpatialFields(
            cli.chosen_url(),
            map_name,
            cache(lambda: stack.enter_context(cli.chosen_map(map_name))),
            voxel_size,
            _note,
        )


def _note(text: str) -> None:
    if text.startswith("left out: "):
        cli.err.print(text, style="yellow")
    else:
        print(text, file=sys.stderr)


@fields.command(context_settings={"ignore_unknown_options": True})  # a point may begin with -
def at(
    point: str = Argument(help="X,Y,Z in the frame of the map, metres."),
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show which entities have the voxel at a point: objects, rooms, regions and agents."""
    place = numbers(point, "give X,Y,Z: the point", 3)
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
    text: str | None = Argument(None, help="SPARQL; see docs/fields_language.md."),
    file: Path | None = Option(None, "--file", "-f", help="Read it from a file."),
    output: Path | None = Option(None, "--output", "-o", help="File for the map of STORE (.vdb)."),
    keep_as: str | None = Option(None, "--keep", help="Store the map of STORE under this name."),
    limit: int = Option(50, help="The most rows in a table; JSON has all."),
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
    text: str | None = Argument(None, help="INSERT or DELETE in SPARQL."),
    file: Path | None = Option(None, "--file", "-f", help="Read it from a file."),
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
    seconds: float | None = Option(None, help="Stop after this time; by default never."),
    save_every: float | None = Option(
        None, help="Seconds between saves of the voxels, from which later commands start."
    ),
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
    folder: Path = Option(..., "--output", "-o", help="Folder for the files."),
    kept_name: str | None = Option(None, "--kept", help="Export this stored field instead."),
    version: int | None = Option(None, help="Version of the stored field; by default the newest."),
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
        more = f"{kept_name} version {done['version']}"
        if kept_name is None:
            sets = f"{done['entities']} entities in {done['sets']} sets"
            more = f"{sets}, {done['bytes_per_voxel']} bytes per voxel"
        cli.out.print(f"{what}, {more}")


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


# --- the service and its sources


@fields.command()
def serve(
    config: Path | None = Option(None, "--config", "-c", help="YAML; see docs/fields.md."),
    sources: list[str] | None = Option(
        None,
        "--source",
        help="NAME=PERCEPTS or NAME:SOURCE=PERCEPTS; PERCEPTS are socket, recording:FOLDER, "
        "mcap:FILE or plugin:NAME. Repeatable.",
    ),
    rates: list[str] | None = Option(None, "--rate", help="NAME=UPDATES PER SECOND. Repeatable."),
    seconds: float | None = Option(None, help="Stop after this time; by default never."),
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
) -> None:
    """Follow the map, run sources, and answer queries on a local socket; Ctrl-C stops.

    `semmap fields query`, `at`, `ls`, `watch` and `source` then ask this service.
    """
    import threading

    stop = threading.Event()

    def started(name: str, path: Path, names: list[str]) -> None:
        _stop_on_signals(stop)
        running = ", ".join(names) or "none yet"
        print(f"serving {name} on {path}; sources: {running}; Ctrl-C stops", flush=True)

    given: dict[str, Any] = {"sources": sources or (), "rates": rates or (), "seconds": seconds}
    with chosen_fields(map_name, voxel_size) as found:
        found.serve(config, **given, stop=stop, started=started)


def _stop_on_signals(stop: threading.Event) -> None:
    import signal
    import threading

    if threading.current_thread() is threading.main_thread():
        for each in (signal.SIGTERM, signal.SIGINT):
            signal.signal(each, lambda *_: stop.set())


@fields.command()
def send(
    name: str = Argument(help="Of the source."),
    percept: str = Argument("-", help="JSON, or - for one a line of the input."),
    map_name: cli.MapName = None,
) -> None:
    """Send percepts to a source of the running service."""
    lines = sys.stdin if percept == "-" else [percept]
    with chosen_fields(map_name) as found:
        found.send(name, (json_value(line, "the percept") for line in lines if line.strip()))


@source.command("ls")
def list_sources(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the running sources: their updates, their properties, and their errors."""
    with chosen_fields(map_name) as found:
        rows = found.sources()
    if json_:
        print(json.dumps(rows))
        return
    columns = ["name", "source", "percepts", "rate", "updates", "seconds", "provides", "error"]
    shown = [
        tuple(", ".join(row[c]) if isinstance(row[c], list) else row[c] for c in columns)
        for row in rows
    ]
    cli.show_rows(columns, shown, False)


@source.command("start")
def start_source(
    name: str,
    percepts: str = Option(
        "socket", "--from", help="socket, recording:FOLDER, mcap:FILE or plugin:NAME."
    ),
    kind: str | None = Option(None, "--source", help="The installed source; by default NAME."),
    rate: float = Option(20.0, help="The most updates per second."),
    timeout: float = Option(30.0, help="Seconds without a percept until it is unknown; 0: never."),
    options: list[str] | None = Option(None, "--option", help="KEY=VALUE of it. Repeatable."),
    map_name: cli.MapName = None,
) -> None:
    """Start a source in the running service."""
    given = key_values(options, "--option")
    with chosen_fields(map_name) as found:
        found.start_source(name, percepts, source=kind, rate=rate, timeout=timeout, options=given)


@source.command("stop")
def stop_source(name: str, map_name: cli.MapName = None) -> None:
    """Stop a source of the running service; its properties are unknown from then on."""
    with chosen_fields(map_name) as found:
        found.stop_source(name)
