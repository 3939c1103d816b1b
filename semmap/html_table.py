"""Rows as a table of HTML, as notebooks show them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice
from typing import Any

SHOWN = 100
"""The most rows of a table."""


def html_table(columns: Sequence[str], rows: Sequence[Iterable[Any]]) -> str:
    """Return a table of the first rows, and how many there are.

    Examples
    --------
    >>> html_table(["name"], [("a<b",)])
    '<table><tr><th>name</th></tr><tr><td>a&lt;b</td></tr></table><p>1 row</p>'
    """

    def line(tag: str, cells: Iterable[Any]) -> str:
        texts = ("" if cell is None else escape(str(cell)) for cell in cells)
        return f"<tr>{''.join(f'<{tag}>{text}</{tag}>' for text in texts)}</tr>"

    body = "".join(line("td", row) for row in islice(rows, SHOWN))
    count = f"{len(rows)} row{'' if len(rows) == 1 else 's'}"
    shown = f", the first {SHOWN} are shown" if len(rows) > SHOWN else ""
    return f"<table>{line('th', columns)}{body}</table><p>{count}{shown}</p>"
