"""The libraries of `semmap[manipulation]`, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from semmap.manipulation.error import ManipulationError


def library(name: str) -> Any:
    """Return a module of the extra.

    Raises
    ------
    ManipulationError
        It is not installed; the text says how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ManipulationError(
            f"{name} is not installed; install the extra: pip install 'semmap[manipulation]'"
        ) from error
