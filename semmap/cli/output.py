"""What commands print: tables for people, JSON for programs."""

from __future__ import annotations

import json
import math
import sys
from decimal import Decimal
from functools import partial
from itertools import chain, count
from typing import TYPE_CHECKING, Any

from psycopg.types.range import Range

from semmap.cli.console import SafeConsole

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

__all__ = [
    "err",
    "out",
    "plain",
    "print_json",
    "readable",
    "show_rows",
    "show_table",
    "unique_names",
]

# Brackets and colons are parts of names: no markup, no emoji.
_console = partial(SafeConsole, markup=False, emoji=False, highlight=False, soft_wrap=True)
out = _console(width=None if sys.stdout.isatty() else 160)  # a file or pipe has no width to fit
err = _console(stderr=True)


def print_json(value: Any) -> None:
    """Print a value as JSON; what JSON has no form for, as PostgreSQL writes it."""
    print(json.dumps(plain(value), allow_nan=False))


def show_table(
    rows: Sequence[Mapping[str, Any]], as_json: bool, columns: Sequence[str] | None = None
) -> None:
    """Print rows of named values as a table, or as JSON objects.

    Parameters
    ----------
    columns : the names in their order; by default those of the first row
    """
    names = list(columns or (rows[0] if rows else ()))
    show_rows(names, [tuple(row[name] for name in names) for row in rows], as_json)


def show_rows(columns: list[str], rows: Iterable[tuple[Any, ...]], as_json: bool) -> None:
    """Print rows as a table, or as JSON objects; a repeated column becomes label, label_2."""
    names = unique_names(columns)
    rows = list(rows)
    if as_json:
        print_json([dict(zip(names, row, strict=True)) for row in rows])
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in names:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*("" if v is None else readable(v) for v in row))
    out.print(table)
    err.print(f"{len(rows)} row{'' if len(rows) == 1 else 's'}", style="dim")


def unique_names(columns: list[str]) -> list[str]:
    """Column names, a repeated one numbered: label, label_2.

    >>> unique_names(["label", "label", "box3d"])
    ['label', 'label_2', 'box3d']
    """
    names: list[str] = []
    for column in columns:
        numbered = (f"{column}_{n}" for n in count(2))
        names.append(next(n for n in chain([column], numbered) if n not in names))
    return names


def plain(value: Any) -> Any:
    """A value as JSON has it; numbers that it has no form for, and all else, as PostgreSQL says."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if isinstance(value, Decimal) and value.is_finite():
        return int(value) if value == value.to_integral_value() else float(value)
    if isinstance(value, float | Decimal) and not math.isfinite(value):
        return "NaN" if value != value else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, bytes | memoryview):
        return "\\x" + bytes(value).hex()
    if isinstance(value, Range):
        return _range(value)
    return value if isinstance(value, str | int | float | None) else str(value)


def _range(value: Range[Any]) -> str:
    if value.isempty:
        return "empty"
    low, high = ("" if end is None else str(end) for end in (value.lower, value.upper))
    return f"{'[' if value.lower_inc else '('}{low},{high}{']' if value.upper_inc else ')'}"


def readable(value: Any) -> str:
    """A value as a table shows it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict | list):
        return ", ".join(map(str, value)) if _flat(value) else json.dumps(value, default=str)
    return str(value)


def _flat(value: Any) -> bool:
    return isinstance(value, list) and not any(isinstance(v, dict | list) for v in value)
