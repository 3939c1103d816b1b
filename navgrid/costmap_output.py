"""The costmaps of a robot as files for Nav2, with pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navgrid.grid import file_name
from navgrid.nav2 import Files, write_nav2

if TYPE_CHECKING:
    from navgrid.costmap import Costmap


def write_costmap(
    costmap: Costmap, folder: Path, laser_height: float, headings: int, *, picture: bool
) -> Files:
    """Write what `Costmap.write` describes; return what was written."""
    from navgrid.free_space import check_free

    check_free(costmap)
    files = write_nav2(costmap, folder, laser_height=laser_height)
    if headings:
        files["collisions"] = str(_write_collisions(costmap, headings, folder))
    if picture:
        files["pictures"] = [str(p) for p in draw_costmap(costmap, folder)]
    return {**files, "folder": str(folder)}


def draw_master(costmap: Costmap, path: Path) -> Path:
    """Draw the master in the colours of costmap_2d."""
    from semmap.draw.costmap import costmap_picture  # loads matplotlib

    storey, grid = costmap.scene.storey, costmap.grid
    return costmap_picture(
        costmap.master, grid.origin, grid.resolution, path, title=f"{storey}: master costmap"
    )


def draw_costmap(costmap: Costmap, folder: Path) -> list[Path]:
    """Draw the master and each part's costmap in the colours of costmap_2d; return the pictures."""
    from semmap.draw.costmap import costmap_picture

    storey, grid = costmap.scene.storey, costmap.grid
    drawn = [draw_master(costmap, folder / "master.png")]
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


def _write_collisions(costmap: Costmap, headings: int, folder: Path) -> Path:
    """Write collisions by heading as ``collisions.npz``; return its path."""
    from navgrid.headings import collisions

    path = folder / "collisions.npz"
    np.savez_compressed(
        path,
        collisions=collisions(costmap, headings),
        headings=2 * np.pi * np.arange(headings) / headings,
        origin=costmap.grid.origin,
        resolution=costmap.grid.resolution,
    )
    return path
