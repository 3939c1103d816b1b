"""What commands print: tables for people, JSON for programs."""

from __future__ import annotations

import json
import shutil
import sys
import unicodedata
from contextlib import contextmanager
from functools import cache
from itertools import chain, count
from typing import TYPE_CHECKING, Any, Self

from semmap.plain_values import plain
from semmap.terminal import print_bold, visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rich.progress import TaskID

    from semmap.cli.console import SafeConsole

    out: SafeConsole
    err: SafeConsole


@cache
def _console(name: str) -> SafeConsole:
    """A console, made when it is first used: importing rich takes time."""
    from semmap.cli.console import SafeConsole

    # A file or pipe has no width to fit.
    width = 160 if name == "out" and not sys.stdout.isatty() else None
    # Brackets and colons are parts of names: no markup, no emoji.
    return SafeConsole(
        stderr=name == "err",
        width=width,
        markup=False,
        emoji=False,
        highlight=False,
        soft_wrap=True,
    )


def __getattr__(name: str) -> SafeConsole:
    if name in ("out", "err"):
        return _console(name)
    raise AttributeError(f"module {__name__} has no attribute {name}")


def print_json(value: Any) -> None:
    """Print a value as JSON; what JSON has no form for, as PostgreSQL writes it."""
    print(json.dumps(plain(value), allow_nan=False))


def show_table(
    rows: Sequence[Mapping[str, Any]], as_json: bool, columns: Sequence[str] | None = None
) -> None:
    """Print rows of named values as a table, or as JSON; `columns` of the first row by default."""
    names = list(columns or (rows[0] if rows else ()))
    show_rows(names, [tuple(row[name] for name in names) for row in rows], as_json)


def show_rows(columns: list[str], rows: Iterable[tuple[Any, ...]], as_json: bool) -> None:
    """Print rows as a table, or as JSON objects; a repeated column becomes label, label_2."""
    names = unique_names(columns)
    rows = list(rows)
    if as_json:
        print_json([dict(zip(names, row, strict=True)) for row in rows])
        return
    cells = [["" if v is None else visible(readable(v)) for v in row] for row in rows]
    if any("\n" in cell for row in cells for cell in row) or not _print_columns([names, *cells]):
        print_folded(names, cells)
    print(f"{len(rows)} row{'' if len(rows) == 1 else 's'}", file=sys.stderr)


def _print_columns(lines: Sequence[Sequence[str]]) -> bool:
    """Print a line a row; without printing return False if a terminal is too narrow for that."""
    widths = [max(map(cell_width, column)) for column in zip(*lines, strict=True)]
    if sys.stdout.isatty() and sum(widths) + 2 * len(widths) > shutil.get_terminal_size().columns:
        return False
    padded = [
        "  ".join(
            cell + " " * (width - cell_width(cell))
            for cell, width in zip(line, widths, strict=True)
        ).rstrip()
        for line in lines
    ]
    print_bold(padded[0])
    for line in padded[1:]:
        print(line)
    return True


def cell_width(text: str) -> int:
    """The columns of a terminal that a text takes."""
    if text.isascii():
        return len(text)
    wide = sum(unicodedata.east_asian_width(c) in "WF" for c in text)
    return len(text) + wide - sum(unicodedata.combining(c) > 0 for c in text)


def print_folded(
    names: Sequence[str], lines: Iterable[Sequence[str]], right: Sequence[str] = ()
) -> None:
    """Print cells as a table that folds its columns to the width of the terminal.

    Columns named in `right` are aligned to the right.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in names:
        table.add_column(name, overflow="fold", justify="right" if name in right else "left")
    for line in lines:
        table.add_row(*line)
    _console("out").print(table)


class StageBars:
    """A bar on standard error for each stage of long work, while a ``with`` block lasts."""

    def __enter__(self) -> Self:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeElapsedColumn as Elapsed

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Elapsed())
        self._bars = Progress(*columns, console=_console("err"), transient=True)
        self._tasks: dict[str, TaskID] = {}
        self._bars.start()
        return self

    def report(self, stage: str, done: int, total: int) -> None:
        """Show how much of a stage is done."""
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage)
        self._bars.update(self._tasks[stage], completed=done, total=total or None)

    def stop(self) -> None:
        """Remove the bars."""
        self._bars.stop()

    def __exit__(self, *_: object) -> None:
        self.stop()


@contextmanager
def place_progress(*, quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """A bar, moved by a function of a place, its number and how many there are."""
    from rich.progress import Progress

    with Progress(console=_console("out"), transient=True, disable=quiet) as bar:
        task = bar.add_task("", total=None, visible=False)

        def progress(place: str, number: int, total: int) -> None:
            bar.update(task, description=place, completed=number, total=total, visible=True)

        yield progress


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


def readable(value: Any) -> str:
    """A value as a table shows it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict | list):
        return ", ".join(map(str, value)) if _flat(value) else json.dumps(value, default=str)
    return str(value)


def _flat(value: Any) -> bool:
    return isinstance(value, list) and not any(isinstance(v, dict | list) for v in value)
