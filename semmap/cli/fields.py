"""The commands `semmap fields`: what space contains, and the service and sources of it."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Argument, Option

from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json
from semmap.cli.output import show_rows
from semmap.cli.signals import stop_on_signals
from semmap.cli.texts import json_value, numbers

if TYPE_CHECKING:
    from semmap.api.spatial_fields import SpaceAnswer

TextFile = Option(None, "--file", "-f", help="Read the text from a file.")


@command_of("SpatialFields.at", x=None, y=None, z=None)
def _at(
    call: MethodCall,
    point: str = Argument(metavar="X,Y,Z", help="In the frame of the map, metres."),
    json_: Json = False,
) -> None:
    """Show which entities have the voxel at a point: objects, rooms, regions and agents."""
    x, y, z = numbers(point, "give X,Y,Z: the point", 3)
    show_rows(["name", "kind"], call(x=x, y=y, z=z), json_)


@command_of("SpatialFields.query", text="[TEXT]", output="--output -o", keep="--keep", limit=None)
def _query(
    call: MethodCall,
    file: Path | None = TextFile,
    limit: int = Option(50, help="The most rows in a table; JSON has all."),
    json_: Json = False,
) -> None:
    """Query the fields of the map: occupied and free space, rooms, regions, stored fields.

    What nothing states, such as where people look without a source of gazes, is an error.
    """
    answer = call(text=_text(call, file, "query"), limit=None if json_ else limit)
    if json_:
        rows = {"variables": answer.names, "rows": answer.rows}
        print(json.dumps(answer.stored or (rows if answer.truth is None else answer.truth)))
    elif answer.truth is not None:
        print("yes" if answer.truth else "no")
    elif answer.stored is not None:
        _show_stored(answer.stored)
    else:
        _show_rows(answer)


def _text(call: MethodCall, file: Path | None, kind: str) -> str:
    text = call.values.pop("text", None)
    if (text is None) == (file is None):
        raise ValueError(f"give the {kind} as an argument, or a file with it by --file")
    return str(text) if file is None else file.read_text(encoding="utf-8")


@command_of("SpatialFields.update", text="[TEXT]")
def _update(call: MethodCall, file: Path | None = TextFile, json_: Json = False) -> None:
    """Insert and delete regions of entities; the map keeps them.

    A blank node, or a name that is not in the map, becomes a region of the map.
    """
    changes = call(text=_text(call, file, "update"))
    if json_:
        print(json.dumps(changes._asdict()))
        return
    for node, name in changes.new.items():
        print(f"{node} is {name}")
    print(f"changed: {', '.join(changes.changed) or 'nothing'}")


@command_of("SpatialFields.watch")
def _watch(call: MethodCall, json_: Json = False) -> None:
    """Follow the map; show and publish the relations between entities that begin and end.

    Other programs receive them on the channel `semmap_events` of the database.
    """
    with suppress(KeyboardInterrupt), call() as events:
        if not json_:
            print(f"{events.count} relations are true; Ctrl-C stops", flush=True)
        for event in events:
            print(json.dumps(event) if json_ else _sentence(event), flush=True)


def _sentence(event: dict[str, Any]) -> str:
    verb = "begins" if event["event"] == "begin" else "ends"
    return f"{event['subject']} {event['relation']} {event['object']} {verb}"


@command_of("SpatialFields.export", folder="--output -o")
def _export(call: MethodCall, json_: Json = False) -> None:
    done = call()
    if json_:
        print(json.dumps(done))
        return
    sets = "{entities} entities in {sets} sets, {bytes_per_voxel} bytes per voxel"
    more = f"{call.values['kept']} version {{version}}" if "kept" in call.values else sets
    what = f"{call.values['folder']}: {done['voxels']} voxels of {done['voxel_size']:g} m"
    print(f"{what}, {more.format(**done)}")


def _show_rows(answer: SpaceAnswer) -> None:
    rows = [tuple(_readable(value) for value in row) for row in answer]
    show_rows(list(answer.names), rows, False)
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
    print(f"{stored['property']}: {stored['voxels']} voxels{where}")


# --- the service and its sources


@command_of("SpatialFields.serve", config="--config -c", sources="--source", rates="--rate")
def _serve(call: MethodCall) -> None:
    """Follow the map, run sources, and answer queries on a local socket; Ctrl-C stops.

    `semmap fields query`, `at`, `ls`, `watch` and `source` then ask this service.
    """
    import threading

    stop = threading.Event()

    def started(name: str, path: Path, names: list[str]) -> None:
        stop_on_signals(stop)
        running = ", ".join(names) or "none yet"
        print(f"serving {name} on {path}; sources: {running}; Ctrl-C stops", flush=True)

    call(stop=stop, started=started)


@command_of("SpatialFields.send", percepts=None, voxel_size=None)
def _send(
    call: MethodCall, percept: str = Argument("-", help="JSON, or - for one a line of the input.")
) -> None:
    lines = sys.stdin if percept == "-" else [percept]
    call(percepts=(json_value(line, "the percept") for line in lines if line.strip()))


@command_of("SpatialFields.sources", voxel_size=None)
def _sources(call: MethodCall, json_: Json = False) -> None:
    rows = call()
    if json_:
        print(json.dumps(rows))
        return
    columns = ["name", "source", "percepts", "rate", "updates", "seconds", "provides", "error"]
    shown = [
        tuple(", ".join(row[c]) if isinstance(row[c], list) else row[c] for c in columns)
        for row in rows
    ]
    show_rows(columns, shown, False)


source = group(
    _sources,
    printed(
        "SpatialFields.start_source",
        "",
        percepts="--from",
        source="--source",
        options="--option KEY=VALUE",
        voxel_size=None,
    ),
    printed("SpatialFields.stop_source", "", voxel_size=None),
)

fields_command = group(
    printed("SpatialFields.ls", ("name", "kind", "voxels", "volume")),
    _at,
    _query,
    _update,
    printed(
        "SpatialFields.kept", ("name", "property", "about", "voxels", "versions"), voxel_size=None
    ),
    printed("SpatialFields.forget", "", voxel_size=None),
    _watch,
    _export,
    _serve,
    _send,
)
fields_command.add_typer(source, name="source", help="Sources of the running service.")
