"""The results of queries and updates."""

from __future__ import annotations

import builtins
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps.grids import ValueType, empty_grid
from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.queries.columns import Entities, Numbers, Statements, VoxelColumn
from semmap.fields.queries.table import TermColumn
from semmap.fields.queries.voxel_functions import centres
from semmap.geometry.voxel_keys import voxels_of_keys
from semmap.language.schema import Property, with_article

_BLOCK = 4096
"""Rows that become tuples at once."""


@dataclass(frozen=True, eq=False)
class SelectResult:
    """The solutions of SELECT, in order.

    Iteration gives tuples: a voxel is the (x, y, z) of its centre in metres, an entity or type its
    name, a number or text itself, and an unbound variable None. `columns` are coded: `strings` has
    the name or text of each code.
    """

    names: tuple[str, ...]
    columns: tuple[TermColumn, ...]
    count: int
    strings: tuple[str, ...]
    voxel_size: float

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        """Yield a tuple for each solution, block by block: the first of a million cost little."""
        if not self.columns:
            yield from ((),) * self.count
        for start in range(0, self.count, _BLOCK):
            block = slice(start, start + _BLOCK)
            yield from zip(*(self._plain(c.take(block)) for c in self.columns), strict=True)

    def column(self, name: str) -> TermColumn:
        """Return the column of a variable; KeyError if the query does not project it."""
        if name not in self.names:
            raise KeyError(f"?{name} is not one of {', '.join(f'?{n}' for n in self.names)}")
        return self.columns[self.names.index(name)]

    def voxels(self, name: str) -> NDArray[np.int32]:
        """Return the voxels (N, 3) of a variable for the N solutions that bind it.

        Raises as `column`, and TypeError: the variable is not a voxel.
        """
        column = self.column(name)
        if column.kind != "voxel":
            raise TypeError(f"?{name} is {with_article(column.kind)}, not a voxel")
        return voxels_of_keys(column.values[column.is_bound])

    def as_json(self) -> dict[str, Any]:
        """Return names and rows for `json.dumps`: {"variables": [...], "rows": [[...], ...]}."""
        return {"variables": list(self.names), "rows": [list(row) for row in self]}

    def _plain(self, column: TermColumn) -> list[Any]:
        values: list[Any]
        if column.kind == "voxel":
            points = centres(column.values, self.voxel_size)
            values = [tuple(point) for point in points.tolist()]
        elif column.kind in ("entity", "text"):
            codes = column.values.tolist()
            values = [self.strings[code] if self.strings else "" for code in codes]
        else:
            values = column.values.tolist()
        if column.bound is None:
            return values
        return [v if b else None for v, b in zip(values, column.bound.tolist(), strict=True)]


@dataclass(frozen=True, eq=False)
class StoreResult:
    """The statements of STORE, from which `to_map` makes a new map.

    They are a voxel and its entity or number in each row, in ascending order, each row once.
    `about` is the entity, where it is the same in all rows.
    """

    property: Property
    statements: Statements
    about: str | None
    voxel_size: float

    def __len__(self) -> int:
        return len(self.statements.subject)

    @builtins.property
    def voxels(self) -> NDArray[np.int32]:
        """(N, 3) the voxel of each statement."""
        assert isinstance(self.statements.subject, VoxelColumn)
        return voxels_of_keys(self.statements.subject.keys)

    def to_map(self, time: datetime | None = None) -> RepresentationMap:
        """Return the statements as a map; of a voxel's entities, the last by name counts."""
        voxels, objects = self.voxels, self.statements.object
        kind: ValueType = "bool"
        values: NDArray[Any] = np.ones(len(voxels), np.bool_)
        legend = None
        if isinstance(objects, Numbers):
            kind, values = "float32", objects.values.astype(np.float32)
        elif isinstance(objects, Entities) and self.about is None and len(voxels):
            rank = np.argsort(np.argsort(np.array(objects.names)))
            order = np.argsort(rank[objects.codes], kind="stable")
            kind, values = "int32", objects.codes[order] + 1
            voxels = np.ascontiguousarray(voxels[order])
            legend = {code + 1: name for code, name in enumerate(objects.names)}
        grid: Any = empty_grid(kind, Lattice(self.voxel_size))
        grid.set(voxels, values)
        return RepresentationMap(self.property, grid, about=self.about, legend=legend, time=time)


@dataclass(frozen=True)
class UpdateResult:
    """The entities whose voxels an update wrote, and the new names of blank nodes by label.

    Blank nodes without a label are [1], [2], ...
    """

    new: Mapping[str, str]
    changed: frozenset[str]
