"""The costmaps of a robot as files for Nav2, with pictures; none without a free cell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import check_storey_names, file_name
from navgrid.inflation import INSCRIBED, LETHAL
from navgrid.launch_files import write_building_launch
from navgrid.map_file import folder_of
from navgrid.nav2 import Files, write_nav2
from semmap.error import Error
from semmap.query.storey_scene import SceneEntity
from semmap.robot import Part

if TYPE_CHECKING:
    from navgrid.costmap import Costmap


def write_costmap(
    costmap: Costmap, folder: Path, laser_height: float, headings: int, *, picture: bool
) -> Files:
    """Write what `Costmap.write` describes; return what was written."""
    check_free(costmap)
    files = write_nav2(costmap, folder, laser_height=laser_height)
    if headings:
        files["collisions"] = str(_write_collisions(costmap, headings, folder))
    if picture:
        files["pictures"] = [str(p) for p in draw_costmap(costmap, folder)]
    return {**files, "folder": str(folder)}


def write_costmaps(
    costmaps: Sequence[Costmap],
    folder: Path | str,
    *,
    laser_height: float = 0.25,
    headings: int = 0,
    picture: bool = True,
) -> list[Files]:
    """Write the costmaps of a building's storeys, the lowest first; return what was written.

    Each storey has a folder, unless there is only one, and above them lie the launch files of the
    building. The options are those of `Costmap.write`.

    Raises
    ------
    ValueError
        The robot can stand nowhere on a storey, or two storeys would have the same names.
    """
    folder, names = Path(folder), [costmap.scene.storey for costmap in costmaps]
    check_storey_names(names)
    for costmap in costmaps:
        check_free(costmap)
    written = [
        write_costmap(
            costmap, folder_of(name, folder, len(names)), laser_height, headings, picture=picture
        )
        for name, costmap in zip(names, costmaps, strict=True)
    ]
    if len(written) > 1:
        write_building_launch(folder, written)
    return written


def draw_master(costmap: Costmap, path: Path, title: str = "master costmap") -> Path:
    """Draw the master in the colours of costmap_2d."""
    return _draw(costmap, costmap.master, path, title)


def draw_costmap(costmap: Costmap, folder: Path) -> list[Path]:
    """Draw the master and each part's costmap in the colours of costmap_2d; return the pictures."""
    drawn = [draw_master(costmap, folder / "master.png")]
    for part, costs in zip(costmap.parts, costmap.costs, strict=True):
        low, high = part.interval
        path = folder / f"{file_name(part.name)}.png"
        drawn.append(_draw(costmap, costs, path, f"{part.name}, {low:.2f} to {high:.2f} m"))
    return drawn


def _draw(costmap: Costmap, costs: NDArray[np.uint8], path: Path, what: str) -> Path:
    from semmap.draw.costmap import costmap_picture  # loads matplotlib

    title, grid = f"{costmap.scene.storey}: {what}", costmap.grid
    return costmap_picture(costs, grid.origin, grid.resolution, path, title=title)


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


class NoFreeCellError(Error, ValueError):
    """No cell of a master costmap is free; the message names the cause and how to fix it."""


def check_free(costmap: Costmap) -> None:
    """Raise `NoFreeCellError` unless the robot can be in at least one cell."""
    if not (costmap.master < INSCRIBED).any():
        storey = costmap.scene.storey
        raise NoFreeCellError(f"storey {storey}: no cell of the costmap is free: {_cause(costmap)}")


def drivable(costmaps: Sequence[Costmap]) -> tuple[list[Costmap], list[str]]:
    """The costmaps with a free cell, and why others have none, as the roof of a building.

    Raises
    ------
    NoFreeCellError
        None has a free cell.
    """
    free: list[Costmap] = []
    closed: list[NoFreeCellError] = []
    for costmap in costmaps:
        try:
            check_free(costmap)
        except NoFreeCellError as error:
            closed.append(error)
        else:
            free.append(costmap)
    if closed and not free:
        raise closed[0]
    return free, [str(error) for error in closed]


def _cause(costmap: Costmap) -> str:
    known = ~costmap.unknown
    if not known.any():
        return (
            "it lies outside of every room and doorway; draw rooms there, or name rooms or a box "
            "within them"
        )
    shares = [
        (float(costmap.occupied[layer.name][number][known].mean()), part, number, layer)
        for number, part in enumerate(costmap.parts)
        for layer in costmap.layers
    ]
    share, part, number, layer = max(shares, key=lambda item: item[0])
    lethal = float((costmap.master[known] == LETHAL).mean())
    if share < 0.5:
        radius, _ = costmap.inflation.radii(part, layer.padding)
        return (
            f"obstacles cover {lethal:.0%} of it, and part {part.name} keeps {radius:.2f} m from "
            "them; take a smaller robot or resolution, or a layer with less padding"
        )
    much, where = f"{share:.0%} of it for part {part.name}", f"layer {layer.name}"
    if layer not in costmap.policy.layers:
        return f"{where} covers {much}"
    cells = np.argwhere(costmap.occupied[layer.name][number])
    found = costmap.obstacles.occupants(layer.name, costmap.intervals[number], cells)
    entity, _ = max(found, key=lambda pair: pair[1])
    return f"{entity.name} ({where}) covers {much}; {_fix(costmap, entity, part)}"


def _fix(costmap: Costmap, entity: SceneEntity, part: Part) -> str:
    """How to make an entity that covers a storey not an obstacle."""
    floors = costmap.obstacles.members.floors
    tops = [] if entity.heights is None else [entity.heights[1] - floor for floor in floors]
    rise = min((top for top in tops if top > 0), default=0.0)
    if entity.kind == "region" or not 0 < rise <= part.interval[1]:
        return "check its type, its place and the policy"
    return (
        f"its top is {rise:.3f} m above the floor at z = {floors[0]:.3f} m, and the robot drives "
        f"over steps of {costmap.limits.max_step:.3f} m: set the floor of the rooms to its top, or "
        "allow a higher step by max_step="
    )
