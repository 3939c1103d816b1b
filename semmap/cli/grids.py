"""`semmap grid` and `semmap costmap`: grids of each storey and robot as files for Nav2.

The commands load their modules when they run, so that their help is quick.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Option

from semmap import cli
from semmap.cli import options
from semmap.cli.output import print_folded
from semmap.cli.texts import numbers

if TYPE_CHECKING:
    from navgrid.costmap import Costmap
    from navgrid.nav2 import Files
    from navgrid.occupancy_grid import StoreyGrid
    from semmap.api.map import Map


def grid_command(
    folder: Path = Option(..., "--output", "-o", help="Folder for the maps."),
    map_name: cli.MapName = None,
    storey: options.Storey = None,
    interval: str = Option(
        "0.05,1.8", metavar="LOW,HIGH", help="Lowest and highest end above the floor, metres."
    ),
    increment: float | None = Option(None, help="Cut by planes so many metres apart; else exact."),
    resolution: float = Option(0.05, help="Side of a cell, metres."),
    free_outside: bool = Option(False, "--free-outside", help="Free, not unknown, outside rooms."),
    policy: options.PolicyFile = None,
    max_step: options.MaxStep = 0.02,
    max_slope: options.MaxSlope = 6.0,
    at: options.Moment = None,
    field: options.FieldNames = None,
    no_fields: options.NoFields = False,
    from_voxels: options.FromVoxels = False,
    voxel_size: options.VoxelSize = 0.05,
    assume_sizes: options.AssumeSizes = False,
    picture: bool = Option(True, help="Draw each grid as plan.png, too."),
    json_: cli.Json = False,
) -> None:
    """Write the obstacles of each storey as a Nav2 map (map.yaml, map.pgm)."""
    from navgrid.map_file import folder_of

    low, high = numbers(interval, "--interval LOW,HIGH", 2)
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
        _show_grids(grids, written)


def _show_grids(grids: Sequence[StoreyGrid], written: Sequence[dict[str, Any]]) -> None:
    for made, row in zip(grids, written, strict=True):
        cli.out.print(
            f"{row['storey']}: {row['map']}, {row['width']} x {row['height']} cells of "
            f"{row['resolution']:g} m: {row['occupied']} occupied, {row['free']} free, "
            f"{row['unknown']} unknown"
        )
        for note in made.notes:
            cli.out.print(f"{row['storey']}: {note}", style="yellow")


def costmap_command(
    robot: options.Urdf,
    folder: Path | None = Option(None, "--output", "-o", help="Folder for maps and pictures."),
    state: options.State = None,
    parts: options.Parts = None,
    policy: options.PolicyFile = None,
    static_map: Path | None = Option(
        None, help="A map.yaml, as one from SLAM, as a further layer."
    ),
    map_name: cli.MapName = None,
    storey: options.Storey = None,
    rooms: str | None = Option(None, help="Only these rooms: bath,hall (semmap route --rooms)."),
    box: str | None = Option(None, help="Only X0,Y0,X1,Y1, metres."),
    resolution: float = Option(0.05, help="Side of a cell, metres."),
    inflation_radius: float = Option(0.55, help="Metres, as in costmap_2d."),
    cost_scaling_factor: float = Option(3.0, help="1/metre, as in costmap_2d."),
    max_step: options.MaxStep = 0.02,
    max_slope: options.MaxSlope = 6.0,
    laser_height: float = Option(0.25, help="Of the localisation map above the floor, metres."),
    at: options.Moment = None,
    field: options.FieldNames = None,
    no_fields: options.NoFields = False,
    from_voxels: options.FromVoxels = False,
    voxel_size: options.VoxelSize = 0.05,
    assume_sizes: options.AssumeSizes = False,
    headings: int = Option(0, help="Also write collisions by heading, for so many headings."),
    explain: str | None = Option(
        None, "--explain", "--why", metavar="X,Y", help="Show the causes of a place's cost."
    ),
    picture: bool = Option(True, help="Draw each costmap as a PNG, too."),
    json_: cli.Json = False,
) -> None:
    """Compute a robot's layered costmaps and write them for Nav2."""
    from navgrid.map_file import folder_of

    if folder is None and explain is None:
        raise typer.BadParameter("give a folder (-o) or a point (--explain X,Y)")
    corners = None if box is None else numbers(box, "--box X0,Y0,X1,Y1", 4)
    point = None if explain is None else numbers(explain, "--explain X,Y", 2)
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
        _show_explanation(costmaps, point[0], point[1], json_)
        return
    assert folder is not None
    files: Any = {"laser_height": laser_height, "headings": headings, "picture": picture}
    written = [
        made.write(folder_of(made.scene.storey, folder, len(costmaps)), **files)
        for made in costmaps
    ]
    if json_:
        print(json.dumps(written))
    else:
        _show_costmaps(written, costmaps)


