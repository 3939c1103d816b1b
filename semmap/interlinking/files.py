"""Reading files that others wrote: absent, too large or badly encoded ones are errors."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from semmap.interlinking.error import InterlinkingError
from semmap.limits import TEXT_BYTES


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8; an absent, too large or badly encoded one is an error."""
    try:
        TEXT_BYTES.check(path.stat().st_size, partial(_refusal, path), "Split the file.")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InterlinkingError(
            f"{path}: cannot be read ({error.strerror}): check path and permissions"
        ) from error
    except UnicodeDecodeError as error:
        raise InterlinkingError(
            f"{path}: byte {error.start} is not UTF-8: save it as UTF-8"
        ) from error


def _refusal(path: Path, what: str, fix: str) -> InterlinkingError:
    return InterlinkingError(f"{path}: {what}. {fix}")
