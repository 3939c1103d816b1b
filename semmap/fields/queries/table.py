"""Tables of solutions: a column a variable, a row a solution, in SPARQL's multiset semantics.

Source: SPARQL 1.1 Query Language, section 18.5.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.limits import QUERY_ROWS

__all__ = [
    "Column",
    "ColumnKind",
    "LimitError",
    "Names",
    "Pairs",
    "Table",
    "ascending",
    "codes_of",
    "join",
    "merge",
    "minus",
    "pairs",
    "union",
]

ColumnKind = Literal["voxel", "thing", "number", "boolean", "text"]
"""What a variable stands for; no variable stands for two."""

MERGED = 8
"""Two ascending columns are merged unless one is so many times as long: then it is searched."""

Rows = NDArray[np.intp]


class LimitError(Exception):
    """A query that makes too many rows or takes too long; how to fix it."""


class Names:
    """Numbers for names, the same for all columns of a query."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._code: dict[str, int] = {}
        self._known: dict[tuple[str, ...], NDArray[np.int64]] = {}

    def code(self, name: str) -> int:
        """The number of a name."""
        code = self._code.setdefault(name, len(self.names))
        if code == len(self.names):
            self.names.append(name)
        return code

    def codes(self, names: Iterable[str]) -> NDArray[np.int64]:
        """(N,) the numbers of N names."""
        each = tuple(names)
        if each not in self._known:
            self._known[each] = np.array([self.code(name) for name in each], np.int64)
        return self._known[each]

    def ranks(self) -> NDArray[np.int64]:
        """(N,) the place of each name in alphabetical order."""
        ranks = np.empty(len(self.names), np.int64)
        ranks[np.array(sorted(range(len(ranks)), key=self.names.__getitem__), np.intp)] = np.arange(
            len(ranks)
        )
        return ranks


@dataclass(frozen=True, eq=False)
class Column:
    """(N,) what a variable stands for in N solutions.

    Attributes
    ----------
    kind : what `values` are: keys of voxels, numbers of names (things and text), numbers, truth
    values : int64, int64, int64 or float64, bool
    bound : where there is a value; None is everywhere
    """

    kind: ColumnKind
    values: NDArray[Any]
    bound: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.values)

    def take(self, rows: Rows | NDArray[np.bool_]) -> Column:
        """The given rows."""
        bound = None if self.bound is None else self.bound[rows]
        return Column(self.kind, self.values[rows], None if bound is None or bound.all() else bound)

    @property
    def there(self) -> NDArray[np.bool_]:
        """(N,) where there is a value."""
        return np.ones(len(self), np.bool_) if self.bound is None else self.bound


_DTYPES = {
    "voxel": np.int64, "thing": np.int64, "text": np.int64, "number": np.float64,
    "boolean": np.bool_,
}  # fmt: skip


def unbound(kind: ColumnKind, rows: int) -> Column:
    """A column without values."""
    return Column(kind, np.zeros(rows, _DTYPES[kind]), np.zeros(rows, np.bool_) if rows else None)


@dataclass(frozen=True, eq=False)
class Table:
    """Solutions. A variable without a column is unbound in all of them."""

    rows: int
    columns: Mapping[str, Column]

    def take(self, rows: Rows | NDArray[np.bool_]) -> Table:
        """The given rows."""
        count = np.count_nonzero(rows) if rows.dtype == np.bool_ else len(rows)
        return Table(int(count), {name: c.take(rows) for name, c in self.columns.items()})

    def only(self, names: Collection[str]) -> Table:
        """The given columns."""
        return Table(self.rows, {n: self.columns[n] for n in names if n in self.columns})

    def keys(self, name: str) -> NDArray[np.int64] | None:
        """The voxels that a variable stands for, ascending; None where it may be unbound."""
        column = self.columns.get(name)
        if column is None or column.kind != "voxel" or column.bound is not None:
            return None
        return column.values if ascending(column.values) else np.unique(column.values)

    def distinct(self) -> Table:
        """Each row once, the first of those that are equal."""
        if not self.columns:
            return Table(min(self.rows, 1), {})
        codes = codes_of(self, list(self.columns))
        if ascending(codes):
            return self
        return self.take(np.sort(np.unique(codes, return_index=True)[1]))


UNIT = Table(1, {})
"""One solution that binds nothing."""

NOTHING = Table(0, {})
"""No solution."""


def ascending(keys: NDArray[Any]) -> bool:
    """True where each is greater than the one before."""
    return bool((keys[1:] > keys[:-1]).all())


def _dense(values: NDArray[Any]) -> tuple[NDArray[np.int64], int]:
    """Numbers from 0 for what is equal, and how many."""
    found, codes = np.unique(values, return_inverse=True)
    return codes.astype(np.int64, copy=False), len(found)


def _combined(columns: Iterable[NDArray[Any]]) -> NDArray[np.int64]:
    """A number for each row of several columns, the same where all of them are equal."""
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
    """(N,) a number for each row, the same where all the columns have the same or nothing."""
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


class Pairs(NamedTuple):
    """Rows of two tables that go together."""

    left: Rows
    right: Rows


def _keys(a: Table, b: Table, names: Sequence[str], rows: Pairs | None) -> tuple[Any, Any]:
    """Numbers for the rows of both, equal where the given columns are."""
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


