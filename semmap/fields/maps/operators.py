"""Operators: maps made of maps (reMap, section 3.1.3).

What they mean is checked at once, by the properties of the maps; voxels are worked out when they
are asked for, and of a chain over a bounded box those of that box alone. Maps of different lattices
or frames combine in the lattice of the first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.fields.maps.distances import deep, near
from semmap.language.property import Property
from semmap.fields.maps.representation_map import (
    DTYPES,
    Grid,
    RepresentationMap,
    ValueType,
    VoxelBox,
    empty,
)
from semmap_vdb import BoolGrid, Int32Grid

__all__ = [
    "combine",
    "difference",
    "dilate",
    "distance",
    "erode",
    "intersection",
    "map_values",
    "mask",
    "threshold",
    "transform",
    "union",
]

How = Literal["first", "last", "max", "min", "sum"]


def union(*maps: RepresentationMap, as_: Property | None = None) -> RepresentationMap:
    """What any of the maps has; where several do, the value of the first."""
    return combine(*maps, how="first", as_=as_)


def combine(
    *maps: RepresentationMap, how: How = "last", as_: Property | None = None
) -> RepresentationMap:
    """What any of the maps has, with the largest, smallest, last or first value or their sum.

    Parameters
    ----------
    as_ : the property of what results; it has to be said where that of the maps differs

    Raises
    ------
    TypeError
        Values of different types, other properties and no word of what results, or values whose
        order or sum means nothing: those of a legend.
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
        raise TypeError(f"the {how} of things means nothing: combine by first or last")
    others = [other.resampled(first.lattice) for other in others]

    def evaluate(box: VoxelBox | None) -> Grid:
        grids: list[Any] = [_grid(each, box) for each in others]
        joined: Grid = reduce(lambda a, b: a.joined(b, how), grids)
        return joined

    return RepresentationMap.lazily(
        property, first.value_type, first.lattice, evaluate,
        about=_common_about(maps), legend=legend, time=_latest(maps),
    )  # fmt: skip


def intersection(*maps: RepresentationMap, as_: Property | None = None) -> RepresentationMap:
    """What all of the maps have, with the values of the first."""
    first = _some(maps)
    property = _result(maps, as_)
    masked = reduce(lambda a, b: mask(a, b), maps)
    return RepresentationMap.lazily(
        property, first.value_type, first.lattice, lambda box: _grid(masked, box),
        about=_common_about(maps), legend=first.legend, time=_latest(maps),
    )  # fmt: skip


def mask(map: RepresentationMap, by: RepresentationMap) -> RepresentationMap:
    """What of the map lies where the other, of any class, has a value; of the map's class.

    "Those voxels of the object map that are in the field of view" (reMap, section 3.1.3).
    """
    return _masked(map, by, inside=True)


def difference(map: RepresentationMap, without: RepresentationMap) -> RepresentationMap:
    """What of the map lies where the other, of any class, has no value; of the map's class."""
    return _masked(map, without, inside=False)


def threshold(
    map: RepresentationMap,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    as_: Property | None = None,
) -> RepresentationMap:
    """Where the value is between `low` and `high`, both included: a bool map.

    A map that says how much of something is about someone says then that it is so. One whose
    objects are numbers has to be told what results.
    """
    property = as_ or map.property
    if map.legend:
        raise TypeError(f"{_name(map)} has things for values: choose some by `named`")

    def evaluate(box: VoxelBox | None) -> Grid:
        grid: Any = _grid(map, box)
        if map.value_type == "float32":
            return grid.between(low, high)  # type: ignore[no-any-return]
        least, most = (0, 1) if map.value_type == "bool" else (-(2**31), 2**31 - 1)
        if not low <= high or low > most or high < least:
            return empty("bool", map.lattice)
        return grid.between(math.ceil(max(low, least)), math.floor(min(high, most)))  # type: ignore[no-any-return]

    return RepresentationMap.lazily(
        property, "bool", map.lattice, evaluate, about=map.about, time=map.time
    )


def map_values(
    map: RepresentationMap,
    function: Callable[[NDArray[Any]], ArrayLike],
    *,
    value_type: ValueType | None = None,
    as_: Property | None = None,
) -> RepresentationMap:
    """Each value changed by a function of arrays of them."""
    to: ValueType = value_type or map.value_type

    def evaluate(box: VoxelBox | None) -> Grid:
        voxels, values = _grid(map, box).read()
        changed: NDArray[Any] = np.ascontiguousarray(function(values), dtype=DTYPES[to])
        if changed.shape != values.shape:
            raise ValueError(f"the function made {changed.shape} of {values.shape} values")
        grid: Any = empty(to, map.lattice)
        grid.set(voxels, changed)
        grid.prune()
        return grid  # type: ignore[no-any-return]

    return RepresentationMap.lazily(
        as_ or map.property, to, map.lattice, evaluate,
        about=map.about, legend=map.legend if to == "int32" else None, time=map.time,
    )  # fmt: skip


def dilate(map: RepresentationMap, metres: float) -> RepresentationMap:
    """The map and what is within `metres` of it, between centres, with the nearest value."""
    return map.like(_spread(map, _length(metres, "metres"), _nearest_values(map)))


