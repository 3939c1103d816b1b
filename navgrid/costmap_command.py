"""`semmap costmap`: the layered costmaps of a robot as files for Nav2, with pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from navgrid.costmap import Costmap, CostSource, Inflation
from navgrid.free_space import check_free
from navgrid.headings import collisions
from navgrid.map_file import file_name
from navgrid.nav2 import Files, write_nav2
from navgrid.options import (
    MaxSlope,
    MaxStep,
    Moment,
    Parts,
    PolicyFile,
    State,
    Urdf,
    moment_of,
    parts_of,
)
from navgrid.policy import Policy
from navgrid.reader import read_costmaps
from navgrid.terrain import DriveLimits
from semmap import cli
from semmap.draw.palette import PART_COLOURS
from semmap.number_list import parse_numbers
from semmap.query.geometry_notes import geometry_notes

__all__ = ["costmap_command", "draw_costmap"]


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
            files["collisions"] = str(_write_collisions(costmap, headings, place))
        if picture:
            files["pictures"] = [str(p) for p in draw_costmap(costmap, place)]
        written.append({**files, "folder": str(place)})
    if json_:
        print(json.dumps(written))
        return
    show_files(written)
    for costmap in costmaps:
        show_notes(costmap)


def draw_costmap(costmap: Costmap, folder: Path) -> list[Path]:
    """Draw the master and each part's costmap in the colours of costmap_2d; return the pictures."""
    from semmap.draw.costmap import costmap_picture  # matplotlib is slow to load

    storey, grid = costmap.scene.storey, costmap.grid
    drawn = [
        costmap_picture(
            costmap.master,
            grid.origin,
            grid.resolution,
            folder / "master.png",
            title=f"{storey}: master costmap",
        )
    ]
    for number, part in enumerate(costmap.parts):
        low, high = part.interval
        drawn.append(
            costmap_picture(
                costmap.costs[number],
                grid.origin,
                grid.resolution,
                folder / f"{file_name(part.name)}.png",
                title=f"{storey}: {part.name}, {low:.2f} to {high:.2f} m",
            )
        )
    return drawn


def show_explanation(costmaps: Iterable[Costmap], x: float, y: float, json_: bool) -> None:
    """Print the causes of the cost at a point, per storey.

    Raises
    ------
    ValueError
        The point is on none of the grids.
    """
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
        sources = [CostSource(**source) for source in found["because"]]
        if sources:
            cli.out.print(_source_table(sources))


def _source_table(sources: Sequence[CostSource]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("cost", "part", "layer", "metres away", "entities"):
        table.add_column(name)
    for source in sources:
        table.add_row(
            str(source.cost),
            source.part,
            source.layer,
            f"{source.distance:.2f}",
            ", ".join(source.entities),
        )
    return table


def show_files(written: Iterable[Files]) -> None:
    """Print what was written, per storey."""
    for files in written:
        cli.out.print(
            f"{files['storey']}: {files['folder']}: {len(files['maps'])} maps of "
            f"{files['width']} x {files['height']} cells of {files['resolution']:g} m, "
            f"frame {files['frame']}"
        )
        for number, part in enumerate(files["parts"]):
            low, high = (round(end, 3) + 0.0 for end in part["interval"])
            radius = part[f"{part['inflate_by']}_radius"]
            cli.out.print(
                Text.assemble(
                    "  ",
                    (part["name"], PART_COLOURS[number % len(PART_COLOURS)]),
                    f": {low:.2f} to {high:.2f} m, {part['inflate_by']} radius {radius:.2f} m",
                )
            )


def show_notes(costmap: Costmap) -> None:
    """Print which objects of a storey have no geometry."""
    for note in geometry_notes(costmap.scene.entities):
        cli.out.print(f"{costmap.scene.storey}: {note}", style="yellow")


def _write_collisions(costmap: Costmap, headings: int, folder: Path) -> Path:
    path = folder / "collisions.npz"
    np.savez_compressed(
        path,
        collisions=collisions(costmap, headings),
        headings=2 * np.pi * np.arange(headings) / headings,
        origin=costmap.grid.origin,
        resolution=costmap.grid.resolution,
    )
    return path
