"""`semmap grid`: one occupancy grid per storey as files for Nav2, with a floor plan."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
)

if TYPE_CHECKING:
    from navgrid.occupancy_grid import StoreyGrid


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
    from navgrid.map_file import folder_of
    from semmap.number_list import parse_numbers

    low, high = parse_numbers(interval, 2, "--interval LOW,HIGH")
    with cli.chosen_map(map_name) as house:
        grids = house.grids(
            storey=storey,
            interval=(low, high),
            resolution=resolution,
            increment=increment,
            free_outside=free_outside,
            policy=policy,
            max_step=max_step,
            max_slope=max_slope,
            at=at,
            fields=fields_of(house, field, no_fields),
            voxel_size=voxel_size if from_voxels else None,
            assume_sizes=assume_sizes,
        )
    written = [
        made.write(folder_of(made.scene.storey, folder, len(grids)), picture=picture)
        for made in grids
    ]
    if json_:
        print(json.dumps(written))
    else:
        _show(grids, written)


def _show(grids: Sequence[StoreyGrid], written: Sequence[dict[str, Any]]) -> None:
    for made, row in zip(grids, written, strict=True):
        cli.out.print(
            f"{row['storey']}: {row['map']}, {row['width']} x {row['height']} cells of "
            f"{row['resolution']:g} m: {row['occupied']} occupied, {row['free']} free, "
            f"{row['unknown']} unknown"
        )
        for note in made.notes:
            cli.out.print(f"{row['storey']}: {note}", style="yellow")
