"""What grids add to the command line: `semmap grid`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from navgrid.map_file import file_name, write_map
from navgrid.source import read_wanted_storeys
from navgrid.storey_grid import StoreyGrid, storey_grid
from semmap import cli
from semmap.draw.view import Occupancy, StoreyView

__all__ = ["grid_command", "with_grid", "write_grid"]


def grid_command(
    folder: Annotated[Path, typer.Option("--output", "-o", help="Folder for the maps.")],
    map_name: cli.MapName = None,
    storey: Annotated[str | None, typer.Option(help="Only this storey.")] = None,
    interval: Annotated[
        tuple[float, float], typer.Option(help="Lowest and highest end above the floor, metres.")
    ] = (0.05, 1.8),
    increment: Annotated[
        float | None, typer.Option(help="Cut by planes so many metres apart; by default exact.")
    ] = None,
    resolution: Annotated[float, typer.Option(help="Metres a cell.")] = 0.05,
    free_outside: Annotated[
        bool, typer.Option("--free-outside", help="Free, not unknown, outside of rooms.")
    ] = False,
    picture: Annotated[bool, typer.Option(help="Draw each grid as plan.png, too.")] = True,
    json_: cli.Json = False,
) -> None:
    """Draw what stands in the way as a Nav2 map (map.yaml, map.pgm) a storey."""
    with cli.open_map(map_name) as connection:
        storeys = read_wanted_storeys(connection, storey)
    written = []
    for view in storeys:
        made = storey_grid(
            view, interval, resolution, increment=increment, free_outside=free_outside
        )
        place = folder if len(storeys) == 1 else folder / file_name(view.name)
        written.append(write_grid(made, place, interval, picture=picture))
    if json_:
        print(json.dumps(written))
        return
    for row in written:
        cli.out.print(
            f"{row['storey']}: {row['map']}, {row['width']} x {row['height']} cells of "
            f"{row['resolution']:g} m: {row['occupied']} occupied, {row['free']} free, "
            f"{row['unknown']} unknown"
        )


def write_grid(
    made: StoreyGrid, folder: Path, interval: tuple[float, float], *, picture: bool = True
) -> dict[str, Any]:
    """Write ``map.yaml``, ``map.pgm`` and ``plan.png`` into a folder; what they are, in words."""
    path = write_map(made.grid, made.cells, folder / "map")
    rows, columns = made.grid.shape
    said: dict[str, Any] = {
        "storey": made.storey.name,
        "map": str(path),
        "image": str(path.with_suffix(".pgm")),
        "elevation": made.storey.elevation,
        "interval": list(interval),
        "resolution": made.grid.resolution,
        "origin": list(made.grid.origin),
        "width": columns,
        "height": rows,
    }
    for name, value in (("occupied", 100), ("free", 0), ("unknown", -1)):
        said[name] = int(np.count_nonzero(made.cells == value))
    if picture:
        from semmap.draw.floor_plan import floor_plan  # slow to load, as all that draws

        said["picture"] = str(floor_plan(with_grid(made), folder / "plan.png"))
    return said


def with_grid(made: StoreyGrid) -> StoreyView:
    """The storey with its grid, as pictures take it."""
    grid = Occupancy(made.grid.origin, made.grid.resolution, made.cells)
    return replace(made.storey, occupancy=grid)
