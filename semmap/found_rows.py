"""Rows of named values with the reasons for missing ones; a notebook shows them as a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, overload

Row = dict[str, Any]

LONGEST = 7
"""The most numbers that a cell of a notebook's table shows, as a pose has them."""


@dataclass(frozen=True)
class FoundRows(Sequence[Row]):
    """The rows that answer a question, the best first, and why some are missing.

    >>> found = FoundRows([{"name": "table1", "area": 1.28}], ["shelf1: has no triangles"])
    >>> len(found), found[0]["area"], found.problems
    (1, 1.28, ['shelf1: has no triangles'])
    """

    rows: list[Row]  # the keys are those that the method names
    problems: list[str] = field(default_factory=list)  # why rows are missing

    def __len__(self) -> int:
        """How many rows there are."""
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> list[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | list[Row]:
        """A row, or those of a slice."""
        return self.rows[index]

    def _repr_html_(self) -> str:
        return html_table(self.rows) + "".join(f"<p>{escape(text)}</p>" for text in self.problems)


def html_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a table in HTML; columns with long or nested values are left out.

    >>> html_table([{"name": "<mug>", "size": (0.08, 0.08, 0.1)}])
    '<table><tr><th>name</th><th>size</th></tr><tr><td>&lt;mug&gt;</td><td>0.08, 0.08, 0.1</td></tr></table>'
    """  # noqa: E501
    names = [key for key in (rows[0] if rows else ()) if all(_is_short(row[key]) for row in rows)]
    lines = [_line("th", names), *(_line("td", [_cell(row[key]) for key in names]) for row in rows)]
    return f"<table>{''.join(lines)}</table>"


def _line(tag: str, cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _is_short(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return len(value) <= LONGEST and not any(isinstance(v, list | tuple | dict) for v in value)
    return not isinstance(value, dict)


def _cell(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_cell, value))
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)
