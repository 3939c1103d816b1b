"""Files that appear as a whole, or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_ROOM = 2**16
"""Bytes: a disk with fewer is full for whoever writes a block."""


@contextmanager
def whole_file(path: Path | str) -> Iterator[Path]:
    """Yield a new file beside a path, which replaces the one at the path at the end.

    After an error, the former file is there still. OSError names the path, also where a library
    tells that the disk is full by an error of its own.
    """
    path = Path(path)
    made = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield made
        made.replace(path)
    except OSError as error:
        if error.filename not in (None, str(made), made):
            raise
        raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
    except Exception as error:
        if path.parent.is_dir() and shutil.disk_usage(path.parent).free < _ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        raise
    finally:
        made.unlink(missing_ok=True)


def write_whole(path: Path | str, content: str | bytes) -> None:
    """Write a text, as UTF-8, or bytes to a file that appears as a whole."""
    with whole_file(path) as made:
        made.write_bytes(content.encode() if isinstance(content, str) else content)
