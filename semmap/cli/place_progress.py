"""A bar that shows which place long work has come to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from semmap import cli


@contextmanager
def place_progress(*, quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """A function of a place, its number and how many there are; its first call shows the bar."""
    from rich.progress import Progress

    with Progress(console=cli.out, transient=True, disable=quiet) as bar:
        task = bar.add_task("", total=None, visible=False)

        def progress(place: str, number: int, total: int) -> None:
            bar.update(task, description=place, completed=number, total=total, visible=True)

        yield progress
