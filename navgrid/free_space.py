"""Whether a costmap has a cell that the robot can be in, and if not, the cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from navgrid.inflation import INSCRIBED, LETHAL
from semmap.error import Error
from semmap.query.storey_scene import SceneEntity
from semmap.robot import Part

if TYPE_CHECKING:
    from navgrid.costmap import Costmap


class NoFreeCellError(Error, ValueError):
    """No cell of a master costmap is free; the message names the cause and how to fix it."""


def check_free(costmap: Costmap) -> None:
    """Raise `NoFreeCellError` unless the robot can be in at least one cell."""
    if not (costmap.master < INSCRIBED).any():
        storey = costmap.scene.storey
        raise NoFreeCellError(f"storey {storey}: no cell of the costmap is free: {_cause(costmap)}")


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
        "allow a higher step (--max-step)"
    )
