"""Tables of solutions, a column for each variable; their algebra is that of SPARQL 1.1, 18.5."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.error import Error
from semmap.geometry.voxel_keys import sorted_unique
from semmap.language.schema import ValueKind
from semmap.limits import QUERY_ROWS

MERGE_RATIO = 8
"""Two ascending columns are merged where the longer has up to so many times the rows of the other.

Otherwise the rows of one are searched in the other.
"""

Rows = NDArray[np.intp]


class LimitError(Error):
    """A query has too many solutions or takes too long."""


class NameCodes:
    """Dictionary encoding: a number for each name, the same in all columns of a query."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._code: dict[str, int] = {}
        self._known: dict[tuple[str, ...], NDArray[np.int64]] = {}

    def code(self, name: str) -> int:
        """Return the code of a name; a new name gets the next code."""
        code = self._code.setdefault(name, len(self.names))
        if code == len(self.names):
            self.names.append(name)
        return code

    def codes(self, names: Iterable[str]) -> NDArray[np.int64]:
        """Return the codes of names: (N,) int64."""
        each = tuple(names)
        if each not in self._known:
            self._known[each] = np.array([self.code(name) for name in each], np.int64)
        return self._known[each]

    def ranks(self) -> NDArray[np.int64]:
        """Return the rank of each name in alphabetical order: (N,) int64."""
        ranks = np.empty(len(self.names), np.int64)
        ranks[np.array(sorted(range(len(ranks)), key=self.names.__getitem__), np.intp)] = np.arange(
            len(ranks)
        )
        return ranks


@dataclass(frozen=True, eq=False)
class TermColumn:
    """The values of a variable in N solutions."""

    kind: ValueKind  # voxels are keys, entities and texts are codes of names
    # (N,) int64 for voxels, entities and texts, float64 or int64 for numbers, bool
    values: NDArray[Any]
    bound: NDArray[np.bool_] | None = None  # (N,) where there is a value; None for everywhere

    def __post_init__(self) -> None:
        if self.bound is not None and self.bound.all():
            object.__setattr__(self, "bound", None)

    def __len__(self) -> int:
        return len(self.values)

    def take(self, rows: Rows | NDArray[np.bool_] | slice) -> TermColumn:
        """Return a column of some rows, given by index, by a mask or by a slice."""
        bound = None if self.bound is None else self.bound[rows]
        return TermColumn(self.kind, self.values[rows], bound)

    @property
    def is_bound(self) -> NDArray[np.bool_]:
        """(N,) whether there is a value."""
        return np.ones(len(self), np.bool_) if self.bound is None else self.bound


_DTYPES = {
    "voxel": np.int64,
    "entity": np.int64,
    "text": np.int64,
    "number": np.float64,
    "boolean": np.bool_,
}


def unbound(kind: ValueKind, rows: int) -> TermColumn:
    """Return a column without values."""
    return TermColumn(kind, np.zeros(rows, _DTYPES[kind]), np.zeros(rows, np.bool_))


@dataclass(frozen=True, eq=False)
class Table:
    """Solutions; a variable without a column is unbound in all of them."""

    rows: int
    columns: Mapping[str, TermColumn]

    def take(self, rows: Rows | NDArray[np.bool_]) -> Table:
        """Return a table of some rows, given by index or by a mask."""
        count = np.count_nonzero(rows) if rows.dtype == np.bool_ else len(rows)
        return Table(int(count), {name: c.take(rows) for name, c in self.columns.items()})

    def only(self, names: Collection[str]) -> Table:
        """Return a table of some columns."""
        return Table(self.rows, {n: self.columns[n] for n in names if n in self.columns})

    def keys(self, name: str) -> NDArray[np.int64] | None:
        """Return the voxels of a variable as ascending keys; None where it may be unbound."""
        column = self.columns.get(name)
        if column is None or column.kind != "voxel" or column.bound is not None:
            return None
        return column.values if is_ascending(column.values) else sorted_unique(column.values)

    def distinct(self) -> Table:
        """Return each row once: the first of equal ones."""
        if not self.columns:
            return Table(min(self.rows, 1), {})
        codes = codes_of(self, list(self.columns))
        if is_ascending(codes):
            return self
        return self.take(np.sort(np.unique(codes, return_index=True)[1]))


UNIT = Table(1, {})
"""One solution without variables: the neutral element of joins."""

