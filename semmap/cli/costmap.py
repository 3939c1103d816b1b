"""`semmap costmap`: the layered costmaps of a robot as files for Nav2, with pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

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
    Parts,
    PolicyFile,
    State,
    Urdf,
    VoxelSize,
    fields_of,
)
from semmap.number_list import parse_numbers


def costmap_command(
    robot: Urdf,
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for maps, parameters, pictures.")
    ] = None,
    state: State = None,
    parts: Parts = None,
    policy: PolicyFile = None,
    static_map: Annotated[
        Path | None, typer.Option(help="A map.yaml, such as one from SLAM, as a further layer.")
    ] = None,
    map_name: cli.MapName = None,
    storey: Annotated[str | None, typer.Option(help="Only this storey.")] = None,
    rooms: Annotated[
        str | None, typer.Option(help="Only these rooms: bath,hall (semmap route --rooms).")
    ] = None,
    box: Annotated[str | None, typer.Option(help="Only X0,Y0,X1,Y1, metres.")] = None,
    resolution: Annotated[float, typer.Option(help="Side of a cell, metres.")] = 0.05,
    inflation_radius: Annotated[float, typer.Option(help="Metres, as in costmap_2d.")] = 0.55,
    cost_scaling_factor: Annotated[float, typer.Option(help="1/metre, as in costmap_2d.")] = 3.0,
    max_step: MaxStep = 0.02,
    max_slope: MaxSlope = 6.0,
    laser_height: Annotated[
        float, typer.Option(help="Height of the localisation map above the floor, metres.")
    ] = 0.25,
    at: Moment = None,
    field: FieldNames = None,
    no_fields: NoFields = False,
    from_voxels: FromVoxels = False,
    voxel_size: VoxelSize = 0.05,
    assume_sizes: AssumeSizes = False,
    headings: Annotated[
        int, typer.Option(help="Also write collisions by heading, for so many headings.")
    ] = 0,
    explain: Annotated[
        str | None,
        typer.Option(
            "--explain", "--why", metavar="X,Y", help="Show the causes of a place's cost."
        ),
    ] = None,
    picture: Annotated[bool, typer.Option(help="Draw each costmap as a PNG, too.")] = True,
    json_: cli.Json = False,
) -> None:
    """Compute a robot's layered costmaps and write them for Nav2."""
    from navgrid.map_file import folder_of
    from semmap.cli.costmap_output import show_explanation, show_files

    if folder is None and explain is None:
        raise typer.BadParameter("give a folder (-o) or a point (--explain X,Y)")
    corners = None if box is None else parse_numbers(box, 4, "--box X0,Y0,X1,Y1")
    point = None if explain is None else parse_numbers(explain, 2, "--explain X,Y")
    with cli.chosen_map(map_name) as house:
        costmaps = house.costmaps(
            robot,
            posture=state,
            parts=parts,
            storey=storey,
            rooms=None if rooms is None else [name.strip() for name in rooms.split(",")],
            bounds=None if corners is None else (corners[0], corners[1], corners[2], corners[3]),
            resolution=resolution,
            inflation_radius=inflation_radius,
            cost_scaling_factor=cost_scaling_factor,
            policy=policy,
            static_map=static_map,
            max_step=max_step,
            max_slope=max_slope,
            at=at,
            fields=fields_of(house, field, no_fields),
            voxel_size=voxel_size if from_voxels else None,
            assume_sizes=assume_sizes,
        )
    if point is not None:
        show_explanation(costmaps, point[0], point[1], json_)
        return
    assert folder is not None
    options: Any = {"laser_height": laser_height, "headings": headings, "picture": picture}
    written = [
        made.write(folder_of(made.scene.storey, folder, len(costmaps)), **options)
        for made in costmaps
    ]
    if json_:
        print(json.dumps(written))
    else:
        show_files(written, costmaps)
