"""Operators: new maps from maps (reMap, section 3.1.3).

Properties and types are checked at once. Voxels are computed when the new map is read, in a box
alone where only that is read. The lattice of the first map is that of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.fields.checks import as_length
from semmap.fields.maps.distances import core_tiles, distance_tiles
from semmap.fields.maps.grids import DTYPES, Grid, ValueType, empty_grid
from semmap.fields.maps.lattice import Lattice, VoxelBox
from semmap.fields.maps.representation_map import Evaluate, RepresentationMap
from semmap.language.schema import Property
from semmap_vdb import BoolGrid, Int32Grid

How = Literal["first", "last", "max", "min", "sum"]
"""Which value a voxel gets where several maps have one."""


def union(*maps: RepresentationMap, as_: Property | None = None) -> RepresentationMap:
    """Return the voxels of all maps; where several have a voxel, it has the value of the first."""
    return combine(*maps, how="first", as_=as_)


def combine(
    *maps: RepresentationMap, how: How = "last", as_: Property | None = None
) -> RepresentationMap:
    """Return the voxels of all maps.

    `how` is which value counts where several maps have a voxel: "first" or "last" for maps with
    legends. `as_` is the property of the result, required where those of the maps differ. Raises
    TypeError: the types or properties differ, or `how` does not fit to legends.
    """
    first = _some(maps)
    property = _result(maps, as_)
    for other in maps[1:]:
        if other.value_type != first.value_type:
            raise TypeError(
                f"{_name(first)} has {first.value_type} values and {_name(other)} "
                f"{other.value_type}: bring them to one type by threshold or map_values"
            )
    legend, others = _one_legend(maps)
    if legend and how not in ("first", "last"):
        raise TypeError(f"entities have no {how}: combine by first or last")
    others = [other.resampled(first.lattice) for other in others]

    def evaluate(box: VoxelBox | None) -> Grid:
        grids: list[Any] = [each.read(box) for each in others]
        joined: Grid = reduce(lambda a, b: a.joined(b, how), grids)
        return joined

    return _of_all(maps, property, evaluate, legend)


def intersection(*maps: RepresentationMap, as_: Property | None = None) -> RepresentationMap:
    """Return the voxels that all maps have, with the values of the first, as `combine`."""
    first = _some(maps)
    property = _result(maps, as_)
    return _of_all(maps, property, reduce(mask, maps).read, first.legend)


def mask(map: RepresentationMap, by: RepresentationMap) -> RepresentationMap:
    """Return the voxels of a map, with values and property, that another map has, too."""
    return _masked(map, by, inside=True)


def difference(map: RepresentationMap, without: RepresentationMap) -> RepresentationMap:
    """Return the voxels of a map, with values and property, that another map does not have."""
    return _masked(map, without, inside=False)


def threshold(
    map: RepresentationMap,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    as_: Property | None = None,
) -> RepresentationMap:
    """Return a bool map of the voxels whose value is between `low` and `high`, both included.

    `as_` is the property of the result, required where the objects of the property are numbers;
    without it, a map of degrees becomes a map of its property. Raises TypeError: the map has a
    legend, or `as_` is required.
    """
    property = as_ or map.property
    if map.legend:
        raise TypeError(f"{_name(map)} has entities for values: select them in a query")

    def evaluate(box: VoxelBox | None) -> Grid:
        grid: Any = map.read(box)
        if map.value_type == "float32":
            return grid.between(low, high)  # type: ignore[no-any-return]
        least, most = (0, 1) if map.value_type == "bool" else (-(2**31), 2**31 - 1)
        if not low <= high or low > most or high < least:
            return empty_grid("bool", map.lattice)
        return grid.between(math.ceil(max(low, least)), math.floor(min(high, most)))  # type: ignore[no-any-return]

    return map.like(evaluate, property=property, value_type="bool")


def map_values(
    map: RepresentationMap,
    function: Callable[[NDArray[Any]], ArrayLike],
    *,
    value_type: ValueType | None = None,
    as_: Property | None = None,
) -> RepresentationMap:
    """Return a map with the values that `function` makes of an array of them.

    Without `value_type` and `as_`, type and property are those of the map.
    """
    to: ValueType = value_type or map.value_type

    def evaluate(box: VoxelBox | None) -> Grid:
        voxels, values = map.read(box).read()
        changed: NDArray[Any] = np.ascontiguousarray(function(values), dtype=DTYPES[to])
        if changed.shape != values.shape:
            raise ValueError(f"the function made {changed.shape} of {values.shape} values")
        grid: Any = empty_grid(to, map.lattice)
        grid.set(voxels, changed)
        grid.prune()
        return grid  # type: ignore[no-any-return]

    legend = map.legend if to == "int32" else None
    return map.like(evaluate, property=as_ or map.property, value_type=to, legend=legend)


def dilate(map: RepresentationMap, metres: float) -> RepresentationMap:
    """Return the map grown by `metres`, between centres; new voxels get the nearest value."""
    return map.like(_spread(map, as_length(metres, "metres"), _nearest_values(map)))


def erode(map: RepresentationMap, metres: float) -> RepresentationMap:
    """Return the voxels of a map that have only voxels of the map within `metres`."""
    reach = as_length(metres, "metres") / map.voxel_size
    halo = math.ceil(reach)

    def evaluate(box: VoxelBox | None) -> Grid:
        grid: Any = map.read(None if box is None else box.grown(halo))
        rim: Any = BoolGrid(map.voxel_size, False)
        rim.place(map.lattice.rows)
        for low, kept in core_tiles(grid.active(), reach, box=box):
            rim.set(*_of_dense(low, kept, kept))
        rim.prune()
        return grid.masked(rim)  # type: ignore[no-any-return]

    return map.like(evaluate)


DISTANCE = Property(
    "urn:semmap:ontology#distance", "distance", None, None, subject="voxel", object="number"
)


def distance(
    map: RepresentationMap, farthest: float, *, as_: Property | None = None
) -> RepresentationMap:
    """Return a float32 map of the distance in metres to the nearest voxel of a map.

    Voxels up to `farthest` metres have a value. `as_` is the property, `distance` if not given.
    """
    evaluate = _spread(map, as_length(farthest, "farthest"), None)
    property = as_ or replace(DISTANCE, domain=map.property.domain)
    about = map.about if property.object == "entity" else None
    return map.like(evaluate, property=property, value_type="float32", about=about, legend=None)


def transform(map: RepresentationMap, pose: ArrayLike) -> RepresentationMap:
    """Return the map with its frame at another pose: (4, 4), rigid, in the shared frame."""
    return map.placed(pose)


def _spread(
    map: RepresentationMap, metres: float, values: Callable[[Any, Any], Any] | None
) -> Evaluate:
    """Return what computes the voxels within reach of a map; a value is the distance by default."""
    reach = metres / map.voxel_size
    halo = math.ceil(reach)

    def evaluate(box: VoxelBox | None) -> Grid:
        source: Any = map.read(None if box is None else box.grown(halo))
        kind = "float32" if values is None else map.value_type
        made: Any = empty_grid(kind, map.lattice)
        tiles = distance_tiles(source.active(), reach, box=box, with_nearest=values is not None)
        for tile in tiles:
            if values is None:
                given = (tile.distance * map.voxel_size).astype(np.float32)
            else:
                given = values(source, tile.nearest)
            made.set(*_of_dense(tile.low, tile.within, given))
        made.prune()
        return made  # type: ignore[no-any-return]

    return evaluate


def _nearest_values(map: RepresentationMap) -> Callable[[Any, Any], Any]:
    def values(source: Any, where: Any) -> Any:
        if map.value_type == "bool":
            return np.ones(where.shape[1:], np.bool_)
        centres = (where.reshape(3, -1).T + 0.5) * map.voxel_size
        return source.placed(Lattice(map.voxel_size).rows).at(centres).reshape(where.shape[1:])

    return values


def _of_dense(
    low: NDArray[np.int_], chosen: NDArray[np.bool_], values: NDArray[Any]
) -> tuple[NDArray[np.int32], NDArray[Any]]:
    """Return the chosen voxels of a dense box, whose lowest voxel is `low`, and their values."""
    voxels = np.argwhere(chosen).astype(np.int32) + low.astype(np.int32)
    return np.ascontiguousarray(voxels), np.ascontiguousarray(values[chosen])


def _masked(map: RepresentationMap, by: RepresentationMap, *, inside: bool) -> RepresentationMap:
    by = by.resampled(map.lattice)

    def evaluate(box: VoxelBox | None) -> Grid:
        if box is None and inside:
            # The box of the smaller map bounds where the larger one must be computed.
            other: Any = by.grid
            ends = other.bounds()
            if ends is None:
                return empty_grid(map.value_type, map.lattice)
            grid: Any = map.within(VoxelBox(tuple(ends[0]), tuple(ends[1])))
        else:
            grid, other = map.read(box), by.read(box)
        return grid.masked(other.active(), inside)  # type: ignore[no-any-return]

    return map.like(evaluate)


def _some(maps: tuple[RepresentationMap, ...]) -> RepresentationMap:
    if not maps:
        raise TypeError("give at least one map")
    return maps[0]


def _result(maps: tuple[RepresentationMap, ...], as_: Property | None) -> Property:
    """Return the property of a combination of maps."""
    if as_ is not None:
        return as_
    for other in maps[1:]:
        if other.property != maps[0].property:
            raise TypeError(
                f"{_name(maps[0])} (class {maps[0].rdf_class}) and {_name(other)} "
                f"(class {other.rdf_class}) have different properties: give that of the result "
                "with as_=, or keep the property of the first by mask or difference"
            )
    return maps[0].property


def _name(map: RepresentationMap) -> str:
    return f"the map {map.property.name}" + (f" of {map.about}" if map.about else "")


def _of_all(
    maps: tuple[RepresentationMap, ...],
    property: Property,
    evaluate: Evaluate,
    legend: Mapping[int, str],
) -> RepresentationMap:
    """Return a map like the first, about what all are about, of the time of the latest."""
    about = maps[0].about if len({each.about for each in maps}) == 1 else None
    time = max((each.time for each in maps if each.time is not None), default=None)
    return maps[0].like(evaluate, property=property, about=about, legend=legend, time=time)


def _one_legend(
    maps: tuple[RepresentationMap, ...],
) -> tuple[dict[int, str], list[RepresentationMap]]:
    """Return one legend for several maps, and the maps with its values."""
    legend = dict(maps[0].legend)
    number = {name: value for value, name in legend.items()}
    same = [maps[0]]
    for other in maps[1:]:
        pairs = []
        for value, name in other.legend.items():
            if name not in number:
                free = value if value not in legend else max(legend) + 1
                legend[free] = name
                number[name] = free
            if number[name] != value:
                pairs.append((value, number[name]))
        same.append(other if not pairs else _renumbered(other, pairs, legend))
    return legend, same


def _renumbered(
    map: RepresentationMap, pairs: list[tuple[int, int]], legend: dict[int, str]
) -> RepresentationMap:
    def evaluate(box: VoxelBox | None) -> Grid:
        grid = map.read(box)
        assert isinstance(grid, Int32Grid)
        return grid.renumbered(pairs)

    return map.like(evaluate, legend=legend)
