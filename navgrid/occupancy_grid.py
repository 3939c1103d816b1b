"""The occupancy grid of a storey for an interval of heights (Deeken et al., section 4.2).

It has the obstacles of the layered costmap, for one interval instead of the parts of a robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navgrid.field_layer import FieldLayer, FieldVoxels, field_notes, sort_fields
from navgrid.grid import MARGIN, Grid, as_cells, grid_around
from navgrid.layer_members import LayerMembers
from navgrid.obstacle_layers import ObstacleLayers
from navgrid.policy import FLOOR, Policy
from navgrid.terrain import DriveLimits
from semmap.draw.picture import Picture
from semmap.query.geometry_notes import geometry_notes, level_notes
from semmap.query.storey_scene import SceneEntity, StoreyScene

_PLANES_AT_ONCE = 8


@dataclass(frozen=True, eq=False)
class StoreyGrid:
    """The occupancy grid of a storey.

    Attributes
    ----------
    cells : (rows, columns) int8
        Row 0 is the lowest y: 0 free, 100 occupied, -1 unknown.
    fields : tuple of FieldLayer
        The fields that are obstacles.
    fields_without_rule : tuple of str
        The names of fields that have no effect, as the policy does not name their property.
    interval : (low, high)
        Metres above the floor.
    """

    scene: StoreyScene
    grid: Grid
    cells: NDArray[np.int8]
    fields: tuple[FieldLayer, ...] = ()
    fields_without_rule: tuple[str, ...] = ()
    interval: tuple[float, float] = (0.05, 1.8)

    @property
    def notes(self) -> list[str]:
        """Sentences about missing geometry, missing storeys and fields, for a person."""
        fields = field_notes(self.fields, self.fields_without_rule)
        return [*geometry_notes(self.scene.entities), *level_notes(self.scene), *fields]

    def write(self, folder: Path | str, *, picture: bool = True) -> dict[str, Any]:
        """Write ``map.yaml``, ``map.pgm`` and ``plan.png`` for Nav2; return a summary."""
        from navgrid.grid_output import write_grid

        return write_grid(self, Path(folder), picture=picture)

    def plot(self) -> Picture:
        """Draw the floor plan with the grid."""
        from navgrid.grid_output import with_grid
        from semmap.draw.floor_plan import floor_plan  # loads matplotlib

        return Picture.drawn(lambda path: floor_plan(with_grid(self), path))

    def __repr__(self) -> str:
        return f"<grid of {self.scene.storey}: {self.grid.size_text}>"

    def _repr_png_(self) -> bytes:
        return self.plot().png


def plane_heights(interval: tuple[float, float], increment: float) -> list[float]:
    """Return the heights from the lower to the upper end of an interval, at most `increment` apart.

    ValueError for an interval that is upside down, or an increment that is not above 0.

    >>> plane_heights((0.0, 0.25), 0.1)
    [0.0, 0.1, 0.2, 0.25]
    """
    low, high = interval
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise ValueError(f"interval {low} to {high} m is upside down: give its lower end first")
    if not (math.isfinite(increment) and increment > 0):
        raise ValueError(f"increment is {increment} m; give one above zero")
    count = math.floor((high - low) / increment + 1e-9)
    planes = [low + i * increment for i in range(count + 1)]
    return planes if math.isclose(planes[-1], high, abs_tol=1e-9) else [*planes, high]


def storey_grid(
    scene: StoreyScene,
    interval: tuple[float, float] = (0.05, 1.8),
    resolution: float = 0.05,
    *,
    increment: float | None = None,
    free_outside: bool = False,
    policy: Policy | None = None,
    limits: DriveLimits | None = None,
    grid: Grid | None = None,
    fields: Mapping[str, FieldVoxels] | None = None,
) -> StoreyGrid:
    """Return the occupancy grid of a storey.

    Parameters
    ----------
    interval : (low, high)
        Closed, metres above the floor of the room that a cell lies in.
    resolution : float
        The side of a cell, metres.
    increment : float, optional
        Cut the meshes by planes so many metres apart, as in the paper, which misses what lies
        between two planes. By default the interval is exact, and the inside of closed meshes is
        occupied, too.
    free_outside : bool
        Make cells outside of rooms and doorways free. By default they are unknown, in maps that
        have rooms.
    policy, limits : optional
        Which entity is an obstacle; the steps and slopes of floors that are not.
    grid : Grid, optional
        By default it covers the rooms, else the floors, and the obstacles, with a margin of
        `navgrid.grid.MARGIN`.
    fields : mapping of FieldVoxels, optional
        Fields by name. Those that the policy puts on a layer of obstacles are obstacles here, too.

    Raises
    ------
    ValueError
        The storey has neither rooms nor obstacles, or the interval contains the floor.

    Examples
    --------
    >>> from semmap.geometry.mesh import box_mesh
    >>> shelf = box_mesh((0.5, 0.5, 0.4), (1.5, 0.8, 0.42)).triangles
    >>> scene = StoreyScene("ground", 0.0, (SceneEntity(1, "shelf1", "object", triangles=shelf),))
    >>> (storey_grid(scene, resolution=0.1).cells == 100).sum()
    np.int64(44)
    """
    planes = plane_heights(interval, increment or interval[1] - interval[0] or 1.0)
    if interval[0] <= 0 <= interval[1]:
        raise ValueError(
            f"interval {interval[0]:g} to {interval[1]:g} m contains the floor, which would be "
            "occupied as a whole; begin above it, for example at 0.05 m"
        )
    policy = policy or Policy.default()
    members = LayerMembers(scene, policy, limits or DriveLimits())
    grid = grid or _grid_around(members, interval, resolution)
    layers = ObstacleLayers(members, grid)
    occupied = np.zeros(grid.shape, np.bool_)
    for layer in members.layers:
        occupied |= layers.cells(layer, [interval])[0] if increment is None else layers.areas(layer)
    if increment is not None:
        for i in range(0, len(planes), _PLANES_AT_ONCE):
            heights = planes[i : i + _PLANES_AT_ONCE]
            occupied |= layers.solids([(h, h) for h in heights], fill=False).any(axis=0)
    sorted_fields, without_rule = sort_fields(fields or {}, policy)
    lethal = [field for field in sorted_fields.values() if not field.is_social]
    for field in lethal:
        occupied |= field.obstacles(layers.levels, [interval], grid)[0]
    cells = as_cells(occupied, np.logical_and(layers.unknown, not free_outside))
    return StoreyGrid(scene, grid, cells, tuple(lethal), tuple(without_rule), interval)


def _grid_around(members: LayerMembers, interval: tuple[float, float], resolution: float) -> Grid:
    """The grid around the rooms, the regions that are obstacles, and what is in the interval.

    Without rooms, it is around the floors, too.
    """
    low, high = members.floors[0] + interval[0], members.floors[-1] + interval[1]
    entities = [e for e in members.scene.entities if e.kind == "room"]
    if not entities:
        entities = [e for e in members.scene.entities if _is_walked(members, e, high)]
    entities += [e for e in members.obstacles() if _reaches(e, low, high)]
    corners = [entity.bounds for entity in entities if entity.bounds is not None]
    if not corners:
        raise ValueError(
            f"storey {members.scene.storey} has neither rooms nor obstacles from its floor at "
            f"{members.scene.elevation:g} m on: import walls, furniture or rooms"
        )
    return grid_around(corners, resolution, MARGIN)


def _is_walked(members: LayerMembers, entity: SceneEntity, high: float) -> bool:
    """Whether an object is a floor of the storey; the ground around a building is none."""
    is_floor = members.policy.layer_of(entity) == FLOOR and "ground" not in entity.types
    return is_floor and entity.heights is not None and entity.heights[0] <= high


def _reaches(entity: SceneEntity, low: float, high: float) -> bool:
    if entity.kind == "region" or entity.heights is None:
        return entity.kind == "region"
    return entity.heights[0] <= high and entity.heights[1] >= low
