"""Representation maps: one property, one value type, one grid (reMap, section 3.1)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.fields.checks import as_points, as_rigid_rows, positive
from semmap.fields.maps.grids import (
    Grid,
    ValueType,
    empty_grid,
    lattice_of,
    value_type_of,
)
from semmap.fields.maps.lattice import Lattice, VoxelBox
from semmap.fields.regions.shaped_region import Region, shape_of
from semmap.language.schema import Property

Evaluate = Callable[[VoxelBox | None], Grid]


class RepresentationMap:
    """The values of a property in space, for some voxels.

    A map never changes; operators (`semmap.fields.maps.operators`) make new ones. The voxels of a
    new map are computed when they are read: all of them by `grid`, or those in a box by `within`.

    Parameters
    ----------
    property : if its objects are entities: a bool map states it of the entity `about`, an int32 map
        of the entities in its `legend`. If its objects are numbers: a float32 map, or an int32 map
        without a legend. Other values raise a TypeError
    grid : the voxels. Do not change the grid later
    about : the entity that the map is about; a float32 map about an entity has degrees
    time : of the percept, aware
    """

    def __init__(
        self,
        property: Property,
        grid: Grid,
        *,
        about: str | None = None,
        legend: Mapping[int, str] | None = None,
        time: datetime | None = None,
    ) -> None:
        self._setup(property, value_type_of(grid), lattice_of(grid), about, legend, time)
        self._grid: Grid | None = grid
        self._evaluate: Evaluate = lambda box: grid if box is None else grid.cropped(*box)

    @classmethod
    def of_regions(
        cls,
        property: Property,
        regions: Iterable[tuple[Region, bool | int | float]],
        voxel_size: float,
        *,
        value_type: ValueType = "bool",
        **more: Any,
    ) -> RepresentationMap:
        """Return a map of regions and their values; where regions overlap, the last one counts.

        `more` are `about`, `legend` and `time`.
        """
        grid = empty_grid(value_type, Lattice(positive(voxel_size, "voxel_size")))
        for region, value in regions:
            grid.fill(shape_of(region), value)  # type: ignore[arg-type]
        grid.prune()
        return cls(property, grid, **more)

    def _setup(
        self,
        property: Property,
        value_type: ValueType,
        lattice: Lattice,
        about: str | None,
        legend: Mapping[int, str] | None,
        time: datetime | None,
    ) -> None:
        self.property = property
        self.value_type = value_type
        self.lattice = lattice
        self.about = about
        self.legend = MappingProxyType(dict(legend or {}))
        self.time = time
        self._lock = threading.Lock()
        reason = _misfit(property, value_type, about, bool(self.legend))
        if reason is not None:
            raise TypeError(f"{property.name} cannot have a {value_type} map: {reason}")

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel in metres."""
        return self.lattice.voxel_size

    @property
    def rdf_class(self) -> str | None:
        """The semantic type that the map represents: the domain of its property (section 4)."""
        return self.property.domain

    @property
    def grid(self) -> Grid:
        """All voxels. Do not change the grid."""
        with self._lock:
            if self._grid is None:
                self._grid = self._evaluate(None)
            return self._grid

    def within(self, box: VoxelBox) -> Grid:
        """Return the voxels in a box of the lattice; only these are computed."""
        with self._lock:
            grid = self._grid
        return (grid if grid is not None else self._evaluate(box)).cropped(*box)

    def read(self, box: VoxelBox | None) -> Grid:
        """Return the voxels in a box, or all voxels for None."""
        return self.grid if box is None else self.within(box)

    def __len__(self) -> int:
        """Return the number of voxels that have a value."""
        return len(self.grid)

    def at(self, points: ArrayLike) -> NDArray[np.bool_] | NDArray[np.int32] | NDArray[np.float32]:
        """Return the values (N,) at points (N, 3) of the shared frame; 0 without a value."""
        return self.grid.at(as_points(points, "points"))

    def voxels(self) -> NDArray[np.int32]:
        """Return the voxels (N, 3) that have a value, in the lattice of the map."""
        return self.grid.read()[0]

    def values(self) -> NDArray[np.bool_] | NDArray[np.int32] | NDArray[np.float32]:
        """Return the values (N,) of the `voxels`, in the same order."""
        return self.grid.read()[1]

    def points(self) -> NDArray[np.float64]:
        """Return the centres (N, 3) of the `voxels` in the shared frame, metres."""
        return self.lattice.points_at(self.voxels() + 0.5)

    def like(self, evaluate: Evaluate, **changes: Any) -> RepresentationMap:
        """Return a map whose voxels are computed when they are read; else like this one.

        `evaluate` returns the grid of a box, or of everything for None; its values outside of the
        box do not matter. `changes` are of the `property`, `value_type`, `lattice`, `about`,
        `legend` or `time`.
        """
        made = RepresentationMap.__new__(RepresentationMap)
        names = ("property", "value_type", "lattice", "about", "legend", "time")
        made._setup(**{name: getattr(self, name) for name in names} | changes)
        made._grid, made._evaluate = None, evaluate
        return made

    def placed(self, pose: ArrayLike) -> RepresentationMap:
        """Return the map with its frame at another pose (4, 4); this takes no time.

        Use it to place a map that moves with its sensor at each update.
        """
        rows = as_rigid_rows(pose, "pose")
        lattice = Lattice(self.voxel_size, tuple(tuple(row) for row in rows))
        return self.like(lambda box: self.read(box).placed(rows), lattice=lattice)

    def resampled(self, lattice: Lattice) -> RepresentationMap:
        """Return the map in another lattice: each voxel gets the value at its centre."""
        if lattice == self.lattice:
            return self

        def evaluate(box: VoxelBox | None) -> Grid:
            here = None if box is None else lattice.box_in(box, self.lattice)
            return self.read(here).resampled(lattice.voxel_size, lattice.rows)

        return self.like(evaluate, lattice=lattice)

    def write(self, path: str | Path) -> None:
        """Write the map to a `.vdb` file; its grid is named after the property."""
        name = self.property.name if self.about is None else f"{self.property.name} {self.about}"
        self.grid.write(str(path), name)


def _misfit(
    property: Property, value_type: ValueType, about: str | None, has_legend: bool
) -> str | None:
    """Return why a property cannot have such values; None if it can."""
    if property.subject != "voxel":
        return "its subjects are entities, not voxels"
    if property.object == "number":
        if value_type == "bool":
            return "its objects are numbers; make a float32 or an int32 map"
        return "its objects are numbers; leave out the legend" if has_legend else None
    if value_type == "float32" and property.measure is None:
        return "its objects are entities, and it has no measure; make a bool or an int32 map"
    if value_type == "int32" and not has_legend:
        return "its objects are entities; name them in the legend"
    if value_type != "int32" and has_legend:
        return "only int32 maps have a legend"
    if has_legend and about:
        return "a map with a legend is about its values; leave out the entity that it is about"
    return None
