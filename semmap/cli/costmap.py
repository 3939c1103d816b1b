"""`semmap costmap`: the layered costmaps of a robot as files for Nav2, with pictures.

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
    Parts,
    PolicyFile,
    State,
    Urdf,
    VoxelSize,
    fields_of,
    moment_of,
    parts_of,
    voxels_of,
)
from semmap.number_list import parse_numbers

__all__ = ["costmap_command"]


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
        str | None, typer.Option(help="Only these rooms: lab1,corridor1 (semmap route --rooms).")
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
    from navgrid.costmap import Inflation
    from navgrid.costmap_output import (
        draw_costmap,
        show_explanation,
        show_files,
        show_notes,
        write_collisions,
    )
    from navgrid.free_space import check_free
    from navgrid.map_file import file_name
    from navgrid.nav2 import write_nav2
    from navgrid.policy import Policy
    from navgrid.readers.costmaps import read_costmaps
    from navgrid.terrain import DriveLimits

    if folder is None and explain is None:
        raise typer.BadParameter("give a folder (-o) or a point (--explain X,Y)")
    corners = None if box is None else parse_numbers(box, 4, "--box X0,Y0,X1,Y1")
    point = None if explain is None else parse_numbers(explain, 2, "--explain X,Y")
    shape = parts_of(robot, state, parts)
    rules = None if policy is None else Policy.read(policy)
    limits = DriveLimits(max_step, math.radians(max_slope))
    with cli.open_map(map_name) as connection:
        costmaps = read_costmaps(
            connection,
            shape,
            storey=storey,
            rooms=None if rooms is None else [name.strip() for name in rooms.split(",")],
            bounds=None if corners is None else (corners[0], corners[1], corners[2], corners[3]),
            resolution=resolution,
            policy=rules,
            inflation=Inflation(inflation_radius, cost_scaling_factor),
            limits=limits,
            static_map=static_map,
            moment=moment_of(at),
            fields=fields_of(connection, field, no_fields),
            voxels=voxels_of(connection, from_voxels, voxel_size),
            assume_sizes=assume_sizes,
        )
    if point is not None:
        show_explanation(costmaps, point[0], point[1], json_)
        return
    assert folder is not None
    for costmap in costmaps:
        check_free(costmap)
    written = []
    for costmap in costmaps:
        place = folder if len(costmaps) == 1 else folder / file_name(costmap.scene.storey)
        files = write_nav2(costmap, place, laser_height=laser_height)
        if headings:
            files["collisions"] = str(write_collisions(costmap, headings, place))
        if picture:
            files["pictures"] = [str(p) for p in draw_costmap(costmap, place)]
        written.append({**files, "folder": str(place)})
    if json_:
        print(json.dumps(written))
        return
    show_files(written)
    for costmap in costmaps:
        show_notes(costmap)
