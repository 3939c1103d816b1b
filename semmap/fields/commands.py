"""What fields add to the command line: `semmap fields` asks, watches, keeps and exports."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from semmap import cli
from semmap.fields.store import field_store
from semmap.fields.store.event_channel import Announcer, as_json
from semmap.fields.maps.export import write_grid, write_points
from semmap.fields.store.map_store import keep_map, kept_maps
from semmap.fields.queries import Rows, query
from semmap.fields.store.voxel_mirror import Mirror
from semmap.fields.queries.mirror_catalogue import catalogue_of
from semmap.fields.relations.relations import Relations
from semmap.fields.store.reader import read_names, read_vocabulary_of_map
from semmap.fields.queries.query_result import stored_map

__all__ = ["fields"]

fields = typer.Typer(no_args_is_help=True, help="What fills space, voxel by voxel.")

VoxelSize = Annotated[float, typer.Option(help="Metres.")]


@fields.command()
def at(
    point: Annotated[str, typer.Argument(help="X,Y,Z in the map's frame, metres.")],
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Tell which things fill the voxel at a point."""
    try:
        place = [float(v) for v in point.split(",")]
    except ValueError:
        place = []
    if len(place) != 3 or not np.isfinite(place).all():
        raise ValueError(f"at takes X,Y,Z, three numbers with commas between, not {point}")
    mirror = mirrored(map_name, voxel_size)
    (found,) = mirror.regions.entities_at([place])
    rows = [(mirror.names[n],) for n in sorted(int(str(n)) for n in found)]
    cli.show_rows(["name"], rows, json_)


