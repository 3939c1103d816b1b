"""`semmap grid`: one occupancy grid per storey as files for Nav2, with a floor plan.

The command loads its modules when it runs, so that its help is quick.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from semmap import cli
from semmap.cli.grid_options import (
    AssumeSizes,
    FieldNames,
    FromVoxels,
    MaxSlope,
    MaxStep,
    Moment,
    NoFields,
    PolicyFile,
    VoxelSize,
    fields_of,
    moment_of,
    voxels_of,
)

__all__ = ["grid_command"]


def grid_command(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the maps.")],
    map_name: cli.MapName = None,
    storey: Annotated[str | None, typer.Option(help="Only this storey.")] = None,
    interval: Annotated[
        str,
        typer.Option(metavar="LOW,HIGH", help="Lowest and highest end above the floor, metres."),
    ] = "0.05,1.8",
    increment: Annotated[
        float | None, typer.Option(help="Cut by planes so many metres apart; by default exact.")
    ] = None,
    resolution: Annotated[float, typer.Option(help="Side of a cell, metres.")] = 0.05,
    free_outside: Annotated[
        bool, typer.Option("--free-outside", help="Free, not unknown, outside of rooms.")
    ] = False,
    policy: PolicyFile = None,
    max_step: MaxStep = 0.02,
    max_slope: MaxSlope = 6.0,
    at: Moment = None,
    field: FieldNames = None,
    no_fields: NoFields = False,
    from_voxels: FromVoxels = False,
    voxel_size: VoxelSize = 0.05,
    assume_sizes: AssumeSizes = False,
    picture: Annotated[bool, typer.Option(help="Draw each grid as plan.png, too.")] = True,
    json_: cli.Json = False,
) -> None:
    """Write the obstacles of each storey as a Nav2 map (map.yaml, map.pgm)."""
    from navgrid.field_layer import field_notes
    from navgrid.grid_output import write_grid
    from navgrid.map_file import file_name
    from navgrid.occupancy_grid import storey_grid
    from navgrid.policy import Policy
    from navgrid.terrain import DriveLimits
    from semmap.number_list import parse_numbers
    from semmap.query.geometry_notes import geometry_notes
    from semmap.query.storey_reader import read_storeys

    low, high = parse_numbers(interval, 2, "--interval LOW,HIGH")
    rules = None if policy is None else Policy.read(policy)
    limits = DriveLimits(max_step, math.radians(max_slope))
    with cli.open_map(map_name) as connection:
        voxels = voxels_of(connection, from_voxels, voxel_size)
        scenes = read_storeys(
            connection, storey, moment=moment_of(at), voxels=voxels, assume_sizes=assume_sizes
        )
        fields = fields_of(connection, field, no_fields)
    there = [scene for scene in scenes if scene.entities or scene.floors] or scenes
    grids = [
        storey_grid(
            scene,
            (low, high),
            resolution,
            increment=increment,
            free_outside=free_outside,
            policy=rules,
            limits=limits,
            fields=fields,
        )
        for scene in there
    ]
    written = []
    for made in grids:
        place = folder if len(grids) == 1 else folder / file_name(made.scene.storey)
        written.append(write_grid(made, place, (low, high), picture=picture))
    if json_:
        print(json.dumps(written))
        return
    for made, row in zip(grids, written, strict=True):
        cli.out.print(
            f"{row['storey']}: {row['map']}, {row['width']} x {row['height']} cells of "
            f"{row['resolution']:g} m: {row['occupied']} occupied, {row['free']} free, "
            f"{row['unknown']} unknown"
        )
        notes = field_notes(made.fields, made.fields_without_rule)
        for note in [*geometry_notes(made.scene.entities), *notes]:
            cli.out.print(f"{row['storey']}: {note}", style="yellow")
