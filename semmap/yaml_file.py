"""YAML files that people write: read, or refused in the caller's words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

__all__ = ["parse_yaml", "read_text"]


def read_text(path: Path | str, what: str, error: type[Exception]) -> str:
    """The text of a file; `what` it should be is what the error asks for.

    Raises
    ------
    Exception
        One of type `error`, for a file that is not there or is no text.
    """
    try:
        return Path(path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise error(f"{path}: cannot be read: {problem}. Name {what}") from None


def parse_yaml(said: str, file: str, error: type[Exception]) -> Any:
    """What YAML text says; `file` is what errors call it.

    Raises
    ------
    Exception
        One of type `error`: no YAML, a date that is none (2024-13-45), nested without end.
    """
    try:
        return yaml.safe_load(said)
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        raise error(f"{file}: is no YAML, mend it: {problem}") from None