def _equal(a: NDArray[Any], b: NDArray[Any], most: int | None = None) -> Pairs:
    """Rows with the same key, in the order of the left ones."""
    if len(a) == 0 or len(b) == 0:
        return Pairs(np.zeros(0, np.intp), np.zeros(0, np.intp))
    if len(b) < MERGED * len(a) and len(a) < MERGED * len(b) and ascending(a) and ascending(b):
        return _intersection(a, b)
    if ascending(b):
        place = np.searchsorted(b, a)
        place[place == len(b)] = 0
        left = np.flatnonzero(b[place] == a)
        return Pairs(left, place[left])
    order = np.argsort(b, kind="stable")
    in_order = b[order]
    first = np.searchsorted(in_order, a, "left")
    counts = np.searchsorted(in_order, a, "right") - first
    total = int(counts.sum())
    _limit(total)
    left = np.repeat(np.arange(len(a)), counts)
    along = np.arange(total) - np.repeat(np.cumsum(counts) - counts, counts)
    return Pairs(left, order[np.repeat(first, counts) + along])


def _intersection(a: NDArray[Any], b: NDArray[Any]) -> Pairs:
    """Rows with the same key of two ascending columns: a stable sort only merges the two."""
    both = np.concatenate([a, b])
    order = np.argsort(both, kind="stable")
    in_order = both[order]
    same = np.flatnonzero(in_order[1:] == in_order[:-1])
    return Pairs(order[same], order[same + 1] - len(a))


def _limit(rows: int) -> None:
    if QUERY_ROWS.exceeded_by(rows):
        raise LimitError(
            f"this would have {rows:,} solutions: connect its patterns by variables, or add a "
            f"narrower one; {QUERY_ROWS.variable} raises the limit of {QUERY_ROWS.value:,}"
        )


def _parts(a: Table, b: Table) -> Iterator[tuple[Pairs | None, list[str]]]:
    """Rows of both by which of the variables that both may bind are bound in both of them."""
    shared = [name for name in a.columns if name in b.columns]
    open_ = [n for n in shared if a.columns[n].bound is not None or b.columns[n].bound is not None]
    if not open_:
        yield None, shared
        return
    masks = [
        sum((t.columns[n].there.astype(np.int64) << i for i, n in enumerate(open_)),
            np.zeros(t.rows, np.int64))
        for t in (a, b)
    ]  # fmt: skip
    for mine in np.unique(masks[0]).tolist():
        for theirs in np.unique(masks[1]).tolist():
            rows = Pairs(np.flatnonzero(masks[0] == mine), np.flatnonzero(masks[1] == theirs))
            both = [n for i, n in enumerate(open_) if (mine & theirs) >> i & 1]
            yield rows, [n for n in shared if n not in open_] + both


def pairs(a: Table, b: Table) -> Pairs:
    """Rows that are compatible: equal in all that both bind."""
    found = []
    for rows, names in _parts(a, b):
        n, m = (a.rows, b.rows) if rows is None else (len(rows.left), len(rows.right))
        if names:
            each = _equal(*_keys(a, b, names, rows))
        else:
            _limit(n * m)
            each = Pairs(np.repeat(np.arange(n), m), np.tile(np.arange(m), n))
        found.append(each if rows is None else Pairs(rows.left[each.left], rows.right[each.right]))
    if len(found) == 1:
        return found[0]
    left, right = (np.concatenate(side) for side in zip(*found, strict=True))
    order = np.argsort(left, kind="stable")
    return Pairs(left[order], right[order])


def merge(a: Table, b: Table, rows: Pairs) -> Table:
    """A solution for each pair of rows."""
    columns = {name: column.take(rows.left) for name, column in a.columns.items()}
    for name, column in b.columns.items():
        if name not in columns:
            columns[name] = column.take(rows.right)
        elif columns[name].bound is not None:
            mine, theirs = columns[name], column.take(rows.right)
            bound = mine.there | theirs.there
            columns[name] = Column(
                mine.kind,
                np.where(mine.there, mine.values, theirs.values),
                None if bound.all() else bound,
            )
    return Table(len(rows.left), columns)


def join(a: Table, b: Table) -> Table:
    """All compatible pairs of solutions."""
    if a.rows == 1 and not a.columns:
        return b
    if b.rows == 1 and not b.columns:
        return a
    if a.rows == 0 or b.rows == 0:
        return NOTHING
    return merge(a, b, pairs(a, b))


def union(tables: Sequence[Table]) -> Table:
    """The solutions of all."""
    tables = [table for table in tables if table.rows]
    if len(tables) <= 1:
        return tables[0] if tables else NOTHING
    columns = {}
    for name in dict.fromkeys(name for table in tables for name in table.columns):
        kind = next(t.columns[name].kind for t in tables if name in t.columns)
        each = [t.columns.get(name) or unbound(kind, t.rows) for t in tables]
        bound = np.concatenate([column.there for column in each])
        columns[name] = Column(
            kind, np.concatenate([c.values for c in each]), None if bound.all() else bound
        )
    return Table(sum(table.rows for table in tables), columns)


def minus(a: Table, b: Table) -> Table:
    """The solutions that no solution of `b` with a variable in common is compatible with."""
    if a.rows == 0 or b.rows == 0:
        return a
    kept = np.ones(a.rows, np.bool_)
    for rows, names in _parts(a, b):
        if names:
            mine, theirs = _keys(a, b, names, rows)
            gone = _among(mine, theirs)
            kept[np.flatnonzero(gone) if rows is None else rows.left[gone]] = False
    return a if kept.all() else a.take(kept)


def _among(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    if len(b) == 0:
        return np.zeros(len(a), np.bool_)
    b = b if ascending(b) else np.unique(b)
    if len(b) < MERGED * len(a) and len(a) < MERGED * len(b) and ascending(a):
        found = np.zeros(len(a), np.bool_)
        found[_intersection(a, b).left] = True
        return found
    place = np.searchsorted(b, a)
    place[place == len(b)] = 0
    return np.asarray(b[place] == a)
