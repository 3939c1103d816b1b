"""Representation maps: one property, one value type, one grid (reMap, section 3.1)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.language.property import Property
from semmap.fields.regions.shapes import Region, _above_0, _points, _rigid, shape_of
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid

__all__ = ["Grid", "Lattice", "RepresentationMap", "ValueType", "VoxelBox", "empty"]

Grid = BoolGrid | Int32Grid | FloatGrid
ValueType = Literal["bool", "int32", "float32"]

GRIDS: dict[ValueType, type[BoolGrid] | type[Int32Grid] | type[FloatGrid]] = {
    "bool": BoolGrid,
    "int32": Int32Grid,
    "float32": FloatGrid,
}
DTYPES = {"bool": np.bool_, "int32": np.int32, "float32": np.float32}
_UNMOVED = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


class VoxelBox(NamedTuple):
    """Voxels from `low` to `high`, both included."""

    low: tuple[int, int, int]
    high: tuple[int, int, int]

    def grown(self, by: int) -> VoxelBox:
        """The box and `by` voxels around it."""
        x, y, z = self.low
        u, v, w = self.high
        return VoxelBox((x - by, y - by, z - by), (u + by, v + by, w + by))


@dataclass(frozen=True)
class Lattice:
    """Where a grid's voxels are: their size, metres, and its frame's pose in the shared one.

    `placement` has the upper three rows of a (4, 4) rigid transform.
    """

    voxel_size: float
    placement: tuple[tuple[float, ...], ...] = _UNMOVED

    @property
    def rows(self) -> list[list[float]]:
        """The placement as native code takes it."""
        return [list(row) for row in self.placement]

    def voxels_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) places in voxels of (N, 3) points of the shared frame, not rounded."""
        m = np.array(self.placement)
        at: NDArray[np.float64] = (points - m[:, 3]) @ m[:, :3] / self.voxel_size
        return at

    def points_at(self, voxels: ArrayLike) -> NDArray[np.float64]:
        """(N, 3) points of the shared frame, of places in voxels (a centre is at + 0.5)."""
        m = np.array(self.placement)
        own = np.asarray(voxels, float) * self.voxel_size
        points: NDArray[np.float64] = own @ m[:, :3].T + m[:, 3]
        return points

    def box(self, low: ArrayLike, high: ArrayLike) -> VoxelBox:
        """The voxels that a box of the shared frame, in metres, can meet."""
        corners = np.array(list(product(*np.stack([low, high]).astype(float).T)))
        at = np.floor(self.voxels_at(corners) + np.array([[-1e-9], [1e-9]])[:, :, None])
        return VoxelBox(_triple(at.min(axis=(0, 1))), _triple(at.max(axis=(0, 1))))

    def box_in(self, box: VoxelBox, other: Lattice) -> VoxelBox:
        """The voxels of another lattice that a box of this one can meet."""
        if other == self:
            return box
        ends = np.array([box.low, np.add(box.high, 1)])
        corners = self.points_at(np.array(list(product(*ends.T))))
        at = np.floor(other.voxels_at(corners))
        return VoxelBox(_triple(at.min(axis=0)), _triple(at.max(axis=0))).grown(1)


Evaluate = Callable[[VoxelBox | None], Grid]


