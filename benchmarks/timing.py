"""Medians of repeated runs, and tables of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

__all__ = ["Row", "median_seconds", "medians_in_turn", "print_rows"]


@dataclass
class Row:
    """One claim: what was measured, what is required, and whether it is met."""

    job: str
    ours: str
    reference: str
    required: str
    ok: bool


def median_seconds(
    run: Callable[[], object],
    times: int = 7,
    warm_up: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """The median time of a call, in seconds; `time.process_time` leaves out other programs."""
    for _ in range(warm_up):
        run()
    seconds = []
    for _ in range(times):
        start = clock()
        run()
        seconds.append(clock() - start)
    return statistics.median(seconds)


def medians_in_turn(*runs: Callable[[], object], times: int = 11, warm_up: int = 1) -> list[float]:
    """The medians of calls made in turn, so that all see the same machine, in seconds."""
    seconds: list[list[float]] = [[] for _ in runs]
    for turn in range(warm_up + times):
        for taken, run in zip(seconds, runs, strict=True):
            start = time.perf_counter()
            run()
            if turn >= warm_up:
                taken.append(time.perf_counter() - start)
    return [statistics.median(taken) for taken in seconds]


def print_rows(title: str, rows: list[Row]) -> None:
    """Print the claims as a table."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for column in ("job", "measured", "reference in the same run", "required", ""):
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(
            row.job, row.ours, row.reference, row.required, "[green]ok" if row.ok else "[red]no"
        )
    Console(width=140).print(table)
