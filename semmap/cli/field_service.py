"""The commands `semmap fields serve`, `source` and `send`: the service and its sources."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli
from semmap.cli.chosen_fields import chosen_fields

if TYPE_CHECKING:
    import threading

source = typer.Typer(no_args_is_help=True, help="Sources of the running service.")


def add_service_commands(fields: typer.Typer) -> None:
    """Add the commands to those of `semmap fields`."""
    fields.command("serve")(serve)
    fields.command("send")(send)
    fields.add_typer(source, name="source")


def serve(
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="YAML; see docs/fields.md.")
    ] = None,
    sources: Annotated[
        list[str] | None,
        typer.Option(
            "--source",
            help="NAME=PERCEPTS or NAME:SOURCE=PERCEPTS; PERCEPTS are socket, recording:FOLDER, "
            "mcap:FILE or plugin:NAME. Repeatable.",
        ),
    ] = None,
    rates: Annotated[
        list[str] | None, typer.Option("--rate", help="NAME=UPDATES PER SECOND. Repeatable.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Stop after this time; by default never.")
    ] = None,
    voxel_size: Annotated[float, typer.Option(help="Edge of a voxel in metres.")] = 0.05,
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


def send(
    name: Annotated[str, typer.Argument(help="Of the source.")],
    percept: Annotated[str, typer.Argument(help="JSON, or - for one a line of the input.")] = "-",
    map_name: cli.MapName = None,
) -> None:
    """Send percepts to a source of the running service."""
    lines = sys.stdin if percept == "-" else [percept]
    with chosen_fields(map_name) as found:
        found.send(name, (_json(line) for line in lines if line.strip()))


@source.command("ls")
def list_sources(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the running sources: their updates, what they provide, and their errors."""
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
    percepts: Annotated[
        str, typer.Option("--from", help="socket, recording:FOLDER, mcap:FILE or plugin:NAME.")
    ] = "socket",
    kind: Annotated[
        str | None, typer.Option("--source", help="The installed source; by default NAME.")
    ] = None,
    rate: Annotated[float, typer.Option(help="The most updates per second.")] = 20.0,
    timeout: Annotated[
        float, typer.Option(help="Seconds without a percept until it is unknown; 0 for never.")
    ] = 30.0,
    options: Annotated[
        list[str] | None, typer.Option("--option", help="KEY=VALUE of the source. Repeatable.")
    ] = None,
    map_name: cli.MapName = None,
) -> None:
    """Start a source in the running service."""
    given: dict[str, Any] = {}
    for each in options or ():
        key, equals, value = each.partition("=")
        if not equals:
            raise ValueError(f"--option {each}: write KEY=VALUE")
        given[key] = _value(value)
    with chosen_fields(map_name) as found:
        found.start_source(name, percepts, source=kind, rate=rate, timeout=timeout, options=given)


@source.command("stop")
def stop_source(name: str, map_name: cli.MapName = None) -> None:
    """Stop a source of the running service; what it provides is unknown from then on."""
    with chosen_fields(map_name) as found:
        found.stop_source(name)


def _json(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise ValueError(f"the percept is not JSON: {error}") from None


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