class RepresentationMap:
    """What one property says of space: a value a voxel, sparse.

    A map never changes; operators (`semmap.fields.maps.operators`) make new ones. What they make is
    worked out when it is asked for, all of it by `grid` or a box alone by `within`.

    Parameters
    ----------
    property : Property
        What the map says. Things as its objects: a bool map says it of the one that it is `about`,
        an int32 map of those that its `legend` names. Numbers: a float32 map, or an int32 map
        without a legend.
    grid : BoolGrid, Int32Grid or FloatGrid
        Nobody may change it from now on.
    about : str, optional
        The thing that the map is about; a float32 map about one says how much.
    legend : mapping, optional
        What each value of an int32 map stands for.
    time : datetime, optional
        When the percept was, aware.

    Raises
    ------
    TypeError
        Values that the property cannot have.
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
        lattice = Lattice(grid.voxel_size, tuple(tuple(row) for row in grid.placement))
        self._setup(property, value_type_of(grid), lattice, about, legend, time)
        self._grid: Grid | None = grid
        self._evaluate: Evaluate = lambda box: grid if box is None else cropped(grid, box)

    @classmethod
    def lazily(
        cls,
        property: Property,
        value_type: ValueType,
        lattice: Lattice,
        evaluate: Evaluate,
        *,
        about: str | None = None,
        legend: Mapping[int, str] | None = None,
        time: datetime | None = None,
    ) -> RepresentationMap:
        """A map that is worked out when asked for: `evaluate` takes a box, or None for all.

        What it gives for a box is exact within, and nothing or anything outside.
        """
        made = cls.__new__(cls)
        made._setup(property, value_type, lattice, about, legend, time)
        made._grid = None
        made._evaluate = evaluate
        return made

    @classmethod
    def of_regions(
        cls,
        property: Property,
        regions: Iterable[tuple[Region, bool | int | float]],
        voxel_size: float,
        *,
        value_type: ValueType = "bool",
        about: str | None = None,
        legend: Mapping[int, str] | None = None,
        time: datetime | None = None,
    ) -> RepresentationMap:
        """A map of regions and their values; where they overlap, the last holds."""
        grid = empty(value_type, Lattice(_above_0(voxel_size, "voxel_size")))
        for region, value in regions:
            grid.fill(shape_of(region), value)  # type: ignore[arg-type]
        grid.prune()
        return cls(property, grid, about=about, legend=legend, time=time)

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
            raise TypeError(f"no {value_type} map of {property.name}: {reason}")

    @property
    def voxel_size(self) -> float:
        """Metres."""
        return self.lattice.voxel_size

    @property
    def rdf_class(self) -> str | None:
        """The semantic type of what it represents: the property's domain (reMap, section 4)."""
        return self.property.domain

    @property
    def grid(self) -> Grid:
        """All of it; not to be changed."""
        with self._lock:
            if self._grid is None:
                self._grid = self._evaluate(None)
            return self._grid

    def within(self, box: VoxelBox) -> Grid:
        """What of it lies within a box of its own voxels, without the rest being worked out."""
        with self._lock:
            grid = self._grid
        return cropped(grid if grid is not None else self._evaluate(box), box)

    def crop(self, low: ArrayLike, high: ArrayLike) -> RepresentationMap:
        """What of it can meet a box of the shared frame, from `low` to `high` in metres."""
        box = self.lattice.box(low, high)
        return self.like(
            lambda wider: self.within(box if wider is None else _common(box, wider)),
        )

    def like(self, evaluate: Evaluate) -> RepresentationMap:
        """A map of the same property, type and lattice with other voxels."""
        return RepresentationMap.lazily(
            self.property, self.value_type, self.lattice, evaluate,
            about=self.about, legend=self.legend, time=self.time,
        )  # fmt: skip

    def __len__(self) -> int:
        """How many voxels have a value."""
        return len(self.grid)

    def at(self, points: ArrayLike) -> NDArray[np.bool_] | NDArray[np.int32] | NDArray[np.float32]:
        """(N,) the values at (N, 3) points of the shared frame; 0 where there is none."""
        return self.grid.at(_points(points, "points"))

    def voxels(self) -> NDArray[np.int32]:
        """(N, 3) the voxels that have a value, in the map's own lattice."""
        return self.grid.read()[0]

    def values(self) -> NDArray[np.bool_] | NDArray[np.int32] | NDArray[np.float32]:
        """(N,) their values, in the same order."""
        return self.grid.read()[1]

    def points(self) -> NDArray[np.float64]:
        """(N, 3) their centres in the shared frame, metres."""
        return self.lattice.points_at(self.voxels() + 0.5)

    def placed(self, pose: ArrayLike) -> RepresentationMap:
        """The same map with its frame at another pose, a (4, 4) rigid transform, in the shared one.

        Costs nothing: a map that moves with its sensor is placed at each update.
        """
        rows = _rigid(pose, "pose")
        lattice = Lattice(self.voxel_size, tuple(tuple(row) for row in rows))
        return RepresentationMap.lazily(
            self.property, self.value_type, lattice,
            lambda box: (self.grid if box is None else self.within(box)).placed(rows),
            about=self.about, legend=self.legend, time=self.time,
        )  # fmt: skip

    def resampled(self, lattice: Lattice) -> RepresentationMap:
        """The same map in another lattice: each voxel has the value at its centre."""
        if lattice == self.lattice:
            return self

        def evaluate(box: VoxelBox | None) -> Grid:
            if box is None:
                return self.grid.resampled(lattice.voxel_size, lattice.rows)
            here = self.within(lattice.box_in(box, self.lattice))
            return here.resampled(lattice.voxel_size, lattice.rows)

        return RepresentationMap.lazily(
            self.property, self.value_type, lattice, evaluate,
            about=self.about, legend=self.legend, time=self.time,
        )  # fmt: skip

    def write(self, path: str | Path) -> None:
        """Write it as a `.vdb` file, the grid named after the property."""
        name = self.property.name if self.about is None else f"{self.property.name} {self.about}"
        self.grid.write(str(path), name)


def empty(value_type: ValueType, lattice: Lattice) -> Grid:
    """A grid without a value."""
    grid = GRIDS[value_type](lattice.voxel_size, False)
    grid.place(lattice.rows)
    return grid


def value_type_of(grid: Grid) -> ValueType:
    """What a voxel of a grid holds."""
    return next(name for name, kind in GRIDS.items() if isinstance(grid, kind))


def cropped(grid: Grid, box: VoxelBox) -> Grid:
    """What of a grid lies in a box of its voxels."""
    return grid.cropped(box.low, box.high)


def _common(a: VoxelBox, b: VoxelBox) -> VoxelBox:
    low, high = np.maximum(a.low, b.low), np.minimum(a.high, b.high)
    return VoxelBox(_triple(low), _triple(high))


def _triple(values: NDArray[np.float64] | NDArray[np.int_]) -> tuple[int, int, int]:
    return cast(tuple[int, int, int], tuple(int(v) for v in values))


def _misfit(
    property: Property, value_type: ValueType, about: str | None, named: bool
) -> str | None:
    """Why a property cannot have such values, if it cannot."""
    if property.subject != "voxel":
        return "its subjects are things, not voxels"
    if property.object == "number":
        if value_type == "bool":
            return "its objects are numbers; make a float32 or an int32 map"
        return "its objects are numbers; leave out the legend" if named else None
    if value_type == "float32" and property.measure is None:
        return "its objects are things, and it has no measure; make a bool or an int32 map"
    if value_type == "int32" and not named:
        return "its objects are things; name them in the legend"
    if value_type != "int32" and named:
        return "only int32 maps have a legend"
    return "values have a legend, so that the map is about none" if named and about else None