def fields_of(house: Map, names: list[str] | None, no_fields: bool) -> list[str] | None:
    """Return the fields that options choose, None for all; note those whose sources ended."""
    from navgrid.readers.fields import LIVE

    if no_fields and names:
        raise ValueError("--field and --no-fields exclude each other: give one of them")
    if no_fields:
        return []
    ended = [] if names else house.ended_fields
    if ended:
        cli.err.print(
            f"fields of sources without an update for {LIVE:.0f} s, not used: {', '.join(ended)}",
            style="yellow",
        )
    return names or None


def _show_explanation(costmaps: Iterable[Costmap], x: float, y: float, json_: bool) -> None:
    """Print the causes of the cost at a point, per storey; ValueError if it is on no grid."""
    rows: list[dict[str, Any]] = []
    for costmap in costmaps:
        try:
            row, column = costmap.grid.cell(x, y)
        except ValueError:
            continue
        rows.append(
            {
                "storey": costmap.scene.storey,
                "cost": int(costmap.master[row, column]),
                "because": [asdict(source) for source in costmap.explain(x, y)],
            }
        )
    if not rows:
        raise ValueError(f"({x}, {y}) is on none of the grids; give a point within the map")
    if json_:
        print(json.dumps(rows))
        return
    for found in rows:
        cli.out.print(f"{found['storey']}: cost {found['cost']}")
        lines = [
            (
                str(source["cost"]),
                source["part"],
                source["layer"],
                f"{source['distance']:.2f}",
                _causes(source),
            )
            for source in found["because"]
        ]
        if lines:
            print_folded(("cost", "part", "layer", "metres away", "entities"), lines)


def _causes(source: dict[str, Any]) -> str:
    entities = ", ".join(
        f"{name} (assumed size)" if name in source["assumed"] else name
        for name in source["entities"]
    )
    return entities if source["field"] is None else f"{entities} (field {source['field']})"


def _show_costmaps(written: Iterable[Files], costmaps: Iterable[Costmap]) -> None:
    """Print what was written, per storey, and what costmaps say of objects and fields."""
    from rich.text import Text

    from semmap.draw.palette import PART_COLOURS

    for files in written:
        cli.out.print(
            f"{files['storey']}: {files['folder']}: {len(files['maps'])} maps of "
            f"{files['width']} x {files['height']} cells of {files['resolution']:g} m, "
            f"frame {files['frame']}"
        )
        for number, part in enumerate(files["parts"]):
            low, high = (round(end, 3) + 0.0 for end in part["interval"])
            radii = part["inscribed_radius"], part["circumscribed_radius"]
            cli.out.print(
                Text.assemble(
                    "  ",
                    (part["name"], PART_COLOURS[number % len(PART_COLOURS)]),
                    f": {low:.2f} to {high:.2f} m, {radii[0]:.2f} to {radii[1]:.2f} m "
                    "around the axis",
                )
            )
        cli.out.print(
            f"  the shape fits at some headings, not all, in {files['some_headings']} cells"
        )
    for costmap in costmaps:
        for note in costmap.notes:
            cli.out.print(f"{costmap.scene.storey}: {note}", style="yellow")
