"""The text of untrusted files: within limits, with errors that name the place and the fix."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from semmap.ingest.world import WorldError
from semmap.limits import TEXT_BYTES


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file; a WorldError refuses one that is absent or too large."""
    try:
        large = partial(WorldError, path, "file")
        TEXT_BYTES.check(path.stat().st_size, large, "Split it into several files.")
        return path.read_bytes()
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise WorldError(path, "file", problem, "Check path and permissions.") from error


def read_text(path: Path) -> str:
    """Return the text of a file; a WorldError refuses one that is not UTF-8."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        where = f"byte {error.start}"
        raise WorldError(path, where, "is not UTF-8", "Save it as UTF-8.") from error
