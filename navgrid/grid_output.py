"""The occupancy grid of a storey as files for Nav2, with a floor plan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navgrid.field_layer import field_lists
from navgrid.map_file import write_map
from semmap.draw.view import OccupancyView, StoreyView, storey_view
from semmap.query.geometry_notes import geometry_lists

if TYPE_CHECKING:
    from navgrid.occupancy_grid import StoreyGrid


def write_grid(made: StoreyGrid, folder: Path, *, picture: bool = True) -> dict[str, Any]:
    """Write ``map.yaml``, ``map.pgm`` and ``plan.png`` into a folder; return what they have."""
    path = write_map(made.grid, made.cells, folder / "map", comments=made.notes)
    rows, columns = made.grid.shape
    found: dict[str, Any] = {
        "storey": made.scene.storey,
        "map": str(path),
        "image": str(path.with_suffix(".pgm")),
        "elevation": made.scene.elevation,
        "interval": list(made.interval),
        "resolution": made.grid.resolution,
        "origin": list(made.grid.origin),
        "width": columns,
        "height": rows,
    }
    for name, value in (("occupied", 100), ("free", 0), ("unknown", -1)):
        found[name] = int(np.count_nonzero(made.cells == value))
    found |= geometry_lists(made.scene.entities)
    found |= field_lists(made.fields, made.fields_without_rule)
    if picture:
        from semmap.draw.floor_plan import floor_plan  # loads matplotlib

        found["picture"] = str(floor_plan(with_grid(made), folder / "plan.png"))
    return found


def with_grid(made: StoreyGrid) -> StoreyView:
    """Return the storey with its grid, for a floor plan."""
    grid = OccupancyView(made.grid.origin, made.grid.resolution, made.cells)
    return replace(storey_view(made.scene), occupancy=grid)
