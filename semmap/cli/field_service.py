"""The commands `semmap fields serve`, `source` and `send`: the service and its sources."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from semmap import cli
from semmap.fields.service.client import ServiceConnection, find_service

__all__ = ["add_service_commands"]

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
    import signal
    import threading

    from semmap.fields.service.endpoint import socket_of
    from semmap.fields.service.server import serving
    from semmap.fields.service.service import FieldService
    from semmap.fields.service.settings import read_settings

    settings = read_settings(config, sources or (), rates or ())
    engine = cli.engine()
    with engine.connect() as connection:
        name = cli.choose_map(connection, map_name)
    with find_service(cli.chosen_url(), name) as running:
        if running is not None:
            raise ValueError(f"a service of {name} is running: stop it first")
    path = socket_of(cli.chosen_url(), name)
    service = FieldService(engine, name, voxel_size, settings)
    stop = threading.Event()
    if threading.current_thread() is threading.main_thread():
        for each in (signal.SIGTERM, signal.SIGINT):
            signal.signal(each, lambda *_: stop.set())
    timer = threading.Timer(seconds or 0, stop.set)
    timer.daemon = True
    if seconds is not None:
        timer.start()
    names = ", ".join(each.name for each in settings.sources) or "none yet"
    try:
        with service.running(), serving(path, service.answer):
            print(f"serving {name} on {path}; sources: {names}; Ctrl-C stops", flush=True)
            stop.wait()
    finally:
        timer.cancel()
        engine.dispose()


def send(
    name: Annotated[str, typer.Argument(help="Of the source.")],
    percept: Annotated[str, typer.Argument(help="JSON, or - for one a line of the input.")] = "-",
    map_name: cli.MapName = None,
) -> None:
    """Send percepts to a source of the running service."""
    with find_service(cli.chosen_url(), map_name) as found:
        service = _needed(found)
        for line in sys.stdin if percept == "-" else [percept]:
            if line.strip():
                service.ask("percept", name=name, percept=_json(line))


@source.command("ls")
def list_sources(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the running sources: their updates, what they provide, and their errors."""
    with find_service(cli.chosen_url(), map_name) as found:
        rows = _needed(found).ask("sources")
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
    kept, _, path = percepts.partition(":")
    if kept in ("recording", "mcap"):
        percepts = f"{kept}:{Path(path).absolute()}"
    with find_service(cli.chosen_url(), map_name) as found:
        _needed(found).ask(
            "start",
            name=name,
            source=kind or name,
            percepts=percepts,
            rate=rate,
            timeout=timeout,
            options=given,
        )


@source.command("stop")
def stop_source(name: str, map_name: cli.MapName = None) -> None:
    """Stop a source of the running service; what it provides is unknown from then on."""
    with find_service(cli.chosen_url(), map_name) as found:
        _needed(found).ask("stop", name=name)


def _needed(found: ServiceConnection | None) -> ServiceConnection:
    if found is None:
        raise LookupError("no service is running for this map: start one by semmap fields serve")
    return found


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