EMPTY = Table(0, {})
"""No solution."""


def is_ascending(keys: NDArray[Any]) -> bool:
    """Return whether each key is greater than the one before."""
    return bool((keys[1:] > keys[:-1]).all())


def _dense(values: NDArray[Any]) -> tuple[NDArray[np.int64], int]:
    """Return codes from 0, equal for equal values, and the number of codes."""
    found, codes = np.unique(values, return_inverse=True)
    return codes.astype(np.int64, copy=False), len(found)


def _combined(columns: Iterable[NDArray[Any]]) -> NDArray[np.int64]:
    """Return a code for each row of several columns, equal where all columns are equal."""
    combined: NDArray[np.int64] | None = None
    size = 1
    for values in columns:
        codes, count = _dense(values)
        if combined is None:
            combined, size = codes, count
            continue
        if size * max(count, 1) >= 1 << 62:
            combined, size = _dense(combined)
        combined, size = combined * count + codes, size * count
    assert combined is not None
    return combined


def codes_of(table: Table, names: Sequence[str]) -> NDArray[np.int64]:
    """Return a code for each row, equal where all the columns are equal or unbound: (N,)."""
    if len(names) == 1:
        column = table.columns[names[0]]
        if column.bound is None and column.values.dtype == np.int64:
            return column.values
    parts: list[NDArray[Any]] = []
    for name in names:
        column = table.columns[name]
        if column.bound is None:
            parts.append(column.values)
        else:
            parts += [column.bound, np.where(column.bound, column.values, 0)]
    return _combined(parts)


class RowPairs(NamedTuple):
    """Indices of rows of two tables that belong together."""

    left: Rows
    right: Rows


def _join_keys(a: Table, b: Table, names: Sequence[str], rows: RowPairs | None) -> tuple[Any, Any]:
    """Return codes for the rows of both tables, equal where the given columns are equal."""
    one, other = [], []
    for name in names:
        mine, theirs = a.columns[name].values, b.columns[name].values
        if rows is not None:
            mine, theirs = mine[rows.left], theirs[rows.right]
        one.append(mine)
        other.append(theirs)
    if len(names) == 1 and one[0].dtype == other[0].dtype:
        return one[0], other[0]
    both = _combined(np.concatenate(pair) for pair in zip(one, other, strict=True))
    return both[: len(one[0])], both[len(one[0]) :]


def _equal_pairs(a: NDArray[Any], b: NDArray[Any]) -> RowPairs:
    """Return rows with equal keys, in the order of the left ones."""
    if len(a) == 0 or len(b) == 0:
        return RowPairs(np.zeros(0, np.intp), np.zeros(0, np.intp))
    if _similar_lengths(a, b) and is_ascending(a) and is_ascending(b):
        return _intersection(a, b)
    if is_ascending(b):
        place = np.searchsorted(b, a)
        place[place == len(b)] = 0
        left = np.flatnonzero(b[place] == a)
        return RowPairs(left, place[left])
    order = np.argsort(b, kind="stable")
    in_order = b[order]
    first = np.searchsorted(in_order, a, "left")
    counts = np.searchsorted(in_order, a, "right") - first
    total = int(counts.sum())
    _check_rows(total)
    left = np.repeat(np.arange(len(a)), counts)
    along = np.arange(total) - np.repeat(np.cumsum(counts) - counts, counts)
    return RowPairs(left, order[np.repeat(first, counts) + along])


def _similar_lengths(a: NDArray[Any], b: NDArray[Any]) -> bool:
    return len(b) < MERGE_RATIO * len(a) and len(a) < MERGE_RATIO * len(b)


def _intersection(a: NDArray[Any], b: NDArray[Any]) -> RowPairs:
    """Return rows with equal keys of two ascending columns; a stable sort merges these."""
    both = np.concatenate([a, b])
    order = np.argsort(both, kind="stable")
    in_order = both[order]
    same = np.flatnonzero(in_order[1:] == in_order[:-1])
    return RowPairs(order[same], order[same + 1] - len(a))


def _check_rows(rows: int) -> None:
    if QUERY_ROWS.exceeded_by(rows):
        raise LimitError(
            f"this would have {rows:,} solutions: connect its patterns by variables, or add a "
            f"narrower one; {QUERY_ROWS.variable} raises the limit of {QUERY_ROWS.value:,}"
        )


