"""Folders for temporary files; errors say how to choose another place for them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_FIX = "make room in the folder of temporary files, or set TMPDIR to another one"


def temporary_parent() -> Path:
    """Return the folder in which temporary files lie, or raise OSError."""
    try:
        return Path(tempfile.gettempdir())
    except FileNotFoundError as error:
        raise OSError(error.errno, f"{error.strerror}: {_FIX}", "TMPDIR") from error


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a new folder, which is removed at the end; OSError names its parent."""
    parent = temporary_parent()
    try:
        with tempfile.TemporaryDirectory(prefix="semmap-", dir=parent) as folder:
            yield Path(folder)
    except OSError as error:
        if not str(error.filename).startswith(f"{parent}/semmap-"):
            raise
        raise OSError(error.errno, f"{error.strerror}: {_FIX}", str(parent)) from error
