"""Clocks that jump: those of the server and of the processes that work on it (`libfaketime`)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

LIBRARY = next(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"), None)
ABSENT = "libfaketime is not installed: apt-get install libfaketime"


@contextmanager
def movable_clock(folder: Path) -> Iterator[Callable[[str], None]]:
    """Let the clock of the processes that start meanwhile have an offset, which the yield sets."""
    file = folder / "clock"

    def set_clock(offset: str) -> None:
        new = file.with_suffix(".new")
        new.write_text(f"{offset}\n")
        new.chmod(0o644)
        new.rename(file)

    set_clock("+0")
    settings = {
        "FAKETIME_TIMESTAMP_FILE": str(file),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    with preloaded(LIBRARY, settings):
        yield set_clock


@contextmanager
def preloaded(library: Path | None, settings: Mapping[str, str]) -> Iterator[None]:
    """Let the processes that start meanwhile load a library, with its settings."""
    before = dict(os.environ)
    os.environ |= {"LD_PRELOAD": str(library), **settings}
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