def erode(map: RepresentationMap, metres: float) -> RepresentationMap:
    """What of the map has nothing else within `metres`, between centres."""
    reach = _length(metres, "metres") / map.voxel_size
    halo = math.ceil(reach)

    def evaluate(box: VoxelBox | None) -> Grid:
        grid: Any = _grid(map, None if box is None else box.grown(halo))
        rim: Any = BoolGrid(map.voxel_size, False)
        rim.place(map.lattice.rows)
        for low, kept in deep(grid.active(), reach, box=box):
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
    """Metres from each voxel's centre to the nearest centre that the map has: a float32 map.

    Parameters
    ----------
    farthest : metres beyond which there is no value
    as_ : the property of what results; `distance`, about nothing, if not given
    """
    evaluate = _spread(map, _length(farthest, "farthest"), None)
    property = as_ or replace(DISTANCE, domain=map.property.domain)
    about = map.about if property.object == "thing" else None
    return RepresentationMap.lazily(
        property, "float32", map.lattice, evaluate, about=about, time=map.time
    )


def transform(map: RepresentationMap, pose: ArrayLike) -> RepresentationMap:
    """The map with its frame at a (4, 4) pose in the shared one; `resampled` makes it a lattice."""
    return map.placed(pose)


def _spread(
    map: RepresentationMap, metres: float, values: Callable[[Any, Any], Any] | None
) -> Callable[[VoxelBox | None], Grid]:
    """The voxels within reach of a map, with a value for each: the distance if none is said."""
    reach = metres / map.voxel_size
    halo = math.ceil(reach)

    def evaluate(box: VoxelBox | None) -> Grid:
        source: Any = _grid(map, None if box is None else box.grown(halo))
        kind = "float32" if values is None else map.value_type
        made: Any = empty(kind, map.lattice)
        for low, far, where, within in near(
            source.active(), reach, box=box, places=values is not None
        ):
            if values is None:
                given = (far * map.voxel_size).astype(np.float32)
            else:
                given = values(source, where)
            made.set(*_of_dense(low, within, given))
        made.prune()
        return made  # type: ignore[no-any-return]

    return evaluate


def _nearest_values(map: RepresentationMap) -> Callable[[Any, Any], Any]:
    def values(source: Any, where: Any) -> Any:
        if map.value_type == "bool":
            return np.ones(where.shape[1:], np.bool_)
        centres = (where.reshape(3, -1).T + 0.5) * map.voxel_size
        rows = [list(row) for row in ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0))]
        return source.placed(rows).at(centres).reshape(where.shape[1:])

    return values


def _of_dense(
    low: NDArray[np.int_], chosen: NDArray[np.bool_], values: NDArray[Any]
) -> tuple[NDArray[np.int32], NDArray[Any]]:
    """Voxels and values of what is chosen of a dense box whose lowest voxel is `low`."""
    voxels = np.argwhere(chosen).astype(np.int32) + low.astype(np.int32)
    return np.ascontiguousarray(voxels), np.ascontiguousarray(values[chosen])


def _masked(map: RepresentationMap, by: RepresentationMap, *, inside: bool) -> RepresentationMap:
    by = by.resampled(map.lattice)

    def evaluate(box: VoxelBox | None) -> Grid:
        if box is None and inside:
            # The smaller map bounds what the larger has to be worked out for.
            other: Any = by.grid
            ends = other.bounds()
            if ends is None:
                return empty(map.value_type, map.lattice)
            grid: Any = map.within(VoxelBox(tuple(ends[0]), tuple(ends[1])))
        else:
            grid, other = _grid(map, box), _grid(by, box)
        return grid.masked(other.active(), inside)  # type: ignore[no-any-return]

    return map.like(evaluate)


def _grid(map: RepresentationMap, box: VoxelBox | None) -> Grid:
    return map.grid if box is None else map.within(box)


def _some(maps: tuple[RepresentationMap, ...]) -> RepresentationMap:
    if not maps:
        raise TypeError("give at least one map")
    return maps[0]


def _result(maps: tuple[RepresentationMap, ...], as_: Property | None) -> Property:
    """The property of what combines maps, or why they don't combine."""
    if as_ is not None:
        return as_
    for other in maps[1:]:
        if other.property != maps[0].property:
            raise TypeError(
                f"{_name(maps[0])} (class {maps[0].rdf_class}) and {_name(other)} "
                f"(class {other.rdf_class}) say different things: say what results with as_=, or "
                "keep the class of the first by mask or difference"
            )
    return maps[0].property


def _name(map: RepresentationMap) -> str:
    return f"the map {map.property.name}" + (f" of {map.about}" if map.about else "")


def _common_about(maps: tuple[RepresentationMap, ...]) -> str | None:
    abouts = {each.about for each in maps}
    return maps[0].about if len(abouts) == 1 else None


def _latest(maps: tuple[RepresentationMap, ...]) -> Any:
    return max((each.time for each in maps if each.time is not None), default=None)


def _one_legend(
    maps: tuple[RepresentationMap, ...],
) -> tuple[dict[int, str], list[RepresentationMap]]:
    """Maps whose values mean the same, by one legend."""
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
        grid = _grid(map, box)
        assert isinstance(grid, Int32Grid)
        return grid.renumbered(pairs)

    return RepresentationMap.lazily(
        map.property, "int32", map.lattice, evaluate, legend=legend, time=map.time
    )


def _length(value: float, name: str) -> float:
    if not (math.isfinite(value) and value >= 0):
        raise ValueError(f"{name} is {value!r}: give metres of at least 0")
    return float(value)
