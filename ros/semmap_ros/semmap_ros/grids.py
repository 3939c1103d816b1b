"""The grids of a map's storeys as messages: occupancy, costmaps of a robot, and masks of zones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid, check_storey_names
from navgrid.launch_files import ros_name
from navgrid.masks import Mask, keepout_mask, speed_mask
from navgrid.nav2 import as_occupancy
from semmap.query.storey_scene import StoreyScene

if TYPE_CHECKING:
    import semmap
    from navgrid.costmap import Costmap
    from semmap_ros.node import MapNode


class StoreyTopic(NamedTuple):
    """The cells (rows, columns) of a storey's topic, and how a mask is read."""

    scene: StoreyScene
    grid: Grid
    cells: NDArray[np.int8]
    mask: Mask | None = None


def read_grids(node: MapNode, map: semmap.Map) -> dict[str, StoreyTopic]:
    """Return the grids of the storeys that the node's parameters name, by their topics.

    Raises
    ------
    LookupError, ValueError
        As `Map.grids` and `Map.costmaps`; two storeys would have the same names in ROS.
    """
    found: dict[str, StoreyTopic] = {}
    low, high = node.value("interval")
    robot, options = node.value("robot"), {"resolution": node.value("resolution")}
    for name in node.value("storeys"):
        chosen: dict[str, Any] = {"storey": name or None} | options
        for grid in map.grids(interval=(low, high), **chosen):
            top = f"~/{ros_name(grid.scene.storey)}"
            found[f"{top}/grid"] = StoreyTopic(grid.scene, grid.grid, grid.cells)
            for kind, masked in (("keepout", keepout_mask), ("speed", speed_mask)):
                mask = masked(grid.scene.entities, grid.grid)
                if mask is not None:
                    made = StoreyTopic(grid.scene, grid.grid, mask.cells, mask)
                    found[f"{top}/{kind}_mask"] = made
        for costmap in _costmaps(node, map, chosen) if robot else ():
            top = f"~/{ros_name(costmap.scene.storey)}/costmap"
            costs = {top: costmap.master}
            costs |= {
                f"{top}/{ros_name(part.name)}": of_part
                for part, of_part in zip(costmap.parts, costmap.costs, strict=True)
            }
            for topic, cells in costs.items():
                found[topic] = StoreyTopic(costmap.scene, costmap.grid, as_occupancy(cells))
    storeys = {topic.scene.storey for topic in found.values()}
    check_storey_names(storeys)
    if len({ros_name(name) for name in storeys}) < len(storeys):
        names = ", ".join(sorted(storeys))
        raise ValueError(f"two of the storeys {names} have one name in ROS: rename one of them")
    return found


def _costmaps(node: MapNode, map: semmap.Map, chosen: dict[str, Any]) -> Iterator[Costmap]:
    """The costmaps of the node's robot, with the posture and the obstacles that it senses."""
    sensed = node.robot_inputs
    for costmap in map.costmaps(node.value("robot"), posture=sensed.posture, **chosen):
        storey = costmap.scene.storey
        scanned = sensed.grid_of(storey)
        if scanned is None:
            yield costmap
        else:
            options = chosen | {"storey": storey, "posture": sensed.posture, "static_map": scanned}
            yield map.costmap(node.value("robot"), **options)
