"""The causes of a cost: entities and fields, by robot part and layer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navgrid.headings import hits
from navgrid.inflation import INSCRIBED, LETHAL
from navgrid.policy import SOCIAL
from navgrid.window import grown

if TYPE_CHECKING:
    from navgrid.costmap import Costmap

ALL = 0xFFFF
"""Every heading."""


@dataclass(frozen=True)
class CostSource:
    """A cause of the cost of a cell: entities on a layer, at the heights of a part.

    Attributes
    ----------
    entities : tuple of str
        The names of the nearest entities of the layer.
    distance : float
        From the cell to theirs, metres.
    cost : int
        The cost of the cell if this layer were alone; 253 if it takes some headings of a cell at
        which several layers or parts together leave none.
    field : str, optional
        The name of the field that has these entities; None for entities of the map.
    assumed : tuple of str
        Those of the entities whose geometry is a typical box for their type.
    """

    part: str
    layer: str
    entities: tuple[str, ...]
    distance: float
    cost: int
    field: str | None = None
    assumed: tuple[str, ...] = ()


def cost_sources(costmap: Costmap, row: int, column: int) -> list[CostSource]:
    """Return the causes of the cost of a cell, the highest cost first.

    For each part and layer within reach, these are the entities at the nearest occupied cells.
    """
    grid = costmap.grid
    outer = grown((slice(row, row + 1), slice(column, column + 1)), costmap.reach, grid)
    first = np.array([outer[0].start, outer[1].start])
    assumed = {entity.name for entity in costmap.scene.entities if entity.assumed}
    fields = {field.name: field for field in costmap.field_layers}
    found: list[CostSource] = []
    here = (row - outer[0].start, column - outer[1].start)
    blocked = costmap.master[row, column] in (INSCRIBED, LETHAL)
    alone = False
    shared = []
    for number, part in enumerate(costmap.parts):
        for layer in costmap.layers:
            cells = costmap.occupied[layer.name][number][outer]
            if not cells.any():
                continue
            at = np.argwhere(cells) + first
            squared = ((at - (row, column)) ** 2).sum(axis=1)
            costs = costmap.inflation.costs(cells, grid.resolution, part, layer.padding)
            cost = int(costs[here])
            footprint = costmap.parts[number].footprint
            hit = int(hits(cells, footprint, grid.resolution, "stand", layer.padding)[here])
            if hit == ALL:
                cost, alone = (LETHAL if cells[here] else INSCRIBED), True
            if cost or hit:
                distance = math.sqrt(squared.min()) * grid.resolution
                names = _occupants(costmap, layer.name, number, at[squared == squared.min()])
                field = fields.get(layer.name)
                on = layer.name if field is None else field.layer
                of = None if field is None else field.name
                guesses = tuple(n for n in names if n in assumed) if field is None else ()
                if hit:
                    shared.append(len(found))
                found.append(CostSource(part.name, on, names, distance, cost, of, guesses))
        for name, social in costmap.social.items():
            if cost := int(social[number, row, column]):
                names = _occupants(costmap, name, number, np.array([(row, column)]))
                found.append(CostSource(part.name, SOCIAL, names, 0.0, cost, name))
    if blocked and not alone:
        for k in shared:
            found[k] = replace(found[k], cost=INSCRIBED)
    return sorted(found, key=lambda source: (-source.cost, source.distance, source.part))


def _occupants(
    costmap: Costmap, layer: str, part: int, cells: NDArray[np.int64]
) -> tuple[str, ...]:
    """The names of what occupies cells on a layer."""
    if layer in costmap.static:
        return (layer,)
    interval = costmap.intervals[part]
    for field in costmap.field_layers:
        if field.name == layer:
            return field.entities(costmap.obstacles.levels, interval, costmap.grid, cells)
    found = costmap.obstacles.occupants(layer, interval, cells)
    return tuple(sorted(entity.name for entity, _ in found))