@fields.command()
def ls(voxel_size: VoxelSize = 0.05, map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the things that fill space, with their voxels and cubic metres."""
    mirror = mirrored(map_name, voxel_size)
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
        Path | None, typer.Option("--output", "-o", help="Where STORE writes its map (.vdb).")
    ] = None,
    keep_as: Annotated[
        str | None, typer.Option("--keep", help="Name under which the database keeps STORE's map.")
    ] = None,
    limit: Annotated[int, typer.Option(help="Rows shown; all in JSON.")] = 50,
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Ask the fields of the map: what fills space, rooms, regions, what is free, what is kept."""
    if (text is None) == (file is None):
        raise ValueError("query takes its text, or --file with a file that holds it")
    asked = text if file is None else file.read_text(encoding="utf-8")
    vocabulary = read_vocabulary_of_map()
    mirror = mirrored(map_name, voxel_size)
    with cli.open_map(map_name) as connection:
        names = read_names(connection)
        mirror.maps.put("kept", kept_maps(connection, vocabulary).values())
    answer = query(catalogue_of(mirror, names, vocabulary), str(asked))
    if isinstance(answer, bool):
        print(json.dumps(answer) if json_ else ("yes" if answer else "no"))
    elif isinstance(answer, Rows):
        show_answer(answer, limit, json_)
    else:
        said: dict[str, Any] = {
            "property": answer.property.name,
            "voxels": len(answer.voxels),
        }
        if output is not None:
            stored_map(answer).write(output)
            said["file"] = str(output)
        if keep_as is not None:
            with cli.open_map(map_name) as connection:
                said["kept"] = keep_as
                said["version"] = keep_map(connection, keep_as, stored_map(answer))
                connection.commit()
        if json_:
            print(json.dumps(said))
        else:
            where = "" if output is None else f", written to {output}"
            where += "" if keep_as is None else f", kept as {keep_as}, version {said['version']}"
            cli.out.print(f"{said['property']}: {said['voxels']} voxels{where}")


@fields.command()
def kept(map_name: cli.MapName = None, json_: cli.Json = False) -> None:
    """List the maps that the database keeps, with their versions."""
    with cli.open_map(map_name) as connection:
        rows = [
            (name, m.property.name, m.about, len(m), len(field_store.versions(connection, name)))
            for name, m in kept_maps(connection, read_vocabulary_of_map()).items()
        ]
    cli.show_rows(["name", "property", "about", "voxels", "versions"], rows, json_)


@fields.command()
def forget(name: str, map_name: cli.MapName = None) -> None:
    """Delete a map that the database keeps, with all its versions."""
    with cli.open_map(map_name) as connection:
        if name not in field_store.names(connection):
            known = ", ".join(field_store.names(connection)) or "none"
            raise LookupError(f"no field {name} is kept of this map; there are: {known}")
        field_store.forget(connection, name)
        connection.commit()


def show_answer(answer: Rows, limit: int, json_: bool) -> None:
    """Rows as a table, no more than `limit`; all of them as JSON."""
    if json_:
        print(json.dumps(answer.json()))
        return
    rows = [tuple(_readable(value) for value in row) for row in islice(answer, limit)]
    cli.show_rows(list(answer.names), rows, json_)
    if len(answer) > limit:
        cli.out.print(f"{len(answer) - limit} rows more: --limit shows them, --json gives all")


def _readable(value: Any) -> Any:
    if isinstance(value, tuple):
        return " ".join(f"{v:.3f}" for v in value)
    return round(value, 6) if isinstance(value, float) else value


@fields.command()
def watch(
    voxel_size: VoxelSize = 0.05,
    seconds: Annotated[
        float | None, typer.Option(help="Stop after that time; by default never.")
    ] = None,
    save_every: Annotated[
        float | None,
        typer.Option(help="Seconds; keep what fills space, for later commands to go on from."),
    ] = None,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Follow the map; tell which relations of things begin and end, and announce them.

    Others hear of it on the database's channel `semmap_events`.
    """
    stop = threading.Event()
    engine = cli.engine()
    mirror = _mirror(engine, map_name, voxel_size)
    names: Mapping[Any, Any] = mirror.names
    relations = Relations(mirror.regions, names=names)
    relations.update(mirror.regions.entities())
    announcer = Announcer(engine)

    def heard(changed: set[int]) -> None:
        events = relations.update(changed)
        announcer.announce(events)
        for event in events:
            print(json.dumps(as_json(event)) if json_ else str(event), flush=True)

    if not json_:
        cli.out.print(f"{len(relations.holding())} relations hold; Ctrl-C ends")
    timer = threading.Timer(seconds or 0, stop.set)
    if seconds is not None:
        timer.start()
    try:
        mirror.follow(stop, heard, save_every=save_every)
    except KeyboardInterrupt:
        stop.set()
    finally:
        timer.cancel()
        engine.dispose()


@fields.command()
def export(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the files.")],
    kept_name: Annotated[
        str | None, typer.Option("--kept", help="A map that the database keeps, instead.")
    ] = None,
    version: Annotated[
        int | None, typer.Option(help="Of the map that is kept; the newest by default.")
    ] = None,
    voxel_size: VoxelSize = 0.05,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Write the set numbers as OpenVDB, the register of sets, and the voxels as points."""
    if kept_name is not None:
        export_kept(folder, kept_name, version, map_name, json_)
        return
    if version is not None:
        raise ValueError("--version is that of a map that is kept: name it, --kept NAME")
    mirror = mirrored(map_name, voxel_size)
    regions = mirror.regions
    parts = [np.zeros((0, 3), np.int32), *(regions.voxels(n) for n in sorted(mirror.names))]
    voxels = np.unique(np.concatenate(parts), axis=0)
    centres = (voxels + 0.5) * voxel_size
    numbers = regions.set_numbers_at(centres)
    sets = {
        number: sorted(mirror.names[int(str(n))] for n in members)
        for number, members in regions.sets(numbers).items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    regions.write(folder / "sets.vdb")
    (folder / "sets.json").write_text(json.dumps(sets, indent=1) + "\n")
    write_points(folder / "points.ply", centres, numbers, name="set")
    memory = regions.memory()
    said = {
        "folder": str(folder),
        "voxel_size": voxel_size,
        "voxels": len(voxels),
        "entities": len(mirror.names),
        "sets": len(sets),
        "bytes_per_voxel": round(memory.bytes_per_voxel, 2),
    }
    if json_:
        print(json.dumps(said))
    else:
        cli.out.print(
            f"{folder}: {said['voxels']} voxels of {voxel_size:g} m, {said['entities']} entities "
            f"in {said['sets']} sets, {said['bytes_per_voxel']} bytes a voxel"
        )


def export_kept(
    folder: Path, name: str, version: int | None, map_name: str | None, json_: bool
) -> None:
    """Write a map that is kept as OpenVDB, its legend, and its voxels as points."""
    with cli.open_map(map_name) as connection:
        field = field_store.load(connection, name, version)
    folder.mkdir(parents=True, exist_ok=True)
    write_grid(folder / "field.vdb", field.grid, name)
    write_grid(folder / "points.ply", field.grid, name)
    if field.legend is not None:
        (folder / "legend.json").write_text(json.dumps(field.legend, indent=1) + "\n")
    said = {
        "folder": str(folder),
        "name": name,
        "version": field.version,
        "voxel_size": field.grid.voxel_size,
        "voxels": len(field.grid),
    }
    if json_:
        print(json.dumps(said))
    else:
        cli.out.print(
            f"{folder}: {said['voxels']} voxels of {field.grid.voxel_size:g} m, "
            f"{name} version {field.version}"
        )


def mirrored(map_name: str | None, voxel_size: float) -> Mirror:
    """A mirror of a map, as it is now."""
    with cli.database() as engine:
        return _mirror(engine, map_name, voxel_size)


def _mirror(engine: Any, map_name: str | None, voxel_size: float) -> Mirror:
    with engine.connect() as connection:
        cli.choose_map(connection, map_name)  # an error names the maps that there are
    mirror = Mirror.resume(engine, map_name, voxel_size)
    mirror.catch_up()
    for name, reason in mirror.left_out.items():
        cli.err.print(f"left out: {name}: {reason}", style="yellow")
    return mirror