def _parts(a: Table, b: Table) -> Iterator[tuple[RowPairs | None, list[str]]]:
    """Split the rows by which of the shared variables are bound in both tables.

    Yields the rows of either table (None for all), and the variables that both bind there.
    """
    shared = [name for name in a.columns if name in b.columns]
    partial = [
        name
        for name in shared
        if a.columns[name].bound is not None or b.columns[name].bound is not None
    ]
    if not partial:
        yield None, shared
        return
    masks = [_bound_masks(table, partial) for table in (a, b)]
    for mine in np.unique(masks[0]).tolist():
        for theirs in np.unique(masks[1]).tolist():
            rows = RowPairs(np.flatnonzero(masks[0] == mine), np.flatnonzero(masks[1] == theirs))
            both = [n for i, n in enumerate(partial) if (mine & theirs) >> i & 1]
            yield rows, [n for n in shared if n not in partial] + both


def _bound_masks(table: Table, names: Sequence[str]) -> NDArray[np.int64]:
    """Return for each row the variables that are bound, as bits."""
    masks = np.zeros(table.rows, np.int64)
    for i, name in enumerate(names):
        masks |= table.columns[name].is_bound.astype(np.int64) << i
    return masks


def compatible_pairs(a: Table, b: Table) -> RowPairs:
    """Return the rows that are compatible: equal in all variables that both bind."""
    found = []
    for rows, names in _parts(a, b):
        n, m = (a.rows, b.rows) if rows is None else (len(rows.left), len(rows.right))
        if names:
            each = _equal_pairs(*_join_keys(a, b, names, rows))
        else:
            _check_rows(n * m)
            each = RowPairs(np.repeat(np.arange(n), m), np.tile(np.arange(m), n))
        if rows is not None:
            each = RowPairs(rows.left[each.left], rows.right[each.right])
        found.append(each)
    if len(found) == 1:
        return found[0]
    left, right = (np.concatenate(side) for side in zip(*found, strict=True))
    order = np.argsort(left, kind="stable")
    return RowPairs(left[order], right[order])


def merge(a: Table, b: Table, rows: RowPairs) -> Table:
    """Return a solution for each pair of rows."""
    columns = {name: column.take(rows.left) for name, column in a.columns.items()}
    for name, column in b.columns.items():
        if name not in columns:
            columns[name] = column.take(rows.right)
        elif columns[name].bound is not None:
            mine, theirs = columns[name], column.take(rows.right)
            values = np.where(mine.is_bound, mine.values, theirs.values)
            columns[name] = TermColumn(mine.kind, values, mine.is_bound | theirs.is_bound)
    return Table(len(rows.left), columns)


def join(a: Table, b: Table) -> Table:
    """Return all compatible pairs of solutions."""
    if a.rows == 1 and not a.columns:
        return b
    if b.rows == 1 and not b.columns:
        return a
    if a.rows == 0 or b.rows == 0:
        return EMPTY
    return merge(a, b, compatible_pairs(a, b))


def union(tables: Sequence[Table]) -> Table:
    """Return the solutions of all tables."""
    tables = [table for table in tables if table.rows]
    if len(tables) <= 1:
        return tables[0] if tables else EMPTY
    columns = {}
    for name in dict.fromkeys(name for table in tables for name in table.columns):
        kind = next(t.columns[name].kind for t in tables if name in t.columns)
        each = [t.columns.get(name) or unbound(kind, t.rows) for t in tables]
        bound = np.concatenate([column.is_bound for column in each])
        columns[name] = TermColumn(kind, np.concatenate([c.values for c in each]), bound)
    return Table(sum(table.rows for table in tables), columns)


def minus(a: Table, b: Table) -> Table:
    """Return the solutions that are compatible with no solution of `b` with a common variable."""
    if a.rows == 0 or b.rows == 0:
        return a
    kept = np.ones(a.rows, np.bool_)
    for rows, names in _parts(a, b):
        if names:
            mine, theirs = _join_keys(a, b, names, rows)
            excluded = _among(mine, theirs)
            kept[np.flatnonzero(excluded) if rows is None else rows.left[excluded]] = False
    return a if kept.all() else a.take(kept)


def _among(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Return where a key of `a` occurs in `b`."""
    found = np.zeros(len(a), np.bool_)
    found[_equal_pairs(a, b if is_ascending(b) else sorted_unique(b)).left] = True
    return found
