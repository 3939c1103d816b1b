"""The commands `semmap fields`: query, watch, store and export what space contains."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli
from semmap.cli.field_service import add_service_commands
from semmap.fields.service.client import find_service

if TYPE_CHECKING:
    from semmap.api.database import Database
    from semmap.fields.service.client import ServiceConnection
    from semmap.fields.store.mirror_state import MirrorState
    from semmap.fields.store.voxel_mirror import VoxelMirror

__all__ = ["fields"]

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
    with find_service(cli.chosen_url(), map_name, voxel_size) as service:
        if service is not None:
            rows = service.ask("at", point=place)
        else:
            mirror = _kept_space(map_name, voxel_size)
            (found,) = mirror.regions.entities_at([place])
            rows = sorted((mirror.names[n], mirror.roles[n]) for n in found)
    cli.show_rows(["name", "kind"], [tuple(row) for row in rows], json_)


@fields.command()
def ls(voxel_size: VoxelSize = 0.05, map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the entities that have voxels, with their number and volume in cubic metres."""
    with find_service(cli.chosen_url(), map_name, voxel_size) as service:
        if service is not None:
            found = service.ask("ls")
        else:
            mirror = _kept_space(map_name, voxel_size)
            found = sorted(
                (name, mirror.roles[each], mirror.regions.size(each))
                for each, name in mirror.names.items()
            )
    rows = [(name, kind, n, round(n * voxel_size**3, 6)) for name, kind, n in found]
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
    if (text is None) == (file is None):
        raise ValueError("give the query as an argument, or a file with it by --file")
    given: dict[str, Any] = {
        "text": text if file is None else file.read_text(encoding="utf-8"),
        "limit": None if json_ else limit,
        "output": None if output is None else str(output.absolute()),
        "keep": keep_as,
    }
    with find_service(cli.chosen_url(), map_name, voxel_size) as service:
        if service is not None:
            _note(f"answered by the service of {service.map_name}")
            reply = service.ask("query", **given)
        else:
            reply = _query_kept_state(given, map_name, voxel_size)
    left_out = reply.pop("left_out")
    if left_out:
        more = ", ..." if len(left_out) > 5 else ""
        names = ", ".join(left_out[:5])
        _note(f"unknown, as they have no voxels: {len(left_out)} entities: {names}{more}")
    if json_:
        shown = {key: value for key, value in reply.items() if key != "total"}
        print(json.dumps(reply.get("ask", reply.get("store", shown))))
    elif "ask" in reply:
        print("yes" if reply["ask"] else "no")
    elif "store" in reply:
        _show_stored(reply["store"])
    else:
        _show_rows(reply)


def _query_kept_state(
    given: dict[str, Any], map_name: str | None, voxel_size: float
) -> dict[str, Any]:
    """Answer a query from the map and what sources and users kept, without a service."""
    from semmap.fields.queries.mirror_catalogue import mirror_catalogue
    from semmap.fields.service.kept_answer import show_kept
    from semmap.fields.service.query_reply import query_reply
    from semmap.fields.store.names import read_map_vocabulary, read_names

    vocabulary = read_map_vocabulary()
    with cli.open_database() as database:
        mirror = _current_mirror(database, map_name, voxel_size)
        newest = show_kept(mirror, database.session, vocabulary)
        seen = f", sources as kept at {newest:%Y-%m-%d %H:%M:%S %Z}" if newest else ""
        _note(f"no service is running: answered from the kept state of the map{seen}")

        @contextmanager
        def transaction() -> Iterator[Any]:
            with database.session.transaction():
                yield database.session

        catalogue = mirror_catalogue(
            mirror, read_names(database.session), vocabulary, open_connection=transaction
        )
        return query_reply(catalogue, given.pop("text"), transaction, **given)


def _note(text: str) -> None:
    print(text, file=sys.stderr)


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
    if (text is None) == (file is None):
        raise ValueError("give the update as an argument, or a file with it by --file")
    sparql = str(text) if file is None else file.read_text(encoding="utf-8")
    with find_service(cli.chosen_url(), map_name, voxel_size) as service:
        if service is not None:
            reply = service.ask("update", text=sparql)
        else:
            reply = _update_map(sparql, map_name, voxel_size)
    if json_:
        print(json.dumps(reply))
        return
    for node, name in reply["new"].items():
        cli.out.print(f"{node} is {name}")
    cli.out.print(f"changed: {', '.join(reply['changed']) or 'nothing'}")


