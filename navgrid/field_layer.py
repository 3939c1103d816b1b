"""Fields on the layers of a costmap: obstacles such as people, and social costs.

The policy states the layer of each property (`navgrid.policy.FieldRule`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.inflation import INSCRIBED
from navgrid.policy import FLOOR, NONE, SOCIAL, Policy
from navgrid.terrain import FloorLevel
from navgrid.voxel_cells import voxel_cells, voxels_between
from semmap.geometry.voxel_keys import sorted_unique
from semmap.geometry.voxels import Voxels

if TYPE_CHECKING:  # fields need OpenVDB, a costmap without them does not
    from semmap.fields.maps.grids import Grid as VoxelGrid
    from semmap.fields.maps.representation_map import RepresentationMap


@dataclass(frozen=True, eq=False)
class FieldVoxels:
    """A field as plain data: the name of its property, such as ``containsPerson``, and its voxels.

    `values`: (N,) numbers, where the field has some. `entities`: (N,) keys of the legend, where the
    voxels state entities. `about`: the entity that the whole field is about.
    """

    property: str
    voxels: Voxels
    values: NDArray[np.float32] | None = None
    entities: NDArray[np.int32] | None = None
    legend: Mapping[int, str] = field(default_factory=dict)
    about: str | None = None

    @classmethod
    def of_map(cls, map: RepresentationMap) -> FieldVoxels:
        """Return the voxels of a representation map; ValueError for a value that is not finite."""
        return field_voxels(map.grid, map.property.name, map.about, map.legend)


def field_voxels(
    grid: VoxelGrid,
    property: str,
    about: str | None = None,
    legend: Mapping[int, str] | None = None,
) -> FieldVoxels:
    """Return the voxels of a grid of `semmap_vdb` in the map's frame.

    A grid in another frame is resampled: each voxel gets the value at its centre. The legend has
    the entity of each value of an Int32Grid. ValueError for a value that is not finite.
    """
    from semmap.fields.maps.grids import lattice_of
    from semmap.fields.maps.lattice import Lattice

    upright = Lattice(grid.voxel_size)
    if lattice_of(grid) != upright:
        grid = grid.resampled(upright.voxel_size, upright.rows)
    indices, found = grid.read()
    made = FieldVoxels(
        property,
        Voxels(grid.voxel_size, indices.astype(np.int64)),
        legend=legend or {},
        about=about,
    )
    if found.dtype == np.bool_:
        return made
    if made.legend:
        return replace(made, entities=found.astype(np.int32))
    values = found.astype(np.float32)
    if not np.isfinite(values).all():
        raise ValueError(f"some values of {property} are not finite; store finite ones")
    return replace(made, values=values)


@dataclass(frozen=True, eq=False)
class FieldLayer:
    """A field on a layer of a costmap: one of the policy, with its padding (metres), or `SOCIAL`.

    `is_ground`: it shows floors, too: its voxels within one voxel of a floor are not obstacles.
    """

    name: str
    layer: str
    padding: float
    field: FieldVoxels
    is_ground: bool = False

    @property
    def is_social(self) -> bool:
        """True for costs below those of obstacles."""
        return self.layer == SOCIAL

    def values(
        self, levels: Sequence[FloorLevel], intervals: Sequence[tuple[float, float]], grid: Grid
    ) -> NDArray[np.float32]:
        """Return the largest value above each cell: (intervals, rows, columns) float32.

        `levels` are the floors of the cells, intervals metres above them.
        """
        found = np.zeros((len(intervals), *grid.shape), np.float32)
        for level in levels:
            for number, interval in enumerate(intervals):
                above = voxel_cells(
                    self.field.voxels, self._heights(level, interval), grid, self.field.values
                )
                found[number][level.cells] = above[level.cells]
        return found

    def obstacles(
        self, levels: Sequence[FloorLevel], intervals: Sequence[tuple[float, float]], grid: Grid
    ) -> NDArray[np.bool_]:
        """Return the occupied cells by interval, as `values`: those with a value above 0."""
        return self.values(levels, intervals, grid) > 0

    def entities(
        self,
        levels: Sequence[FloorLevel],
        interval: tuple[float, float],
        grid: Grid,
        cells: NDArray[np.int64],
    ) -> tuple[str, ...]:
        """Return the entities of the voxels above (n, 2) cells; the field's name if it has none."""
        field = self.field
        if field.entities is None:
            return (field.about or self.name,)
        wanted = np.zeros(grid.shape, np.bool_)
        wanted[tuple(cells.T)] = True
        names: set[str] = set()
        for level in levels:
            here = wanted & level.cells
            if not here.any():
                continue
            for number in sorted_unique(field.entities).tolist():
                chosen = (field.entities == number) & voxels_between(
                    field.voxels, self._heights(level, interval)
                )
                own = Voxels(field.voxels.size, field.voxels.indices[chosen])
                if (voxel_cells(own, (-np.inf, np.inf), grid)[here] > 0).any():
                    names.add(field.legend.get(number, f"{self.name} {number}"))
        return tuple(sorted(names)) or (self.name,)

    def _heights(self, level: FloorLevel, interval: tuple[float, float]) -> tuple[float, float]:
        low, high = interval
        if self.is_ground:
            low = max(low, 1.5 * self.field.voxels.size)
        return level.floor + low, level.floor + high


def sort_fields(
    fields: Mapping[str, FieldVoxels], policy: Policy
) -> tuple[dict[str, FieldLayer], list[str]]:
    """Return the fields that a policy puts on layers, and the names of those that have no rule.

    Fields on the layer `NONE` are in neither.
    """
    padding = {layer.name: layer.padding for layer in policy.layers}
    found: dict[str, FieldLayer] = {}
    without_rule = []
    for name, each in fields.items():
        layer = policy.layer_of_field(each.property)
        if layer is None:
            without_rule.append(name)
        elif layer == SOCIAL:
            found[name] = FieldLayer(name, SOCIAL, 0.0, each)
        elif layer != NONE:
            own = policy.fixed_layer if layer == FLOOR else layer
            found[name] = FieldLayer(name, own, padding[own], each, is_ground=layer == FLOOR)
    return found, without_rule


def social_costs(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the costs of values from 0 to 1; none closes a cell, since only obstacles do."""
    return np.clip(values * (INSCRIBED - 1), 0, INSCRIBED - 1).astype(np.uint8)


def field_lists(layers: Iterable[FieldLayer], without_rule: Iterable[str]) -> dict[str, object]:
    """Return for JSON the layer of each field as ``fields``, and ``fields_without_rule``."""
    return {
        "fields": {each.name: each.layer for each in layers},
        "fields_without_rule": [*without_rule],
    }


def field_notes(layers: Iterable[FieldLayer], without_rule: Iterable[str]) -> list[str]:
    """Return sentences about the fields in a grid or costmap, and those without a rule."""
    notes = []
    by_layer: dict[str, list[str]] = {}
    for each in layers:
        by_layer.setdefault(each.layer, []).append(each.name)
    for layer, names in by_layer.items():
        where = "social costs" if layer == SOCIAL else f"obstacles on layer {layer}"
        notes.append(f"fields as {where}: {', '.join(names)}")
    names = [*without_rule]
    if names:
        notes.append(f"fields that the policy has no rule for, not used: {', '.join(names)}")
    return notes
