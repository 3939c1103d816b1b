"""The commands `semmap fields`: query, watch, store and export what space contains."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semmap import cli

if TYPE_CHECKING:
    from semmap.fields.queries import SelectResult, StoreResult
    from semmap.fields.store.voxel_mirror import VoxelMirror

__all__ = ["fields"]

fields = typer.Typer(no_args_is_help=True, help="What space contains, voxel by voxel.")

VoxelSize = Annotated[float, typer.Option(help="Edge of a voxel in metres.")]


@fields.command()
def at(
    point: Annotated[str, typer.Argument(help="X,Y,Z in the frame of the map, metres.")],
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Show which entities have the voxel at a point."""
    place = _point(point)
    mirror = _current_mirror(map_name, voxel_size)
    (found,) = mirror.regions.entities_at([place])
    rows = [(mirror.names[n],) for n in sorted(int(str(n)) for n in found)]
    cli.show_rows(["name"], rows, json_)


@fields.command()
def ls(voxel_size: VoxelSize = 0.05, map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the entities that have voxels, with their number and volume in cubic metres."""
    mirror = _current_mirror(map_name, voxel_size)
    rows: list[tuple[Any, ...]] = []
    for number, name in sorted(mirror.names.items(), key=lambda item: item[1]):
        count = mirror.regions.size(number)
        rows.append((name, count, round(count * voxel_size**3, 6)))
    cli.show_rows(["name", "voxels", "volume"], rows, json_)


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
    """Query the fields of the map: occupied and free space, rooms, regions, stored fields."""
    if (text is None) == (file is None):
        raise ValueError("give the query as an argument, or a file with it by --file")
    from semmap.fields.queries import SelectResult, query
    from semmap.fields.queries.mirror_catalogue import mirror_catalogue
    from semmap.fields.store.map_store import load_maps
    from semmap.fields.store.reader import read_map_vocabulary, read_names

    sparql = text if file is None else file.read_text(encoding="utf-8")
    vocabulary = read_map_vocabulary()
    mirror = _current_mirror(map_name, voxel_size)
    with cli.open_map(map_name) as connection:
        names = read_names(connection)
        mirror.maps.put("kept", load_maps(connection, vocabulary).values())
    result = query(mirror_catalogue(mirror, names, vocabulary), str(sparql))
    if isinstance(result, bool):
        print(json.dumps(result) if json_ else ("yes" if result else "no"))
    elif isinstance(result, SelectResult):
        _show_rows(result, limit, json_)
    else:
        _store_result(result, output, keep_as, map_name, json_)


@fields.command()
def kept(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the stored fields with their versions."""
    from semmap.fields.store import field_store
    from semmap.fields.store.map_store import load_maps
    from semmap.fields.store.reader import read_map_vocabulary

    with cli.open_map(map_name) as connection:
        rows = [
            (name, m.property.name, m.about, len(m), len(field_store.versions(connection, name)))
            for name, m in load_maps(connection, read_map_vocabulary()).items()
        ]
    cli.show_rows(["name", "property", "about", "voxels", "versions"], rows, json_)


@fields.command()
def forget(name: str, map_name: cli.MapName = None) -> None:
    """Delete a stored field with all its versions."""
    from semmap.fields.store import field_store

    with cli.open_map(map_name) as connection:
        known = field_store.names(connection)
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
    import threading

    from semmap.fields.relations.tracker import RelationTracker
    from semmap.fields.store.event_channel import EventPublisher, as_json

    stop = threading.Event()
    engine = cli.engine()
    mirror = _resumed_mirror(engine, map_name, voxel_size)
    names: Mapping[Any, Any] = mirror.names
    tracker = RelationTracker(mirror.regions, names=names)
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
    _export_mirror(folder, _current_mirror(map_name, voxel_size), json_)


def _point(text: str) -> list[float]:
    import math

    try:
        place = [float(v) for v in text.split(",")]
    except ValueError:
        place = []
    if len(place) != 3 or not all(map(math.isfinite, place)):
        raise ValueError(f"{text} is not a point: give X,Y,Z, three numbers with commas between")
    return place


def _show_rows(result: SelectResult, limit: int, json_: bool) -> None:
    """Show at most `limit` rows as a table, or all rows as JSON."""
    from itertools import islice

    if json_:
        print(json.dumps(result.as_json()))
        return
    rows = [tuple(_readable(value) for value in row) for row in islice(result, limit)]
    cli.show_rows(list(result.names), rows, json_)
    if len(result) > limit:
        cli.out.print(f"{len(result) - limit} more rows: use --limit or --json")


def _readable(value: Any) -> Any:
    if isinstance(value, tuple):
        return " ".join(f"{v:.3f}" for v in value)
    return round(value, 6) if isinstance(value, float) else value


def _store_result(
    result: StoreResult, output: Path | None, name: str | None, map_name: str | None, json_: bool
) -> None:
    from semmap.fields.store.map_store import save_map

    summary: dict[str, Any] = {"property": result.property.name, "voxels": len(result)}
    where = ""
    if output is not None:
        result.to_map().write(output)
        summary["file"] = str(output)
        where += f", written to {output}"
    if name is not None:
        with cli.open_map(map_name) as connection:
            summary["kept"] = name
            summary["version"] = save_map(connection, name, result.to_map())
            connection.commit()
        where += f", stored as {name}, version {summary['version']}"
    if json_:
        print(json.dumps(summary))
    else:
        cli.out.print(f"{summary['property']}: {summary['voxels']} voxels{where}")


def _export_mirror(folder: Path, mirror: VoxelMirror, json_: bool) -> None:
    import numpy as np

    from semmap.fields.maps.export import write_points

    regions = mirror.regions
    parts = [np.zeros((0, 3), np.int32), *(regions.voxels(n) for n in sorted(mirror.names))]
    voxels = np.unique(np.concatenate(parts), axis=0)
    centres = (voxels + 0.5) * regions.voxel_size
    numbers = regions.set_numbers_at(centres)
    sets = {
        number: sorted(mirror.names[int(str(n))] for n in members)
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


def _current_mirror(map_name: str | None, voxel_size: float) -> VoxelMirror:
    """Return a mirror of the present state of a map."""
    with cli.database() as engine:
        return _resumed_mirror(engine, map_name, voxel_size)


def _resumed_mirror(engine: Any, map_name: str | None, voxel_size: float) -> VoxelMirror:
    from semmap.fields.store.voxel_mirror import VoxelMirror

    with engine.connect() as connection:
        cli.choose_map(connection, map_name)  # an unknown map is an error that lists all maps
    mirror = VoxelMirror.resume(engine, map_name, voxel_size)
    mirror.catch_up()
    for name, reason in mirror.left_out.items():
        cli.err.print(f"left out: {name}: {reason}", style="yellow")
    return mirror