def _update_map(sparql: str, map_name: str | None, voxel_size: float) -> Any:
    from semmap.fields.queries.mirror_catalogue import mirror_catalogue
    from semmap.fields.service.kept_answer import show_kept
    from semmap.fields.service.map_update import update_map
    from semmap.fields.store.names import read_map_vocabulary, read_names

    vocabulary = read_map_vocabulary()
    with cli.open_database() as database:
        mirror = _current_mirror(database, map_name, voxel_size)
        show_kept(mirror, database.session, vocabulary)
        catalogue = mirror_catalogue(mirror, read_names(database.session), vocabulary)
        return update_map(mirror, catalogue, sparql, database.session)


@fields.command()
def kept(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the stored fields with their versions."""
    from semmap.fields.store import field_store
    from semmap.fields.store.map_store import load_maps
    from semmap.fields.store.names import read_map_vocabulary

    with cli.open_database() as database:
        session = database.session
        cli.show_map(session, map_name)
        rows = [
            (name, m.property.name, m.about, len(m), len(field_store.versions(session, name)))
            for name, m in load_maps(session, read_map_vocabulary()).items()
        ]
    cli.show_rows(["name", "property", "about", "voxels", "versions"], rows, json_)


@fields.command()
def forget(name: str, map_name: cli.MapName = None) -> None:
    """Delete a stored field with all its versions."""
    from semmap.fields.store import field_store

    with cli.open_map(map_name) as connection:
        known = field_store.names(connection, stateless=True)
        if name not in known:
            raise LookupError(
                f"there is no field {name} in this map; fields: {', '.join(known) or 'none'}"
            )
        field_store.forget(connection, name)
        connection.commit()


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
    with find_service(cli.chosen_url(), map_name, voxel_size) as service:
        if service is not None:
            _note(f"reported by the service of {service.map_name}")
            _watch_service(service, seconds, json_)
        else:
            _note("no service is running: relations of the map alone, without sources")
            _watch_map(map_name, voxel_size, seconds, save_every, json_)


def _watch_service(service: ServiceConnection, seconds: float | None, json_: bool) -> None:
    from contextlib import suppress

    service.send("watch", seconds=seconds)
    count = 0
    with suppress(KeyboardInterrupt):
        for event in service.replies():
            held = event.pop("held", None)
            if "over" in event:
                return
            if held is None:
                print(json.dumps(event) if json_ else _sentence(event), flush=True)
            elif held:
                count += 1
            elif not json_:
                cli.out.print(f"{count} relations are true; Ctrl-C stops")


def _sentence(event: dict[str, Any]) -> str:
    verb = "begins" if event["event"] == "begin" else "ends"
    return f"{event['subject']} {event['relation']} {event['object']} {verb}"


def _watch_map(
    map_name: str | None,
    voxel_size: float,
    seconds: float | None,
    save_every: float | None,
    json_: bool,
) -> None:
    import threading

    from semmap.fields.relations.tracker import RelationTracker
    from semmap.fields.store.event_channel import EventPublisher, as_json

    stop = threading.Event()
    engine = cli.engine()
    with engine.connect() as connection:
        map_name = cli.choose_map(connection, map_name)
    mirror = _resumed_mirror(engine, map_name, voxel_size)
    names: Mapping[Any, Any] = mirror.names
    tracker = RelationTracker(mirror.regions, names=names, views=mirror.views, spaces=mirror.spaces)
    tracker.update(mirror.regions.entities())
    publisher = EventPublisher(engine)

    def on_change(changed: set[int]) -> None:
        events = tracker.update(changed)
        publisher.publish(events)
        for event in events:
            print(json.dumps(as_json(event)) if json_ else str(event), flush=True)

    if not json_:
        cli.out.print(f"{len(tracker.holding())} relations are true; Ctrl-C stops")
    timer = threading.Timer(seconds or 0, stop.set)
    if seconds is not None:
        timer.start()
    try:
        mirror.follow(stop, on_change, save_every=save_every)
    except KeyboardInterrupt:
        stop.set()
    finally:
        timer.cancel()
        engine.dispose()


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
    if kept_name is not None:
        _export_stored(folder, kept_name, version, map_name, json_)
        return
    if version is not None:
        raise ValueError("--version is a version of a stored field: name the field by --kept NAME")
    with cli.open_database() as database:
        _export_mirror(folder, _current_mirror(database, map_name, voxel_size), json_)


def _point(text: str) -> list[float]:
    import math

    try:
        place = [float(v) for v in text.split(",")]
    except ValueError:
        place = []
    if len(place) != 3 or not all(map(math.isfinite, place)):
        raise ValueError(f"{text} is not a point: give X,Y,Z, three numbers with commas between")
    return place


def _show_rows(reply: dict[str, Any]) -> None:
    rows = [tuple(_readable(value) for value in row) for row in reply["rows"]]
    cli.show_rows(reply["variables"], rows, False)
    if reply["total"] > len(rows):
        print(f"{reply['total'] - len(rows)} more rows: use --limit or --json")


def _readable(value: Any) -> Any:
    if isinstance(value, (tuple, list)):
        return " ".join(f"{v:.3f}" for v in value)
    return round(value, 6) if isinstance(value, float) else value


def _show_stored(stored: dict[str, Any]) -> None:
    where = f", written to {stored['file']}" if "file" in stored else ""
    if "kept" in stored:
        where += f", stored as {stored['kept']}, version {stored['version']}"
    cli.out.print(f"{stored['property']}: {stored['voxels']} voxels{where}")


def _export_mirror(folder: Path, mirror: MirrorState | VoxelMirror, json_: bool) -> None:
    import numpy as np

    from semmap.fields.maps.export import write_points

    regions = mirror.regions
    bodies = [n for n in mirror.names if n not in mirror.spaces]
    parts = [np.zeros((0, 3), np.int32), *(regions.voxels(n) for n in bodies)]
    voxels = np.unique(np.concatenate(parts), axis=0)
    centres = (voxels + 0.5) * regions.voxel_size
    numbers = regions.set_numbers_at(centres)
    sets = {
        number: sorted(mirror.names[n] for n in members)
        for number, members in regions.sets(numbers).items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    regions.write(folder / "sets.vdb")
    (folder / "sets.json").write_text(json.dumps(sets, indent=1) + "\n")
    write_points(folder / "points.ply", centres, numbers, name="set")
    summary = {
        "folder": str(folder),
        "voxel_size": regions.voxel_size,
        "voxels": len(voxels),
        "entities": len(mirror.names),
        "sets": len(sets),
        "bytes_per_voxel": round(regions.memory().bytes_per_voxel, 2),
    }
    if json_:
        print(json.dumps(summary))
    else:
        cli.out.print(
            f"{folder}: {summary['voxels']} voxels of {regions.voxel_size:g} m, "
            f"{summary['entities']} entities in {summary['sets']} sets, "
            f"{summary['bytes_per_voxel']} bytes per voxel"
        )


def _export_stored(
    folder: Path, name: str, version: int | None, map_name: str | None, json_: bool
) -> None:
    """Write a stored field as OpenVDB, its legend, and its voxels as points."""
    from semmap.fields.maps.export import write_grid
    from semmap.fields.store import field_store

    with cli.open_map(map_name) as connection:
        field = field_store.load(connection, name, version)
    folder.mkdir(parents=True, exist_ok=True)
    write_grid(folder / "field.vdb", field.grid, name)
    write_grid(folder / "points.ply", field.grid, name)
    if field.legend is not None:
        (folder / "legend.json").write_text(json.dumps(field.legend, indent=1) + "\n")
    summary = {
        "folder": str(folder),
        "name": name,
        "version": field.version,
        "voxel_size": field.grid.voxel_size,
        "voxels": len(field.grid),
    }
    if json_:
        print(json.dumps(summary))
    else:
        cli.out.print(
            f"{folder}: {summary['voxels']} voxels of {field.grid.voxel_size:g} m, "
            f"{name} version {field.version}"
        )


def _current_mirror(
    database: Database, map_name: str | None, voxel_size: float
) -> MirrorState | VoxelMirror:
    """Return the voxels of the present state of a map, which the session sees from then on.

    They are those of the kept state where the map did not change since. Else they are computed, and
    kept for the next command.
    """
    from semmap.fields.store.mirror_state import is_current, load_state

    name = cli.show_map(database.session, map_name)
    state = load_state(database.session, voxel_size)
    if state is not None and is_current(database.session, state):
        return state
    return _resumed_mirror(database.engine, name, voxel_size)


def _kept_space(map_name: str | None, voxel_size: float) -> MirrorState | VoxelMirror:
    """Return the present state of a map, with what sources saw last."""
    from semmap.fields.store.field_store import has_maps

    with cli.open_database() as database:
        mirror = _current_mirror(database, map_name, voxel_size)
        if has_maps(database.session):
            from semmap.fields.service.kept_answer import PlainVocabulary, show_kept

            newest = show_kept(mirror, database.session, PlainVocabulary())
            if newest is not None:
                _note(f"no service is running: sources as kept at {newest:%Y-%m-%d %H:%M:%S %Z}")
    return mirror


def _resumed_mirror(engine: Any, map_name: str, voxel_size: float) -> VoxelMirror:
    from semmap.fields.store.voxel_mirror import VoxelMirror

    mirror = VoxelMirror.resume(engine, map_name, voxel_size)
    if mirror.catch_up():
        mirror.try_to_save()  # a user who may only read computes them each time
    for name, reason in mirror.left_out.items():
        cli.err.print(f"left out: {name}: {reason}", style="yellow")
    return mirror
